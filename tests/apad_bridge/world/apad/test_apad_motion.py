"""Travel against a trapezoidal profile worked by hand, and the rule of arrival."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from apad_bridge.vehicle.commands import Arrived, CommandFailed, GoTo, Hold, PoseReported
from apad_bridge.world.apad.kinematics import turned, wrapped
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.apad.thrusters import allocate


def distance_left_m(t_s: float, way_m: float, speed_m_s: float, acceleration_m_s2: float) -> float:
    """Distance to the goal under an ideal trapezoidal profile that starts at t = 0."""
    ramp_s = speed_m_s / acceleration_m_s2
    end_s = way_m / speed_m_s + ramp_s
    if t_s < ramp_s:
        return way_m - acceleration_m_s2 * t_s**2 / 2
    if t_s < end_s - ramp_s:
        return way_m - speed_m_s * (t_s - ramp_s / 2)
    return acceleration_m_s2 * max(0.0, end_s - t_s) ** 2 / 2


def rest_ms(facts) -> int:
    """The time of the last reported pose off the whole seconds, or of the last change of pose."""
    poses = [fact for fact in facts if isinstance(fact, PoseReported)]
    pairs = itertools.pairwise(poses)
    return max(b.at_ms for a, b in pairs if (a.north_m, a.east_m) != (b.north_m, b.east_m))


def arrivals(facts):
    return [(fact.at_ms, fact.command_id) for fact in facts if isinstance(fact, Arrived)]


@pytest.fixture
def apad(config) -> SimulatedAPad:
    return SimulatedAPad(config)


FIGURES = {
    "rest_ms": lambda apad, facts: rest_ms(facts),
    "arrived": lambda apad, facts: arrivals(facts),
    "failed": lambda apad, facts: [it for it in facts if isinstance(it, CommandFailed)],
    "at": lambda apad, facts: (apad.pose.north_m, apad.pose.east_m, apad.pose.speed_m_s),
    "speed": lambda apad, facts: apad.pose.speed_m_s,
    "heading": lambda apad, facts: apad.pose.heading_rad,
}
HERE, THERE = GoTo(1, 0.0, 0.0, 0.5, 0.5), GoTo(1, 14.0, 0.0, 0.5, 0.5)
ARRIVALS = {
    "there already, after a second of samples": ([(2300, HERE)], [(3300, 1)], (0.0, 0.0)),
    "between grid instants, from the next": ([(2301, HERE)], [(3400, 1)], (0.0, 0.0)),
    # 50 ms before the first go-to would have arrived.
    "replaced just before": ([(0, HERE), (950, Hold(2, 0.0, 0.0))], [], (0.0, 0.0)),
    "a hold goes there and never completes": ([(0, Hold(1, 2.0, 1.0))], [], (2.0, 1.0)),
    "a new go-to replaces the old one silently": (
        [(0, THERE), (10_050, GoTo(2, 0.0, 5.0, 0.5, 0.5))],
        [(25_900, 2)],
        (0.0, 5.0),
    ),
}
"""Orders, who arrives, and where it is in the end."""
STRAIGHT = {
    **dict.fromkeys(((14.0, 0.0), (0.0, -14.0), (-8.4, 11.2)), (0.5, 29.667)),
    (0.3, 0.0): (1.0, 2.0),
}
"""Speeds and seconds by goals; the last and short way is a triangle."""
SCENES = {
    **{
        f"a straight way to {goal_m} takes the time of the trapezoid": (
            {},
            [(0, GoTo(1, *goal_m, speed_m_s, 0.1))],
            {60_000: {"rest_ms": pytest.approx(1000 * seconds, abs=200), "at": (*goal_m, 0.0)}},
        )
        for goal_m, (speed_m_s, seconds) in STRAIGHT.items()
    },
    **{
        name: ({}, orders, {90_000: {"arrived": arrived, "failed": [], "at": (*place_m, 0.0)}})
        for name, (orders, arrived, place_m) in ARRIVALS.items()
    },
    "the bow turns to the goal at the yaw rate": (
        {},
        [(0, GoTo(1, 0.0, 10.0, 0.5, 0.5))],
        {2000: {"heading": pytest.approx(1.0)}, 10_000: {"heading": pytest.approx(math.pi / 2)}},
    ),
    # On 25 kg: 2 * 6 N give 0.48 m/s2 for the wanted 0.3, and 2 * 2.5 N in the worst direction 0.2.
    **{
        f"thrusters of {most_n} N accelerate more slowly yet it stops at the goal": (
            {"thruster_max_n": most_n, "drag_n_per_m2_s2": 1.0, "max_speed_m_s": 1.0},
            [(0, GoTo(1, 20.0, 0.0, 1.0, 0.5))],
            {1000: {"speed": pytest.approx(acceleration_m_s2)}, 120_000: {"at": (20.0, 0.0, 0.0)}},
        )
        for most_n, acceleration_m_s2 in ((6.0, 0.3), (2.5, 0.2))
    },
}
"""How the aPad differs, its orders with their times, and figures by times."""


@pytest.mark.parametrize(("changes", "orders", "wanted"), SCENES.values(), ids=SCENES)
def test_scene(config, changes, orders, wanted):
    apad = SimulatedAPad(replace(config, **changes))
    facts = [fact for at_ms, order in orders for fact in apad.receive(order, at_ms)]
    for at_ms, figures in wanted.items():
        facts += apad.advance(at_ms)
        assert {name: FIGURES[name](apad, facts) for name in figures} == figures, at_ms


def test_the_way_is_straight_and_never_goes_beyond_the_goal(apad):
    facts = apad.receive(GoTo(1, 6.0, 8.0, 0.5, 0.5), 0) + apad.advance(60_000)
    for pose in (fact for fact in facts if isinstance(fact, PoseReported)):
        assert pose.east_m == pytest.approx(pose.north_m * 8 / 6, abs=1e-6) and pose.north_m <= 6.0


@pytest.mark.parametrize("radius_m", [0.2, 0.5, 2.0])
def test_arrival_is_the_first_second_whose_mean_distance_is_below_the_radius(apad, radius_m):
    facts = apad.receive(GoTo(7, 14.0, 0.0, 0.5, radius_m), 0) + apad.advance(60_000)
    left_m = [distance_left_m(step / 10, 14, 0.5, 0.3) for step in range(600)]
    expected = next(k for k in range(10, 600) if sum(left_m[k - 9 : k + 1]) / 10 < radius_m)
    assert arrivals(facts) == [(pytest.approx(expected * 100, abs=100), 7)]


@pytest.mark.parametrize(
    ("command", "word"),
    [
        (GoTo(4, 1.0, 1.0, 0.0, 0.5), "speed_m_s"),
        (GoTo(4, 1.0, 1.0, 0.5, 0.0), "victory_radius_m"),
        (GoTo(4, math.nan, 1.0, 0.5, 0.5), "outside"),
        (Hold(4, 0.0, math.inf), "outside"),
    ],
)
def test_an_impossible_command_fails_and_changes_nothing(apad, command, word):
    apad.receive(GoTo(1, 5.0, 0.0, 0.5, 0.5), 0)
    *_, told = apad.receive(command, 500)
    assert (type(told), told.command_id) == (CommandFailed, 4) and word in told.reason
    assert [command_id for _, command_id in arrivals(apad.advance(60_000))] == [1]


def test_poses_come_at_ten_hertz_moving_and_once_a_second_at_rest(apad):
    facts = apad.receive(GoTo(1, 1.0, 0.0, 0.5, 0.1), 0) + apad.advance(10_000)
    times_ms = [fact.at_ms for fact in facts if isinstance(fact, PoseReported)]
    rest = rest_ms(facts)
    assert times_ms == [*range(0, rest + 1, 100), *range(-(-rest // 1000) * 1000, 10_001, 1000)]


def test_turning_takes_the_short_way_over_south():
    assert (turned(3.1, -3.1, 0.5), wrapped(-math.pi)) == (pytest.approx(3.15 - math.tau), math.pi)


@pytest.mark.parametrize("heading_rad", [0.0, 0.4, 2.0, -3.0])
@pytest.mark.parametrize("force", [(10.0, 0.0), (0.0, -7.0), (5.0, 5.0), (300.0, 20.0)])
def test_the_four_thrusts_add_up_to_the_force(heading_rad, force):
    thrusts, part = allocate(*force, heading_rad, 30.0)
    angles = [math.pi / 4, -math.pi / 4, -math.pi / 4, math.pi / 4]
    ways = [(heading_rad + angle, thrust) for thrust, angle in zip(thrusts, angles, strict=True)]
    found = [sum(thrust * part_of(way_rad) for way_rad, thrust in ways) for part_of in (math.cos, math.sin)]
    assert found == pytest.approx([part * force[0], part * force[1]])
    assert max(abs(thrust) for thrust in thrusts) <= 30.0 + 1e-9 and (part == 1.0) == (force[0] < 100)
