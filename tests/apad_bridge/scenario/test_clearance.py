"""The clearance that a stop needs, against hand calculation and against hulls that are integrated step by step."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.doctor.limits import StoppingRoom, stopping_room
from apad_bridge.scenario.blocks.guard_options import GuardOptions
from apad_bridge.scenario.loader import load

SCENARIOS = Path(__file__).parents[3] / "launch_scripts" / "scenarios"
ROOM = StoppingRoom(0.5, 0.7, 0.2, 3.0, 4.2, 0.6)
LENGTHS = st.floats(0.0, 20.0)
ROOMS = st.builds(
    StoppingRoom, LENGTHS, LENGTHS, st.floats(0.0, 2.0), st.floats(0.1, 20.0), LENGTHS, st.floats(0.05, 5.0)
)


@pytest.mark.parametrize(
    ("speed_m_s", "clearance_m"),
    [
        (0.0, 0.5 + 0.35 + 0.2 * 3 + 4.2),
        (0.3, 0.5 + 0.35 + 0.5 * 3 + 4.2),
        (0.6, 0.5 + 0.35 + 0.8 * 3 + 4.2),
        (1.2, 0.5 + 0.35 + 1.4 * 3 + 16.8),
    ],
)
def test_the_parts_add_up_as_by_hand(speed_m_s: float, clearance_m: float) -> None:
    assert ROOM.clearance_m(speed_m_s) == pytest.approx(clearance_m)


@given(room=ROOMS, clearance_m=st.floats(0.0, 100.0))
def test_the_greatest_speed_is_the_one_that_just_fits(room: StoppingRoom, clearance_m: float) -> None:
    fastest_m_s = room.fastest_m_s(clearance_m)
    if fastest_m_s == 0.0:
        assert room.clearance_m(0.0) >= clearance_m - 1e-9
    else:
        assert room.clearance_m(fastest_m_s) == pytest.approx(clearance_m, rel=1e-6, abs=1e-6)
        assert room.clearance_m(1.01 * fastest_m_s) > clearance_m


@given(
    measured_m_s=st.floats(0.2, 2.0),
    speed_m_s=st.floats(0.05, 3.0),
    linear=st.floats(0.05, 0.5),
    quadratic=st.floats(0.0, 0.5),
)
def test_no_hull_that_drag_or_even_braking_slows_coasts_farther_than_the_room_has(
    measured_m_s: float, speed_m_s: float, linear: float, quadratic: float
) -> None:
    """By steps of time, to 1 % of its speed."""
    for constant in (0.0, 0.1):

        def coasted_m(speed: float, constant: float = constant) -> float:
            way_m, stopped, step_s = 0.0, 0.01 * speed, 0.02
            while speed > stopped:
                way_m += speed * step_s
                speed -= step_s * (constant + linear * speed + quadratic * speed**2)
            return way_m

        room = StoppingRoom(0.0, 0.0, 0.0, 1e-9, coasted_m(measured_m_s), measured_m_s)
        assert coasted_m(speed_m_s) <= 1.02 * room.clearance_m(speed_m_s) + 0.01


def test_the_scenario_of_a_real_apad_has_the_clearance_for_both_generations() -> None:
    """Generation A goes as fast as its guard lets it."""
    guards = load(SCENARIOS / "real-apad.yaml").guards
    room, stronger = stopping_room(guards), stopping_room(guards, 0.6)
    # 0.5 + 0.35 + (0.8 + 0.2) x 3 + 4.2 x (0.8 / 0.6)^2
    needed_m = room.clearance_m(guards.speed_limit_m_s)
    assert needed_m == pytest.approx(11.3167, abs=1e-3) and needed_m <= guards.clearance_m
    # A known sea of 0.6 m/s, and one slower than the drift that the guards state.
    more_m = stronger.clearance_m(0.5) - room.clearance_m(0.5)
    assert more_m == pytest.approx((0.6 - guards.drift_m_s) * guards.reaction_s)
    assert stopping_room(guards, 0.1) == room
    # What a scenario leaves out is named.
    partly = GuardOptions(coasting_m=4.2, coasting_speed_m_s=0.6)
    lacks = [stopping_room(it) for it in (replace(guards, hull_m=None), partly)]
    assert lacks == [["guards.hull_m"], ["guards.position_error_m", "guards.hull_m"]]
