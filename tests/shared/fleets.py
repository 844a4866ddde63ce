"""The fleet from which tests start; each test changes what it needs."""

from __future__ import annotations

from agents.fleet import FleetConfig
from firmware_model.table_one import WORST_CASE

PAPER = FleetConfig(
    theta=30,
    seed=5,
    codec="musselbed-1",
    charge=WORST_CASE,
    pin_debounce_ms=50,
    boot_ms=2000,
    float_timeout_ms=600_000,
    release_wait_ms=120_000,
    report_period_ms=30_000,
    heard_always=True,
    bottom_um=3_000_000,
    surfacing_ms=60_000,
    sinking_ms=45_000,
    drifts_always=True,
    drift_amplitude_um=5000,
    current_csv=None,
)
"""The worst case, with the paper's reception and drift."""
STILL = {"heard_always": False, "drifts_always": False, "drift_amplitude_um": 0}
"""Changes for `dataclasses.replace`: still water, and aMussels that are not always heard."""
