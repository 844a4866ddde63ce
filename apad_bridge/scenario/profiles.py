"""Named profiles: measured or fitted blocks of numbers for a scenario to start from.

A block that names a profile takes each key from it that the block itself leaves out. A resolved scenario has all keys
written out, so a flown run stays the same when a later version fits a profile anew.
"""

from __future__ import annotations

from typing import Any

from apad_bridge.scenario.firmware_config import grains_of_milliwatts
from firmware_model import table_one
from firmware_model.config import PATH_UNIT, Cycle
from firmware_model.power.charge import FULL, MS_PER_HOUR
from firmware_model.power.rails import Rail

_CAPACITY_WH = table_one.REFERENCE_MWH / 1000
_REPORT_S = 60.0
"""Common to all profiles: the paper's time scale of 30 leaves the aPad 30 s for an answer."""


def _milliwatts(load: int) -> float:
    """Finds the number with the fewest decimals that converts to exactly this load in grains a millisecond."""
    exact = load * MS_PER_HOUR * table_one.REFERENCE_MWH / FULL
    candidates = (round(exact, digits) for digits in range(12))
    return next(it for it in candidates if grains_of_milliwatts(it, _CAPACITY_WH) == load)


def _power() -> dict[str, Any]:
    power = table_one.power()
    return {
        "capacity_wh": _CAPACITY_WH,
        "loads_mw": {rail.name.lower(): _milliwatts(power.loads.of[rail]) for rail in Rail},
        "charge_segments": [list(segment) for segment in table_one.EQUATION_2],
        "two_coils": next(it.value for it in table_one.FITTED if it.name == "two_coils"),
        "path": power.path / PATH_UNIT,
        "motor_run_s": power.motor_run_ms / 1000,
        "receive_ms": power.receive_ms,
        "switch_back": power.switch_back / FULL,
    }


def _metering() -> dict[str, Any]:
    metering = table_one.METERING
    known = {it.name: it.value for it in table_one.METERED}
    return {
        "period_s": metering.period_ms / 1000,
        "settle_s": metering.settle_ms / 1000,
        "internal_resistance_ohm": known["internal_resistance"],
        "idle_mw": _milliwatts(metering.sag_from),
        "lift_mv": known["lift"],
        "noise_mv": known["noise"],
    }


def _cycle(cycle: Cycle) -> dict[str, Any]:
    timeslots = cycle.slots
    return {
        "alarm_s": cycle.alarm_ms / 1000,
        "sample_s": cycle.sample_ms / 1000,
        "processing_s": cycle.processing_ms / 1000,
        "listen_s": cycle.listen_ms / 1000,
        "report_s": _REPORT_S,
        "slots": None
        if timeslots is None
        else {"frame_s": timeslots.frame_ms / 1000, "slot_s": timeslots.slot_ms / 1000},
    }


_HULL = {
    "pin_debounce_ms": 50,
    "boot_ms": 2000,
    "surfacing_s": 60,
    "sinking_s": 60,
    "float_timeout_s": 43200,
    "release_wait_s": 120,
}
"""The aMussel's hull and charger contact in agent time; all values are assumed."""
_WORST_CASE = {
    "discharge_per_min": table_one.EQUATION_1,
    "charge_segments": [list(segment) for segment in table_one.EQUATION_2],
}
_WHOLE = {
    "power": "table-one",
    "cycle": "field",
    "last_resort": {"action": "call", "safe_level": 0.2, "call_period_s": 600},
    "transmit_ms": 1000,
    "hover_period_s": 600,
}
"""The paper's heavy run moves every 10 min; the last resort and the transmission are assumed."""
_PAPER_APAD = {
    "max_speed_m_s": 1.0,
    "max_acceleration_m_s2": 0.3,
    "max_yaw_rate_rad_s": 0.5,
    "mass_kg": 25,
    "drag_n_per_m2_s2": 40,
    "thruster_max_n": 30,
    "thruster_w_per_n": 6,
    "battery": {
        "full_v": 16.0,
        "empty_v": 10.5,
        "capacity_wh": 230,
        "start_fraction": 1.0,
        "hotel_w": 25,
        "charging_w_per_dock": 10,
    },
}
"""The voltages are those of Fig. 4 (b); all other values are assumed."""

_PROFILES: dict[tuple[str, ...], dict[str, dict[str, Any]]] = {
    ("board",): {"worst-case": _HULL | _WORST_CASE, "mu": _HULL | {"whole": _WHOLE}},
    ("apad",): {"paper": _PAPER_APAD},
    ("board", "whole", "power"): {"table-one": _power()},
    ("board", "whole", "power", "metering"): {"table-one": _metering()},
    ("board", "whole", "cycle"): {"hourly": _cycle(table_one.HOURLY), "field": _cycle(table_one.FIELD)},
}
"""The profiles by the block's path and the profile's name."""


def with_profiles(data: dict[str, Any]) -> dict[str, Any]:
    """Returns the data with profiles written out; it leaves malformed profiles to the schema, which refuses them.

    A text in the place of a block is a profile's name; `cycle: never` means no cycle.
    """
    for path, profiles in _PROFILES.items():
        data = _with_profile_at(data, path, profiles)
    return data


def _with_profile_at(
    data: dict[str, Any], path: tuple[str, ...], profiles: dict[str, dict[str, Any]]
) -> dict[str, Any]:
    key, *rest = path
    if key not in data:
        return data
    inner = data[key]
    if rest:
        return (
            {**data, key: _with_profile_at(inner, tuple(rest), profiles)} if isinstance(inner, dict) else data
        )
    if (key, inner) == ("cycle", "never"):
        return {**data, key: None}
    given = {"profile": inner} if isinstance(inner, str) else inner
    if not isinstance(given, dict):
        return data
    name = given.get("profile")
    profile = profiles.get(name, {}) if isinstance(name, str) else {}
    return {**data, key: _merged(profile, given)}


def _merged(profile: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    merged = {**profile, **given}
    for key, inner in profile.items():
        if isinstance(inner, dict) and isinstance(given.get(key), dict):
            merged[key] = {**inner, **given[key]}
    return merged
