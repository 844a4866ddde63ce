"""Beliefs that are carried past their last packet, on ROS's standard messages."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from scenario_files import POOL_FILE

from apad_bridge.beliefs.belief import Belief, ClockBelief, Source
from apad_bridge.beliefs.modes import Mode
from apad_bridge.events.mission_events import MissionState
from apad_bridge.ros.gateway.fleet_diagnostics import diagnose
from apad_bridge.ros_names.frames import ellipse_95
from apad_bridge.ros_names.shown_fleet import ball_size_m
from apad_bridge.scenario.loader import load
from firmware_model.states import State

POOL = load(POOL_FILE)
RULES = replace(POOL.mission, silence_timeout_s=120.0, pool_threshold=0.5)


def carried(mode: Mode, charge: float) -> Belief:
    """Last heard a second after the start, awake on the bottom."""
    probabilities = tuple(float(it is mode) for it in Mode)
    return Belief(
        7,
        1000,
        State.ACTIVE,
        charge,
        1.0,
        10.0,
        20.0,
        299_000,
        (0.01, 0.0, 0.0),
        (4.0, 0.5, 9.0),
        probabilities,
        ClockBelief(250.0, 0.0, 90_000.0, 0.0, 0.0),
        Source.PACKET | Source.SILENCE,
        29,
    )


@pytest.mark.parametrize(
    ("variance_m2", "degrees"),
    [((1.0, 0.0, 4.0), 0.0), ((4.0, 0.0, 1.0), 90.0), ((2.5, 1.5, 2.5), 45.0), ((2.5, -1.5, 2.5), -45.0)],
)
def test_an_ellipse_lies_along_where_a_place_is_least_known(
    variance_m2: tuple[float, float, float], degrees: float
) -> None:
    """Deviations of 2 m and 1 m in all of them, from x, east, towards y, north; 95 % lie within 2.4477 of each."""
    found = ellipse_95(variance_m2)
    assert (found.length_m, found.width_m) == pytest.approx((4 * 2.4477, 2 * 2.4477), rel=1e-4)
    x, y, z, w = found.attitude
    assert (x, y) == (0.0, 0.0) and math.degrees(2 * math.atan2(z, w)) == pytest.approx(degrees)


def test_diagnostics_name_the_silent_and_how_sure_one_is() -> None:
    supervisor = SimpleNamespace(
        beliefs=SimpleNamespace(all=lambda: [carried(Mode.ASLEEP, 0.6)]),
        battery=None,
        pose=None,
        primitive="none",
        port=SimpleNamespace(first_failure=None),
        dropped={},
        mission=SimpleNamespace(state=MissionState(), docks=(None,) * 4, unheard="position"),
    )
    array = diagnose(supervisor, (7, 8), RULES, 300_000)  # type: ignore[arg-type]
    statuses = {it.name: (it.message, {value.key: value.value for value in it.values}) for it in array.status}
    message, values = statuses["musselbed: aMussel 7"]
    assert message == "silent for 299 s"
    assert (
        values.items()
        >= {
            "mode": "ASLEEP",
            "mode probability": "1.000",
            "primary 95": "0.404 to 0.796",
            "primary deviation": "0.1000",
            "place deviation": "2.00 m north, 3.00 m east",
            "clock": "+0.250 s, deviation 0.300 s",
            "silent timeslots": "29",
            "learned from": "packet silence",
        }.items()
    )
    assert statuses["musselbed: aMussel 8"][0] == "no report yet"
    assert {"musselbed: aPad", "musselbed: mission"} <= statuses.keys()
    # One of several on a master adds its name: otherwise their statuses would replace each other.
    array = diagnose(supervisor, (), RULES, 300_000, "apad2")  # type: ignore[arg-type]
    assert {status.name for status in array.status} == {"musselbed: aPad apad2", "musselbed: mission apad2"}
    # One of several namespaces adds the namespace.
    array = diagnose(supervisor, (7,), RULES, 300_000, namespace="lab/basin")  # type: ignore[arg-type]
    assert "lab/basin/musselbed: aMussel 7" in {status.name for status in array.status}


SCENARIOS = Path(__file__).parents[4] / "launch_scripts" / "scenarios"


# 28 m by 21 m, 60 m by 40 m, 60 m by 200 m: balls of half a metre, or a hundredth of the longer side.
@pytest.mark.parametrize(("name", "ball_m"), [("pool-12", 0.5), ("bay-24", 0.6), ("bay-120", 2.0)])
def test_balls_are_seen_in_their_area(name: str, ball_m: float) -> None:
    assert ball_size_m(load(SCENARIOS / f"{name}.yaml").area) == ball_m
