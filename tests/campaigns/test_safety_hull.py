"""The faults of the campaign's hull and services, and the packet of its IMC console."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import imcpy
import pytest
from safety.command import IMC_GOAL_DEG
from safety.flight import FENCE
from safety.nodes.hull import Hull
from safety.nodes.imc_order import plan_control
from safety.person import says_done
from safety.track import is_inside

from apad_bridge.events.person_orders import Act
from apad_bridge.imc.console_orders import ConsoleOrder, ConsoleOrders
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.loader import load
from apad_bridge.world.apad.motion import Motion

REAL_APAD = Path(__file__).parents[2] / "launch_scripts" / "scenarios" / "real-apad.yaml"
TENTHS = 100


def sailed(kind: str, *, tether_m: float = 1.0, holds: bool = True) -> list[tuple[float, float]]:
    """(north, speed) each tenth of ten seconds after a hull under way north is spoiled, and told to hold or to coast."""
    motion, hull = Motion(load(REAL_APAD).apad), Hull(tether_m)

    def step() -> None:
        motion.plan_step()
        before = motion.pose
        motion.end_step()
        motion.pose = hull._pose(motion, before)

    motion.set_goal(motion.pose.north_m + 60, motion.pose.east_m, 0.5)
    for _ in range(TENTHS):
        step()
    hull.obey({"hull": kind})
    begin_m = motion.pose.north_m
    if holds:
        motion.set_goal(begin_m, motion.pose.east_m, math.inf)
    else:
        motion.cut_power()
    way = []
    for _ in range(TENTHS):
        step()
        way.append((motion.pose.north_m - begin_m, motion.pose.speed_m_s))
    return way


def test_a_hull_that_obeys_holds_and_coasts() -> None:
    assert sailed("obeys")[-1] == pytest.approx((0.0, 0.0), abs=0.05)
    coasted_m, speed_m_s = sailed("obeys", holds=False)[-1]
    assert 0.5 < coasted_m < 4.0 and speed_m_s < 0.2


@pytest.mark.parametrize("holds", [True, False])
def test_a_deaf_hull_goes_on(holds: bool) -> None:
    assert sailed("deaf", holds=holds)[-1] == pytest.approx((5.0, 0.5), abs=0.05)


def test_a_deaf_hull_may_have_a_velocity() -> None:
    hull, motion = Hull(math.inf), Motion(load(REAL_APAD).apad)
    hull.obey({"hull": "deaf", "velocity_m_s": [0.3, -0.2]})
    pose = hull._pose(motion, motion.pose)
    assert (pose.north_m_s, pose.east_m_s) == (0.3, -0.2)


def test_a_reversed_hull_goes_away_from_the_place_that_it_should_hold_and_coasts_without_thrust() -> None:
    way = sailed("reversed")
    assert way[-1][0] > 5.5 and all(speed_m_s > 0.5 for _, speed_m_s in way)
    assert sailed("reversed", holds=False) == sailed("obeys", holds=False)


def test_a_tied_hull_stays_within_its_tether() -> None:
    assert max(north_m for north_m, _ in sailed("tied", holds=False)) <= 1.0


@pytest.mark.parametrize(
    ("order", "before"),
    [
        ({"answer_s": 1.5, "takes_first": True}, []),
        ({"answer_s": 1.5, "takes_first": False}, [1.5]),
        ({"busy_s": 2.0}, [2.0]),
        ({}, [0.0]),
    ],
    ids=["late, taken first", "late, taken last", "busy", "well"],
)
def test_services_answer_when_they_should(
    monkeypatch: pytest.MonkeyPatch, order: dict[str, Any], before: list[float]
) -> None:
    hull, slept = Hull(math.inf), []
    monkeypatch.setattr(time, "monotonic", lambda: 100.0)
    monkeypatch.setattr(time, "sleep", slept.append)
    hull.obey(order)
    taken: list[float] = []
    assert hull._answered(lambda request: taken.append(sum(slept)) or f"{request} taken", "it") == "it taken"
    assert taken == [sum(before)] and sum(slept) == max(order.get("answer_s", 0.0), order.get("busy_s", 0.0))


def test_the_bench_understands_the_plan_of_the_imc_console() -> None:
    frame = LocalFrame.about(load(REAL_APAD).area.origin)
    orders = ConsoleOrders(frame, "apad1")
    asked = orders.take(imcpy.Packet.deserialize(plan_control(0x2A01, IMC_GOAL_DEG)), "console", 0.0)
    assert isinstance(asked, ConsoleOrder) and asked.request.act is Act.GO_TO
    assert asked.request.goal_m is not None and is_inside(asked.request.goal_m, FENCE)
    stop = orders.take(imcpy.Packet.deserialize(plan_control(0x2A01, None)), "console", 0.0)
    assert isinstance(stop, ConsoleOrder) and stop.request.act is Act.STOP


@pytest.mark.parametrize(
    ("text", "is_done"),
    [
        ("stop 1 (hold): ordered, sent after 0.1 s\ndone: the aPad has taken the stop", True),
        ("apad3: done", True),
        ("stop 1 (hold): ordered\nNOT DONE: the aPad does not obey", False),
        ("its go-to was done before", False),
    ],
)
def test_an_answer_that_says_done(text: str, is_done: bool) -> None:
    assert says_done(text) is is_done
