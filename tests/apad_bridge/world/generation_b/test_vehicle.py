"""Our simulated aPad shows the behaviour that was read from generation B's published stack."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from flying import play
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import GoTo, Hold
from apad_bridge.vehicle.generation_b.messages import DockingOrder, PrimitiveStatus
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_b import simulated_messages
from apad_bridge.world.generation_b.simulated_messages import (
    ArmPublished,
    CameraTurned,
    Finished,
    GoToBegun,
    GoToEnded,
    GoToLeft,
    Published,
    StatusPublished,
)
from apad_bridge.world.generation_b.vehicle import GenerationBVehicle, Stage

POOL = load(POOL_FILE)
NORTH_M, EAST_M = POOL.apad.start_m
DOCK = DockingOrder(True, 0, 0.3, 0.3, 0.2, 0.2)
UNDOCK = replace(DOCK, docks=False)


def vehicle(drift_m_s: tuple[float, float] = (0.0, 0.0), start_ms: int = 0) -> GenerationBVehicle:
    made = GenerationBVehicle(SimulatedAPad(replace(POOL.apad, drift_m_s=drift_m_s)), start_ms)
    made.advance(start_ms)
    return made


def status_changes(published: list[Published], docking: bool = False) -> list[tuple[int, PrimitiveStatus]]:
    """Changes of a status, with their times."""
    told = [it for it in published if isinstance(it, StatusPublished) and it.docking is docking]
    before = [None, *(it.status for it in told)]
    return [(it.at_ms, it.status) for it, last in zip(told, before, strict=False) if it.status is not last]


@pytest.fixture
def apad() -> GenerationBVehicle:
    return vehicle()


class Watched:
    """A vehicle of a transcript, whose places are metres from where it began. A line answers with what changes."""

    def __init__(
        self, drift_m_s: tuple[float, float] = (0.0, 0.0), fault: Fault = Fault.NONE, docks: int = 4
    ) -> None:
        config = replace(POOL.apad, drift_m_s=drift_m_s, docks=docks)
        self.apad = GenerationBVehicle(SimulatedAPad(config), 0, fault)
        self.now_ms = 0
        self.apad.advance(0)

    def answer(self, move: str) -> str:
        name, *words = move.split()
        numbers = [float(it) for it in words if it.lstrip("-").replace(".", "").isdigit()]
        apad, now_ms, pose = self.apad, self.now_ms, self.apad.pose
        if name == "advance":
            self.now_ms = round(1000 * numbers[0])
        published: dict[str, Callable[[], list[Published] | None]] = {
            "go": lambda: apad.receive(
                GoTo(0, NORTH_M + numbers[0], EAST_M, *(numbers[1:] or (0.5, 0.5))), now_ms
            ),
            "hold": lambda: apad.receive(
                Hold(0, NORTH_M + numbers[0], EAST_M + numbers[1], *numbers[2:]), now_ms
            ),
            "dock": lambda: apad.receive(replace(DOCK, dock_index=int(words[0])), now_ms),
            "undock": lambda: apad.receive(replace(UNDOCK, dock_index=int(words[0])), now_ms),
            "manual": lambda: apad.set_manual(words == ["on"], now_ms),
            **{it: lambda: getattr(apad, name)(now_ms) for it in ("stop", "pause", "go_on")},
            "load": lambda: apad.load(int(words[0]), words[1] == "on", now_ms),
            "detect": lambda: apad.detect(numbers[0], numbers[1], now_ms),
            "advance": lambda: apad.advance(self.now_ms),
        }
        seen: dict[str, Callable[[], str]] = {
            "at": lambda: (
                f"{pose.north_m - NORTH_M:.1f}, {pose.east_m - EAST_M:.1f}, {pose.heading_rad:.2f} rad"
            ),
            "battery": lambda: f"{apad.battery_percent:.2f} %",
            "see": lambda: str(getattr(apad, words[0])),
        }
        return seen[name]() if name in seen else shown(published[name]() or [])


def shown(published: list[Published]) -> str:
    """Changes of the statuses, and what is told once."""
    found = []
    for docking in (False, True):
        changes = [
            f"{it.name.lower()} at {at_ms / 1000:g}" for at_ms, it in status_changes(published, docking)
        ]
        found += [f"{'docking' if docking else 'way'} {', '.join(changes)}"] * bool(changes)
    found += [ONCE[type(it)](it) for it in published if type(it) in ONCE]
    return "; ".join(found)


ONCE: dict[type, Callable[[Any], str]] = {
    ArmPublished: lambda it: f"open at {it.at_ms / 1000:g}: {[n for n in range(4) if it.arm.is_open[n]]}",
    CameraTurned: lambda it: f"camera {it.servo:g}",
    Finished: lambda it: f"finished at {it.at_ms / 1000:g}",
    GoToBegun: lambda it: "begun",
    GoToEnded: lambda it: f"ended: {it.status.name.lower()}",
}


STORIES: dict[str, tuple[dict[str, Any], str]] = {
    # 5 m at 0.5 m/s, half a metre early, half a second for the mean, and the start from rest.
    "a go-to is taken at once, and its end told by topics and below": (
        {},
        """
        go 5       | way running at 0; begun
        advance 30 | way running at 1, done at 10.3; docking idle at 1; ended: done; finished at 10.3
        """,
    ),
    # A little of its own way is left.
    "after the end of a primitive the water takes the boat": (
        {"drift_m_s": (0.1, -0.2)},
        """
        go 1       | way running at 0; begun
        advance 30 | way running at 1, done at 2.3; docking idle at 1; ended: done; finished at 2.3
        at         | 5.3, -5.5, 0.00 rad
        advance 40 | way done at 31; docking idle at 31
        at         | 6.4, -7.5, 0.00 rad
        see stage  | Stage.OFF
        """,
    ),
    "dynamic positioning holds against the water and never ends": (
        {"drift_m_s": (0.1, -0.2)},
        """
        hold 0 1 1  |
        advance 600 | way idle at 1; docking idle at 1
        at          | 0.0, 1.0, 1.00 rad
        """,
    ),
    "without a speed or a radius a go-to aborts": (
        {},
        """
        go 5 0.0 0.5  | way running at 0, idle at 0; begun; ended: idle; finished at 0
        go 5 0.5 0.0  | way running at 0, idle at 0; begun; ended: idle; finished at 0
        go 5 0.5 -1.0 | way running at 0, idle at 0; begun; ended: idle; finished at 0
        advance 10    | way idle at 1; docking idle at 1
        at            | 0.0, 0.0, 0.00 rad
        """,
    ),
    "a new order pre-empts": (
        {},
        """
        go 5      | way running at 0; begun
        advance 2 | way running at 1; docking idle at 1
        hold 0 0  | way preempted at 2; ended: preempted; finished at 2
        """,
    ),
    "docking stands still for 27 s and then searches for ever": (
        {},
        """
        dock 2       | docking running at 0; camera 0.75; open at 0: [2]
        advance 27   | way idle at 1; docking running at 1
        at           | 0.0, 0.0, 0.00 rad
        advance 37   | way idle at 28; docking running at 28
        at           | 0.0, 0.0, 3.00 rad
        advance 1000 | way idle at 38; docking running at 38
        """,
    ),
    "a detection older than a second is none": (
        {},
        """
        dock 0        | docking running at 0; camera 0.1; open at 0: [0]
        advance 26.95 | way idle at 1; docking running at 1
        detect 0 0.5  |
        advance 27.95 | way idle at 27; docking running at 27
        at            | 0.1, 0.0, 0.00 rad
        advance 30    | way idle at 28; docking running at 28
        at            | 0.2, 0.0, 0.60 rad
        """,
    ),
    # 0.3 m/s for 8 s, less the start from rest.
    "undocking pulls back for 8 s": (
        {},
        """
        undock 0   | docking running at 0; camera 0.1
        advance 35 | way idle at 1; docking running at 1, done at 35; open at 27: [0]; open at 35: [];
                   | finished at 35
        at         | -2.2, 0.0, 0.00 rad
        """,
    ),
    "a pilot pre-empts, and nothing is begun meanwhile": (
        {},
        """
        go 5       | way running at 0; begun
        advance 1  | way running at 1; docking idle at 1
        manual on  | way preempted at 1; ended: preempted; finished at 1
        advance 2  | way preempted at 2; docking idle at 2
        go 0       | way running at 2, preempted at 2; begun; ended: preempted; finished at 2
        advance 3  | way preempted at 3; docking idle at 3
        manual off |
        go 0       | way running at 3; begun
        """,
    ),
    "stop_mission ends what is under way": (
        {},
        """
        dock 0    | docking running at 0; camera 0.1; open at 0: [0]
        advance 5 | way idle at 1; docking running at 1
        stop      | docking preempted at 5; open at 5: []; finished at 5
        see stage | Stage.OFF
        """,
    ),
    # Coasting only while it is paused; after the end nothing is paused any more.
    "a paused mission goes on where it was": (
        {},
        """
        go 9       | way running at 0; begun
        advance 4  | way running at 1; docking idle at 1
        pause      | way preempted at 4; ended: preempted; finished at 4
        advance 60 | way preempted at 5; docking idle at 5
        at         | 3.6, 0.0, 0.00 rad
        go_on      | way running at 60; begun
        advance 90 | way running at 61, done at 71.1; docking idle at 61; ended: done; finished at 71.1
        go_on      |
        see stage  | Stage.OFF
        """,
    ),
    # 10 W a dock and 25 W of hotel load for an hour, from a battery of 230 Wh.
    "charging what the bench says it holds costs energy": (
        {},
        """
        battery      | 100.00 %
        load 0 on    |
        load 1 on    |
        load 1 on    |
        advance 3600 | way idle at 1; docking idle at 1
        battery      | 80.43 %
        load 0 off   |
        load 1 off   |
        load 3 off   |
        advance 7200 | way idle at 3601; docking idle at 3601
        battery      | 69.57 %
        """,
    ),
    "a dock that it has not is ordered in vain": (
        {"docks": 2},
        """
        dock 2      |
        see dropped | Counter({'docking: no such dock': 1})
        see stage   | Stage.OFF
        dock 1      | docking running at 0; camera 0.46; open at 0: [1]
        see stage   | Stage.SERVO
        """,
    ),
    "one that lies shows it below the services as on the topics": (
        {"fault": Fault.LIES},
        """
        go 2       | way running at 0, done at 0; begun; ended: done; finished at 0
        advance 20 | way done at 1; docking idle at 1
        """,
    ),
    "one that drops a go-to shows it below the services as on the topics": (
        {"fault": Fault.DROPS},
        """
        go 2       | way running at 0, preempted at 0; begun; ended: preempted; finished at 0
        advance 20 | way preempted at 1; docking idle at 1
        at         | 0.0, 0.0, 0.00 rad
        """,
    ),
    "one that is stuck shows it below the services as on the topics": (
        {"fault": Fault.STUCK},
        """
        go 2       | way running at 0; begun
        advance 20 | way running at 1; docking idle at 1
        see stage  | Stage.GOING
        """,
    ),
    "one that is silent shows nothing": (
        {"fault": Fault.SILENT},
        """
        go 2       |
        advance 20 |
        battery    | 99.90 %
        """,
    ),
}


@pytest.mark.parametrize(("setup", "story"), STORIES.values(), ids=STORIES)
def test_story(setup: dict[str, Any], story: str) -> None:
    play(story, Watched(**setup).answer)


def test_docking_follows_its_law_and_ends_when_the_target_is_low_in_the_image(
    apad: GenerationBVehicle,
) -> None:
    """Yaw rate max * tanh(h), surge max * exp(-h^2 / (2 * 0.2^2)) towards the dock: here dock 1, to starboard."""
    apad.receive(replace(DOCK, dock_index=1), 0)
    for at_ms in range(26_950, 37_000, 100):
        apad.detect(0.1, 0.5, at_ms)
    apad.advance(37_000)
    yaw_rate, surge = 0.3 * math.tanh(0.1), 0.2 * math.exp(-0.125)
    assert apad.pose.heading_rad == pytest.approx(10 * yaw_rate, abs=0.1 * yaw_rate * 2)
    assert apad.pose.speed_m_s == pytest.approx(surge, rel=0.02)
    bearing_rad = math.atan2(apad.pose.east_m_s, apad.pose.north_m_s)
    assert bearing_rad == pytest.approx(apad.pose.heading_rad + math.pi / 2, abs=0.05)
    apad.detect(0.0, 0.8, 37_000)
    assert apad.stage is Stage.SERVOING  # (0.8, 0.9) is open
    apad.detect(0.0, 0.85, 37_000)
    published = apad.advance(37_100)
    assert status_changes(published, docking=True)[-1][1] is PrimitiveStatus.DONE
    assert [it.arm.is_open for it in published if isinstance(it, ArmPublished)] == [(False,) * 4]


def test_what_lies_below_the_services_tells_of_each_go_to_ten_times_a_second(
    apad: GenerationBVehicle,
) -> None:
    order = GoTo(0, NORTH_M, EAST_M - 4, 0.5, 0.5)
    assert apad.receive(order, 50)[0] == GoToBegun(50, order)
    published = apad.advance(30_000)
    (ended,) = [it for it in published if isinstance(it, GoToEnded)]
    assert ended.status is PrimitiveStatus.DONE and ended.pose.east_m == pytest.approx(EAST_M - 4, abs=0.5)
    # West, and the rest of the way agrees with its own place.
    assert ended.left.bearing_rad == pytest.approx(-math.pi / 2)
    assert ended.left.distance_m == pytest.approx(ended.pose.east_m - (EAST_M - 4))
    told_ms = [it.at_ms for it in published if isinstance(it, GoToLeft)]
    assert told_ms == list(range(100, ended.left.at_ms, 100))


def test_requests_are_met_by_their_fields() -> None:
    point = SimpleNamespace(x=3.0, y=-4.0)
    assert simulated_messages.simple_go_to(SimpleNamespace(point=point, speed=0.4)) == GoTo(
        0, 3.0, -4.0, 0.4, 1.5
    )
    simple = simulated_messages.simple_docking(SimpleNamespace(action=False, slot=2))
    assert (simple.docks, simple.dock_index) == (False, 2) and simple.search_yaw_rate_rad_s > 0
    goal = SimpleNamespace(T2=SimpleNamespace(point=point), speed=0.4, victory_radius=0.7)
    assert simulated_messages.goal(goal) == GoTo(0, 3.0, -4.0, 0.4, 0.7)
    hold = SimpleNamespace(north=1.0, east=2.0, heading=0.5, heading_enable=False)
    assert simulated_messages.position(hold) == Hold(0, 1.0, 2.0, None)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(1, 9_000), min_size=1, max_size=12))
def test_however_time_is_cut_the_same_is_shown(cuts: list[int]) -> None:
    def flown(instants: list[int]) -> tuple[list[Published], tuple[float, float]]:
        apad = vehicle(drift_m_s=(0.05, 0.02))
        published = apad.receive(GoTo(0, NORTH_M + 2, EAST_M + 1, 0.5, 0.5), 0)
        for at_ms in instants:
            published += apad.advance(at_ms)
        published += apad.receive(UNDOCK, 9_000) + apad.advance(50_000)
        return published, (apad.pose.north_m, apad.pose.east_m)

    assert flown(sorted(cuts)) == flown([])
