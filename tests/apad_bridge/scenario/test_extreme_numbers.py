"""Every number of a scenario, replaced by numbers that arithmetic cannot bear: it is refused by its key, or it flies."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from functools import cache
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import pytest
import yaml
from scenario_files import SCENARIO_FILES

from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.scenario.loader import ScenarioError, from_data, resolve
from apad_bridge.scenario.schema import Scenario

VALUES = (-0.0, 0, 5e-324, 1e-300, 1e308, 2**63, math.nan, math.inf, -math.inf)
# In 14 s each base comes to every kind of fact that it comes to in 20 s.
FLIGHT = """
duration_s: 14
fleet: {count: 2, start: {charge: [0.3, 0.8]}, drift: {mode: paper, amplitude_m: 0.005, current_m_s: [0.1, 0.05]},
        firmware: {executable: /bin/true, agents: [1]},
        spread: {drain: 0.05, capacity: 0.05, secondary_start: 0.1, drain_bias: 0.1}}
hearing: {mode: paper, report_period_s: 5}
"""
POOL = """
board: {surfacing_timeout_s: 600, motor_run_charge: 0.01}
mission: {pool_threshold: 0.9, batch: 2, dispatch: asynchronous, charge_to: 0.95, charge_lead: 0.4,
          again_threshold: 0.1, end_by: 600}
area: {fence: [[-50, -50], [80, -50], [80, 80], [-50, 80]], keep_out: [[[60, 60], [70, 60], [70, 70]]], home_m: [14, 10]}
guards: {leg_m: 500, adrift_s: 27, leg_s: 600, speed_limit_m_s: 5, battery_reserve: 0.1, amussel_depth_m: 50,
         position_error_m: 0.5, hull_m: 0.7, coasting_m: 1, coasting_speed_m_s: 1}
apad: {home: {charging_w: 200, go_at: 0.2, leave_at: 0.9}, unavailable: [{from_s: 5, until_s: 8}]}
apads: [{name: apad2, start_m: [5, 5], battery_start_fraction: 0.9}]
sharing: {consensus: {loss: 0.1, delay_s: 1, silences: [{apad: apad2, from_s: 5, to_s: 9}]}}
faults: {at: [{fault: bit_flip, id: 1, at_s: 5, for_s: 4, value: 0.5}], mix: {seed: 3, count: 10, of: [apad_lies]}}
"""
SOUND = """
fleet: {count: 2, start: {charge: [0.3, 0.8]}, drift: {mode: physical}, hosting: one_process}
hearing: {mode: physical, report_period_s: 5}
beliefs: {estimator: twin, twin: {drain_deviation: 0.05, sensor_noise: 0.005, bias_deviation: 0.02, unscheduled: 0.01,
                                  fix_deviation_m: 0.5, current_deviation_m_s: 0.01,
                                  untold: {ageing: 0.4, drain: 0.2, bias: 0.05}}}
water:
  sound: {reverberation_s: 0.1, fading_db: 3, absorption_db_per_km: 3,
          sea_water: {temperature_c: 20, salinity_psu: 38, depth_m: 2},
          error_curve: {snrs_db: [0, 10], sizes: [8, 64], rates: [[0.9, 0.1], [0.95, 0.2]]}}
  wifi: {}
  talk: {ping_period_s: 10, turn: [1, 2], assigns: true, beacon_period_s: 60}
  localisation: {}
  current: {steady_m_s: [0.1, 0.05], tides: [{period_h: 12, north_m_s: 0.05, east_m_s: 0.02}], profile: [[0, 1], [2, 0.5]]}
  wind: {north_m_s: 2, east_m_s: 1}
  fields: {patches: [{begins_s: 0, growing_s: 60, place_m: [10, 10], drift_m_s: [0.1, 0.1], radius_m: 5,
                      oxygen_mg_l: 4, temperature_c: 20, turbidity_ntu: 5}]}
"""
WHOLE = """
fleet: {agent_ids: [3, 5], share: [3], start: {charge: [0.3, 0.8]}, drift: {mode: physical}, hosting: one_process}
mission: {docking: {profile: virtual, virtual_ids: [3], camera_ids: [5], visual_ids: [7], dock_s: 5, undock_s: 5,
                    timeout_s: 60}}
