"""What a scenario's block `water` becomes for the agents: currents, tides and fields as plain values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from agents.water.patches import Waters
from apad_bridge.scenario.currents import current_text
from apad_bridge.scenario.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.water import Fields


@dataclass(frozen=True, slots=True)
class AgentsWater:
    """As an agents' `FleetConfig` has it."""

    current_csv: str | None
    tides: tuple[tuple[int, int, int, int, int], ...]
    current_profile: tuple[tuple[int, int], ...]
    oxygen_mg_l: Waters
    temperature_c: Waters
    turbidity_ntu: Waters


def agents_water(scenario: Scenario) -> AgentsWater:
    """Reads the current's file."""
    fields = Fields() if scenario.water is None else scenario.water.fields
    return AgentsWater(
        _current(scenario),
        _tides(scenario),
        _profile(scenario),
        *(_waters(fields, name) for name in ("oxygen_mg_l", "temperature_c", "turbidity_ntu")),
    )


def _current(scenario: Scenario) -> str | None:
    name = scenario.fleet.drift.current_file
    if name is None and scenario.water is not None and scenario.water.current is not None:
        name = scenario.water.current.file
    return None if name is None else current_text(Path(name), LocalFrame.about(scenario.area.origin))


def _tides(scenario: Scenario) -> tuple[tuple[int, int, int, int, int], ...]:
    if scenario.water is None or scenario.water.current is None:
        return ()
    return tuple(
        (
            round(tide.period_h * 3600),
            round(tide.north_m_s * 1e6),
            round(tide.east_m_s * 1e6),
            round(tide.north_phase_deg / 360 * 1e6),
            round(tide.east_phase_deg / 360 * 1e6),
        )
        for tide in scenario.water.current.tides
    )


def _profile(scenario: Scenario) -> tuple[tuple[int, int], ...]:
    if scenario.water is None or scenario.water.current is None:
        return ()
    return tuple((round(depth * 1e6), round(share * 1e6)) for depth, share in scenario.water.current.profile)


def _waters(fields: Fields, name: str) -> Waters:
    layers = tuple((round(depth_m * 1e6), value) for depth_m, value in getattr(fields, name))
    patches = tuple(
        (
            core,
            round(patch.begins_s * 1000),
            round(patch.growing_s * 1000),
            *(round(it * 1e6) for it in patch.place_m),
            *(round(it * 1e6) for it in patch.drift_m_s),
            round(patch.radius_m * 1e6),
            round(patch.from_depth_m * 1e6),
        )
        for patch in fields.patches
        if (core := getattr(patch, name)) is not None
    )
    return Waters(layers, patches)
