"""A run as its journal tells it: places, velocities and times, by calculations by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from apad_bridge.beliefs.modes import Mode
from apad_bridge.records.run_state import PlanView
from apad_bridge.scenario.run_options import TimeSource

EAST_RAD = math.pi / 2
Act = Callable[[Any], object]


def velocity(run: Any) -> object:
    return run.apad.forward_m_s, run.apad.left_m_s, run.apad.turn_rad_s


def is_moving(run: Any) -> bool:
    return velocity(run) != (0.0, 0.0, 0.0)


def beliefs(run: Any) -> object:
    return [(it.agent_id, it.place_m, it.depth_m, it.is_docked) for it in run.beliefs]


def ages(run: Any) -> object:
    return [(it.heard_ms, it.at_ms, it.mode, it.place_cov and tuple(it.place_cov)) for it in run.beliefs]


def truths(run: Any) -> object:
    return [(agent_id, place_m) for agent_id, place_m, _ in run.truths]


def depth_m(run: Any) -> object:
    ((_, _, depth_m),) = run.truths
    return depth_m


def plan(left: int, *plan: Any) -> Act:
    return lambda it: setattr(it.run.state, "plan", PlanView(*plan[:3], left, *plan[3:]))


SINKS: list[Act] = [lambda it: it.truth(1000, 4, buoyancy="SINK", depth=[30_000, 0])]
PLACES: list[Act] = [
    lambda it: it.belief(1000, 7, north_m=1.0, east_m=2.0),
    lambda it: it.belief(1000, 9, north_m=3.0, east_m=4.0),
]
COLLECT = ("collect", "greedy", ((7, 0), (8, 1), (9, 2)))
BOTTOM_M = 3.0
TWO: list[Act] = [
    lambda it: it.belief(1000, 7, reported={"depth_m": 3.0}, north_m=1.0, east_m=2.0),
    lambda it: it.belief(1000, 4, reported={"depth_m": 2.5}, north_m=3.0, east_m=4.0),
    lambda it: (it.truth(1000, 4), it.truth(1000, 7, docked=True)),
]
DOCKED = [*TWO, lambda it: it.apad(2000, 8.0, 9.0, docks=(-1, 7))]
KNOWN: dict[str, tuple[list[Act], Callable[[Any], object], object]] = {
    "nothing is known before the first line": (
        [],
        lambda it: (it.apad, it.beliefs, it.truths, it.plan_m, it.now_ms),
        (None, [], [], [], 0),
    ),
    # 1 m north and 2 m east in two seconds, heading east: 1 m/s ahead, and 0.5 m/s to the left, which is north. Headings
    # grow clockwise, and ROS's yaw anticlockwise: 0.3 rad anticlockwise in two seconds.
    "the velocity is in the body, forward and left": (
        [lambda it: it.apad(1000, 5.0, 5.0, EAST_RAD + 0.3), lambda it: it.apad(3000, 6.0, 7.0, EAST_RAD)],
        velocity,
        pytest.approx((1.0, 0.5, 0.15)),
    ),
    # Due north: 2 m ahead in a second, a quarter turn to the left.
    "the velocity is that of the last two places": (
        [
            lambda it: it.apad(1000, 5.0, 5.0, EAST_RAD + 0.3),
            lambda it: it.apad(3000, 6.0, 7.0, EAST_RAD),
            lambda it: it.apad(4000, 8.0, 7.0, 0.0),
        ],
        velocity,
        pytest.approx((2.0, 0.0, EAST_RAD)),
    ),
    "a turn over south is a small one": (
        [
            lambda it: it.apad(1000, 0.0, 0.0, math.pi - 0.1),
            lambda it: it.apad(2000, 0.0, 0.0, -math.pi + 0.1),
        ],
        velocity,
        pytest.approx((0.0, 0.0, -0.2)),
    ),
    "a velocity needs two places": ([lambda it: it.apad(1000, 0.0, 0.0)], is_moving, False),
    **{
        f"a velocity of two places that are {at_ms - 1000} ms apart": (
            [lambda it: it.apad(1000, 0.0, 0.0), lambda it, at_ms=at_ms: it.apad(at_ms, 1.0, 0.0)],
            is_moving,
            is_known,
        )
        for at_ms, is_known in ((1000, False), (1001, True), (6000, True), (6001, False))
    },
    **{
        f"a velocity of {at_ms - 2000} ms ago": (
            [
                lambda it: it.apad(1000, 0.0, 0.0),
                lambda it: it.apad(2000, 1.0, 0.0),
                lambda it, at_ms=at_ms: it.belief(at_ms, 7),
            ],
            is_moving,
            is_known,
        )
        for at_ms, is_known in ((7000, True), (7001, False))
    },
    "an aMussel that no dock of the aPad holds is where it is believed": (
        TWO,
        beliefs,
        [(4, (3.0, 4.0), 2.5, False), (7, (1.0, 2.0), 3.0, False)],
    ),
    "a docked aMussel is believed where the aPad is": (
        DOCKED,
        beliefs,
        [(4, (3.0, 4.0), 2.5, False), (7, (8.0, 9.0), 0.0, True)],
    ),
    "a docked aMussel is in truth where the aPad is": (DOCKED, truths, [(4, (1.5, 2.5)), (7, (8.0, 9.0))]),
    # The journal has where a movement began. A second of mission time is thirty of the agent's, of the sixty that it takes
    # to the bottom.
    "a truth that begins to sink is at the surface": (SINKS, depth_m, 0.0),
    "a truth sinks on by agent time": ([*SINKS, lambda it: it.belief(2000, 4)], depth_m, pytest.approx(1.5)),
    "a truth that sinks ends at the bottom": ([*SINKS, lambda it: it.belief(9000, 4)], depth_m, BOTTOM_M),
    "a belief is of its packet's time": (
        [lambda it: it.belief(5000, 7, heard=3000)],
        ages,
        [(3000, 3000, Mode.IDLE, None)],
    ),
    "that of a twin is of its line's": (
        [lambda it: it.belief(5000, 8, heard=3000, mode="CHARGING_PRIMARY", place_cov=[4.0, 0.5, 9.0])],
        ages,
        [(3000, 5000, Mode.CHARGING_PRIMARY, (4.0, 0.5, 9.0))],
    ),
    **{
        f"a plan of which {left} places are left leads through those that are known": (
            [*PLACES, plan(left, *COLLECT)],
            lambda it: it.plan_m,
            way_m,
        )
        for left, way_m in ((3, [(1.0, 2.0), (3.0, 4.0)]), (1, [(3.0, 4.0)]), (0, []))
    },
    "a plan with places of its own": (
        [*PLACES, plan(2, "redeploy", "greedy", ((7, 0), (9, 1)), ((5.0, 6.0), None))],
        lambda it: it.plan_m,
        [(5.0, 6.0)],
    ),
}


@pytest.mark.parametrize(("acts", "look", "known"), KNOWN.values(), ids=KNOWN)
def test_what_is_known_of_a_run(
    story: Any, pool: Any, acts: list[Act], look: Callable[[Any], object], known: object
) -> None:
    """Each line is read when it is written, and gives itself alone."""
    assert pool.area.depth_m == BOTTOM_M
    for number, act in enumerate(acts):
        act(story)
        assert story.poll() != [] or number == len(acts) - 1
        assert story.poll() == []
    assert look(story.run) == known


def test_a_poll_gives_what_is_new(story: Any) -> None:
    story.belief(1000, 7)
    first = story.poll()
    story.apad(2000, 1.0, 2.0)
    assert [(it.at_ms, it.event.kind) for it in (*first, *story.poll())] == [(1000, "belief"), (2000, "apad")]


@pytest.mark.parametrize(("has_ended", "now_ms"), [(False, 4000), (True, 6500)])
def test_after_its_end_a_run_goes_on_by_the_wall(
    story: Any, wall: SimpleNamespace, has_ended: bool, now_ms: int
) -> None:
    story.belief(4000, 7)
    story.poll()
    wall.now_s += 10
    if has_ended:
        story.write(4000, "end", reason="mission time", end_reason="mission time")
    story.poll()
    wall.now_s += 2.5
    story.poll()
    assert (story.run.now_ms, story.run.state.ended_by) == (now_ms, "mission time" if has_ended else None)


@pytest.mark.parametrize(
    ("time", "speed", "has_wall_time"),
    [
        (TimeSource.ASAP, 1.0, False),
        (TimeSource.ROS, 1.0, False),
        (TimeSource.WALL, 10.0, False),
        (TimeSource.WALL, 1.0, True),
    ],
)
def test_stamps_are_mission_time_unless_it_runs_as_the_wall_does(
    begin: Callable[..., Any], time: TimeSource, speed: float, has_wall_time: bool
) -> None:
    story = begin(time, speed)
    story.wall_ms = 1_700_000_090_000
    story.belief(90_000, 7)
    story.poll()
    stamps = (1_700_000_060_000, 1_699_999_999_999) if has_wall_time else (60_000, 0)
    assert (story.run.stamp_ms(60_000), story.run.stamp_ms(-1)) == stamps
    assert story.run.has_wall_time is has_wall_time


def test_a_late_tick_sways_no_stamp_and_another_supervisor_shifts_them(begin: Callable[..., Any]) -> None:
    story = begin(TimeSource.WALL)
    assert story.run.stamp_ms(7) == 7, "nothing is known of the wall's time before the first line"
    story.wall_ms = 1_700_000_000_000
    story.belief(1000, 7)
    story.poll()
    begun_ms = 1_700_000_000_000 - 1000
    # 2 s late is late, and 2.001 s is another time.
    for mission_ms, late_ms, offset_ms in ((2000, 2000, 0), (3000, -2000, 0), (4000, 2001, 2001)):
        story.wall_ms = begun_ms + mission_ms + late_ms
        story.belief(mission_ms, 7)
        story.poll()
        assert story.run.stamp_ms(0) == begun_ms + offset_ms