"""
METERED = """
power: {profile: table-one, metering: table-one, ageing: {cycles: 100, years: 1}}
timekeeping: {bound_ppm: 20, beacon_wait_s: 60}
"""
SERVO = {
    "search_yaw_rate_rad_s": 0.2,
    "max_yaw_rate_rad_s": 0.5,
    "max_surge_m_s": 0.3,
    "surge_stdev": 0.3,
    "search_s": 30,
}
BASES = {"pool": POOL, "sound": SOUND, "whole": WHOLE}
"""Scenarios that have every number between them, by the names of their files."""
Path = tuple[str | int, ...]
CONTRADICTED: dict[Path, str] = {
    ("fleet", "count"): "apads",
    ("mission", "pool_threshold"): "mission.again_threshold",
}
"""The key that is named where a number contradicts it."""


@cache
def base(name: str) -> Scenario:
    data = yaml.safe_load((SCENARIO_FILES / f"{name}.yaml").read_text())
    for text in (FLIGHT, BASES[name]):
        for key, value in yaml.safe_load(text).items():
            data[key] = {**data[key], **value} if key in ("apad", "area", "board", "mission") else value
    data["mission"]["docking"]["servo"] = SERVO
    if name == "whole":
        data["board"]["whole"] |= yaml.safe_load(METERED)
    return from_data(data, name)


def numbers(data: Any, path: Path = ()) -> Iterator[Path]:
    """The path of every number in plain data."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from numbers(value, (*path, key))
    if type(data) in (int, float):
        yield path


def with_value(data: Any, path: Path, value: float) -> Any:
    """The data with a value of its own at the path; the rest is the same objects, which nobody changes."""
    if not path:
        return value
    changed = data.copy()
    changed[path[0]] = with_value(data[path[0]], path[1:], value)
    return changed


def dotted(path: Path) -> str:
    return "".join(f"[{it}]" if isinstance(it, int) else f".{it}" for it in path).lstrip(".")


def names(line: str, path: Path) -> bool:
    """True for a message about a key, about the block or list that it is in, or about a key that contradicts it."""
    about = line.removeprefix("x: ").partition(": ")[0]
    return about in {*(dotted(path[: n + 1]) for n in range(len(path))), CONTRADICTED.get(path)}


def numbers_of_schema(kind: Any) -> set[tuple[type, str]]:
    """(block, key) of each number that the schema knows."""
    found = set()
    for key, hint in get_type_hints(kind, include_extras=True).items():
        for leaf in leaves(hint):
            if dataclasses.is_dataclass(leaf):
                found |= numbers_of_schema(leaf)
            elif leaf in (int, float):
                found.add((kind, key))
    return found


def leaves(hint: Any) -> Iterator[Any]:
    if get_origin(hint) is Annotated:
        yield from leaves(get_args(hint)[0])
    elif get_origin(hint) in (tuple, Union, UnionType):
        for part in get_args(hint):
            yield from leaves(part)
    else:
        yield hint


def numbers_given(block: Any) -> set[tuple[type, str]]:
    """(block, key) of each number that a scenario has."""
    found = set()
    for field in dataclasses.fields(block):
        for value in flat(getattr(block, field.name)):
            if dataclasses.is_dataclass(value):
                found |= numbers_given(value)
            elif type(value) in (int, float):
                found.add((type(block), field.name))
    return found


def flat(value: Any) -> Iterator[Any]:
    if isinstance(value, tuple):
        for item in value:
            yield from flat(item)
    else:
        yield value


def test_the_sweep_leaves_no_number_out() -> None:
    swept = set().union(*(numbers_given(base(name)) for name in BASES))
    assert numbers_of_schema(Scenario) - swept == set()


@pytest.mark.parametrize("block", list(resolve(base("sound"))))
def test_a_number_is_refused_by_its_key_or_flies(block: str) -> None:
    """A zero flies in every base that has its key, with a sign where it takes one; a tiny number in the first of them."""
    seen: set[tuple[Path, float]] = set()
    for name in BASES:
        whole = resolve(base(name))
        for path in numbers(whole[block], (block,)):
            is_zero_flown = False
            for value in VALUES:
                try:
                    scenario = from_data(with_value(whole, path, value), "x")
                except ScenarioError as error:
                    assert any(names(line, path) for line in error.lines), (path, value, error.lines)
                    continue
                assert math.isfinite(value) and abs(value) < 2**62, f"{dotted(path)} takes {value}"
                if not (is_zero_flown if value == 0 else (path, value) in seen):
                    fly_in_memory(scenario)
                is_zero_flown = is_zero_flown or value == 0
                seen.add((path, value))
