"""The fleet from which tests start; each test changes what it needs."""

from __future__ import annotations

from dataclasses import replace

from agents.fleet import FleetConfig
from agents.mussel.body import BodyConfig
from agents.mussel.reporter import ReportConfig
from firmware_model.config import BoardConfig, FullFirmware
from firmware_model.sinking import Sinking
from firmware_model.table_one import MODEL, WORST_CASE

PAPER = FleetConfig(
    theta=30,
    seed=5,
    codec="musselbed-1",
    board=BoardConfig(
        agent_id=0,
        charge=WORST_CASE,
        pin_debounce_ms=50,
        boot_ms=2000,
        float_timeout_ms=600_000,
        release_wait_ms=120_000,
    ),
    body=BodyConfig(Sinking(3_000_000, 60_000, 45_000), drifts_always=True, drift_amplitude_um=5000),
    reports=ReportConfig(30_000, heard_always=True),
)
"""The worst case, with the paper's reception and drift."""
STILL = replace(
    PAPER,
    body=replace(PAPER.body, drifts_always=False, drift_amplitude_um=0),
    reports=replace(PAPER.reports, heard_always=False),
)
"""The same in still water, with aMussels that are not always heard."""


def with_whole_boards(fleet: FleetConfig, whole: FullFirmware) -> FleetConfig:
    """The fleet with whole boards, on their batteries."""
    return replace(fleet, board=replace(fleet.board, charge=MODEL, whole=whole))


def reporting_every(fleet: FleetConfig, period_ms: int) -> FleetConfig:
    return replace(fleet, reports=replace(fleet.reports, period_ms=period_ms))
