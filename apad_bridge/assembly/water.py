"""Converts the scenario's block `water` for a fleet's sea and for the agents, as plain values."""

from __future__ import annotations

from pathlib import Path

from agents.water.patches import CALM, Patch, Waters
from agents.water.stream import CurrentConfig, Tide
from apad_bridge.scenario.currents import current_text, steady_text
from apad_bridge.scenario.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.water import Current, Fields


def current_config(scenario: Scenario) -> CurrentConfig:
    """Converts the scenario's current, and reads its file. OSError, or ValueError for a file that is no current."""
    current = Current() if scenario.water is None else scenario.water.current or Current()
    return CurrentConfig(
        _field_text(scenario, current),
        tuple(
            Tide(
                round(tide.period_h * 3600),
                round(tide.north_m_s * 1e6),
                round(tide.east_m_s * 1e6),
                round(tide.north_phase_deg / 360 * 1e6),
                round(tide.east_phase_deg / 360 * 1e6),
            )
            for tide in current.tides
        ),
        tuple((round(depth * 1e6), round(fraction * 1e6)) for depth, fraction in current.profile),
    )


def _field_text(scenario: Scenario, current: Current) -> str | None:
    """CSV of the current's field, without tides and profile; None where there is no such field."""
    drift = scenario.fleet.drift
    steady_m_s = drift.current_m_s or current.steady_m_s
    if steady_m_s is not None:
        return steady_text(*steady_m_s)
    name = drift.current_file or current.file
    return None if name is None else current_text(Path(name), LocalFrame.about(scenario.area.origin))


def waters_config(fields: Fields) -> dict[str, Waters]:
    """Converts the water's true values, by the sensors' keys."""
    return {key: _waters(fields, key) for key in CALM}


def leeway_um_s(scenario: Scenario) -> tuple[int, int]:
    wind = None if scenario.water is None else scenario.water.wind
    if wind is None:
        return 0, 0
    return round(wind.leeway * wind.north_m_s * 1e6), round(wind.leeway * wind.east_m_s * 1e6)


def _waters(fields: Fields, key: str) -> Waters:
    layers = tuple((round(depth_m * 1e6), value) for depth_m, value in getattr(fields, key))
    patches = tuple(
        Patch(
            core,
            round(patch.begins_s * 1000),
            round(patch.growing_s * 1000),
            round(patch.place_m[0] * 1e6),
            round(patch.place_m[1] * 1e6),
            round(patch.drift_m_s[0] * 1e6),
            round(patch.drift_m_s[1] * 1e6),
            round(patch.radius_m * 1e6),
            round(patch.from_depth_m * 1e6),
        )
        for patch in fields.patches
        if (core := getattr(patch, key)) is not None
    )
    return Waters(layers, patches)
