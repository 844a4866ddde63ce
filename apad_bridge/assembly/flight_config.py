"""Resolves a scenario: everything that the parts of its flight are built from, computed once, as plain values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from agents.modem.frames import ModemGeneration
from agents.mussel.body import BodyConfig
from agents.mussel.reporter import ReportConfig
from agents.water.sea import SeaConfig
from apad_bridge.assembly.estimator import TwinConfig, twin_config
from apad_bridge.assembly.water import AcousticsConfig, acoustics_config, leeway_um_s
from apad_bridge.planning.registry import Trust
from apad_bridge.scenario.firmware_config import board_config, sinking_of
from apad_bridge.scenario.schema import DriftMode, Hearing, HearingMode, Positioning, Scenario
from firmware_model.config import BoardConfig, Timeslots


@dataclass(frozen=True, slots=True)
class FlightConfig:
    """A scenario, and the values that several parts of its flight share."""

    scenario: Scenario
    board: BoardConfig
    """The board of every aMussel."""
    body: BodyConfig
    reports: ReportConfig
    sea: SeaConfig | None
    """None: every packet arrives at once and whole."""
    acoustics: AcousticsConfig | None
    """None without water."""
    twin: TwinConfig | None
    """None for the estimator that holds the last packet."""
    trust: Trust | None
    """None: no code of a file that the scenario names is executed."""

    @property
    def ids(self) -> Sequence[int]:
        """The aMussels of this flight's fleet, ascending."""
        return self.scenario.fleet.ids

    @property
    def timeslots(self) -> Timeslots | None:
        """The timeslots in which the boards transmit; None for boards without any."""
        whole = self.board.whole
        return None if whole is None or whole.cycle is None else whole.cycle.slots


def flight_config(scenario: Scenario, trust: Trust | None = None) -> FlightConfig:
    """Resolves the scenario. Reads no file: the current's file is read when a fleet starts.

    The flight's strategies in files, and its firmware, are executed with `trust` alone.
    """
    water, drift = scenario.water, scenario.fleet.drift
    modems = ModemGeneration.V3 if water is None else water.modems
    board = board_config(scenario.board, scenario.seed, modems)
    body = BodyConfig(
        sinking_of(scenario),
        drifts_always=drift.mode is DriftMode.PAPER,
        drift_amplitude_um=round(drift.amplitude_m * 1e6),
        leeway_um_s=leeway_um_s(scenario),
        coil_alignment_ms=round(scenario.board.coil_alignment_s * 1000),
        gps_deviation_um=gps_deviation_um(scenario.hearing),
        surfacing_failure_ppm=round(scenario.board.surfacing_failure_probability * 1e6),
    )
    reports = ReportConfig(
        scenario.time_scale.agent_span(round(scenario.hearing.report_period_s * 1000)),
        heard_always=scenario.hearing.mode is HearingMode.PAPER,
        modem=modems,
    )
    return FlightConfig(
        scenario=scenario,
        board=board,
        body=body,
        reports=reports,
        sea=None
        if water is None
        else SeaConfig(scenario.seed, water.sound, water.wifi, body.sinking, modems),
        acoustics=None if water is None else acoustics_config(scenario, water, board.whole),
        twin=twin_config(scenario, board, body, reports),
        trust=trust,
    )


def gps_deviation_um(hearing: Hearing) -> int | None:
    """Returns the standard deviation of the aMussels' GPS fixes; None if they know their true places."""
    if hearing.positioning is Positioning.GROUND_TRUTH:
        return None
    return round(hearing.gps_deviation_m * 1e6)
