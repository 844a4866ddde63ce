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


def velocity(story: Any) -> tuple[float, float, float]:
    story.poll()
    apad = story.run.apad
    return apad.forward_m_s, apad.left_m_s, apad.turn_rad_s


def test_nothing_is_known_before_the_first_line(story: Any) -> None:
    assert story.poll() == []
    run = story.run
    assert (run.apad, run.beliefs, run.truths, run.plan_m, run.now_ms) == (None, [], [], [], 0)


def test_a_poll_gives_what_is_new(story: Any) -> None:
    story.belief(1000, 7)
    assert [(it.at_ms, it.event.kind) for it in story.poll()] == [(1000, "belief")]
    assert story.poll() == []
    story.apad(2000, 1.0, 2.0)
    assert [(it.at_ms, it.event.kind) for it in story.poll()] == [(2000, "apad")]
    assert story.run.now_ms == 2000


def test_the_velocity_is_in_the_body_forward_and_left(story: Any) -> None:
    """1 m north and 2 m east in two seconds, heading east: 1 m/s ahead, and 0.5 m/s to the left, which is north."""
    story.apad(1000, 5.0, 5.0, EAST_RAD + 0.3)
    story.apad(3000, 6.0, 7.0, EAST_RAD)
    # Headings grow clockwise, and ROS's yaw anticlockwise: 0.3 rad anticlockwise in two seconds.
    assert velocity(story) == pytest.approx((1.0, 0.5, 0.15))
    story.apad(4000, 8.0, 7.0, 0.0)
    # Due north now: 2 m ahead in a second, a quarter turn to the left.
    assert velocity(story) == pytest.approx((2.0, 0.0, EAST_RAD))


def test_a_turn_over_south_is_a_small_one(story: Any) -> None:
    story.apad(1000, 0.0, 0.0, math.pi - 0.1)
    story.apad(2000, 0.0, 0.0, -math.pi + 0.1)
    assert velocity(story) == pytest.approx((0.0, 0.0, -0.2))


@pytest.mark.parametrize(("at_ms", "is_known"), [(1000, False), (1001, True), (6000, True), (6001, False)])
def test_a_velocity_needs_two_places_within_five_seconds(story: Any, at_ms: int, is_known: bool) -> None:
    story.apad(1000, 0.0, 0.0)
    assert velocity(story) == (0.0, 0.0, 0.0)
    story.apad(at_ms, 1.0, 0.0)
    assert (velocity(story) != (0.0, 0.0, 0.0)) is is_known


@pytest.mark.parametrize(("at_ms", "is_known"), [(7000, True), (7001, False)])
def test_a_velocity_of_five_seconds_ago_is_none(story: Any, at_ms: int, is_known: bool) -> None:
    story.apad(1000, 0.0, 0.0)
    story.apad(2000, 1.0, 0.0)
    story.belief(at_ms, 7)
    assert (velocity(story) != (0.0, 0.0, 0.0)) is is_known


def test_a_docked_aMussel_is_where_the_aPad_is(story: Any) -> None:
    story.belief(1000, 7, reported={"depth_m": 3.0}, north_m=1.0, east_m=2.0)
    story.belief(1000, 4, reported={"depth_m": 2.5}, north_m=3.0, east_m=4.0)
    story.truth(1000, 4)
    story.truth(1000, 7, docked=True)
    story.poll()
    assert [(it.agent_id, it.place_m, it.depth_m, it.is_docked) for it in story.run.beliefs] == [
        (4, (3.0, 4.0), 2.5, False),
        (7, (1.0, 2.0), 3.0, False),
    ]
    story.apad(2000, 8.0, 9.0, docks=(-1, 7))
    story.poll()
    assert [(it.agent_id, it.place_m, it.depth_m, it.is_docked) for it in story.run.beliefs] == [
        (4, (3.0, 4.0), 2.5, False),
        (7, (8.0, 9.0), 0.0, True),
    ]
    assert [(agent_id, place_m) for agent_id, place_m, _ in story.run.truths] == [
        (4, (1.5, 2.5)),
        (7, (8.0, 9.0)),
    ]


def test_a_truth_sinks_on_by_agent_time(story: Any, pool: Any) -> None:
    """The journal has where a movement began. It ends at the bottom, which is 3 m deep."""
    story.truth(1000, 4, buoyancy="SINK", depth=[30_000, 0])
    story.poll()
    ((_, _, before_m),) = story.run.truths
    assert before_m == 0.0
    story.belief(2000, 4)
    story.poll()
    ((_, _, half_m),) = story.run.truths
    # A second of mission time is thirty of the agent's, of the sixty that it takes.
    assert half_m == pytest.approx(pool.area.depth_m / 2)
    story.belief(9000, 4)
    story.poll()
    ((_, _, after_m),) = story.run.truths
    assert after_m == pool.area.depth_m


def test_a_belief_is_of_its_packet_and_that_of_a_twin_of_its_line(story: Any) -> None:
    story.belief(5000, 7, heard=3000)
    story.belief(5000, 8, heard=3000, mode="CHARGING_PRIMARY", place_cov=[4.0, 0.5, 9.0])
    story.poll()
    newest, twin = story.run.beliefs
    assert (newest.heard_ms, newest.at_ms, newest.mode, newest.place_cov) == (3000, 3000, Mode.IDLE, None)
    assert (twin.heard_ms, twin.at_ms, twin.mode) == (3000, 5000, Mode.CHARGING_PRIMARY)
    assert tuple(twin.place_cov) == (4.0, 0.5, 9.0)


def test_a_plan_leads_through_the_places_that_are_known_and_left(story: Any) -> None:
    story.belief(1000, 7, north_m=1.0, east_m=2.0)
    story.belief(1000, 9, north_m=3.0, east_m=4.0)
    story.poll()
    story.run.state.plan = PlanView("collect", "greedy", ((7, 0), (8, 1), (9, 2)), 3)
    assert story.run.plan_m == [(1.0, 2.0), (3.0, 4.0)]
    story.run.state.plan.left = 1
    assert story.run.plan_m == [(3.0, 4.0)]
    story.run.state.plan.left = 0
    assert story.run.plan_m == []
    story.run.state.plan = PlanView("redeploy", "greedy", ((7, 0), (9, 1)), 2, ((5.0, 6.0), None))
    assert story.run.plan_m == [(5.0, 6.0)]


def test_stamps_are_mission_time_unless_it_runs_as_the_wall_does(begin: Callable[..., Any]) -> None:
    for time, speed, has_wall_time in (
        (TimeSource.ASAP, 1.0, False),
        (TimeSource.ROS, 1.0, False),
        (TimeSource.WALL, 10.0, False),
        (TimeSource.WALL, 1.0, True),
    ):
        story = begin(time, speed)
        story.wall_ms = 1_700_000_090_000
        story.belief(90_000, 7)
        story.poll()
        assert story.run.has_wall_time is has_wall_time
        assert story.run.stamp_ms(60_000) == (1_700_000_060_000 if has_wall_time else 60_000)
        assert story.run.stamp_ms(-1) == (1_699_999_999_999 if has_wall_time else 0)


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


def test_after_its_end_a_run_goes_on_by_the_wall(story: Any, wall: SimpleNamespace) -> None:
    story.belief(4000, 7)
    story.poll()
    wall.now_s += 10
    assert story.run.now_ms == 4000
    story.write(4000, "end", reason="mission time", end_reason="mission time")
    story.poll()
    wall.now_s += 2.5
    story.poll()
    assert (story.run.now_ms, story.run.state.ended_by) == (6500, "mission time")
