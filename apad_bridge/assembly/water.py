"""Converts the scenario's block `water` for a fleet's sea and for the agents, as plain values."""

from __future__ import annotations

from agents.water.fields import WaterFields
from agents.water.patches import CALM, QuantityWater, WaterPatch
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.water.options import Fields


def waters_config(scenario: Scenario) -> dict[str, QuantityWater]:
    """Converts the water's true values, by the sensors' keys: those of a calm bay without the block."""
    return CALM if scenario.water is None else {key: _waters(scenario.water.fields, key) for key in CALM}


def true_water(scenario: Scenario) -> WaterFields:
    """The water's true value of each quantity that a sensor measures, at a place and an agent time."""
    return WaterFields.by_key({key: it.field() for key, it in waters_config(scenario).items()})


def leeway_um_s(scenario: Scenario) -> tuple[int, int]:
    wind = None if scenario.water is None else scenario.water.wind
    if wind is None:
        return 0, 0
    return round(wind.leeway * wind.north_m_s * 1e6), round(wind.leeway * wind.east_m_s * 1e6)


def _waters(fields: Fields, key: str) -> QuantityWater:
    layers = tuple((round(depth_m * 1e6), value) for depth_m, value in getattr(fields, key))
    patches = tuple(
        WaterPatch(
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
    return QuantityWater(layers, patches)
