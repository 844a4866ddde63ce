"""The port with a vehicle that the test plays: profiles, pre-emption, time-outs, stalls, wrong and late reports."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from apad_bridge.assembly.stacks import stack_of
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.schema import ArmUse, Docking, DockingProfile
from apad_bridge.vehicle.capabilities import of_simulated_apad
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CloseDock,
    CommandAccepted,
    CommandFailed,
    DockClosed,
    DockOpened,
    GoTo,
    Hold,
    MoveArm,
    OpenDock,
    PoseReported,
)
from apad_bridge.vehicle.docking_port import DockingPort
from apad_bridge.vehicle.outcomes import DockChanged, NothingCaught, PrimitiveFailed, PrimitiveSucceeded

OF_B = stack_of(Generation.B).capabilities(4)
VIRTUAL = Docking(profile=DockingProfile.VIRTUAL, dock_s=15, undock_s=5, timeout_s=60)
VISUAL = replace(VIRTUAL, profile=DockingProfile.VISUAL)
GO = GoTo(1, 10.0, 0.0, 0.5, 0.5)


def pose(at_ms: int, north_m: float, east_m: float = 0.0) -> PoseReported:
    return PoseReported(at_ms, north_m, east_m, 0.0)


def dock(at_ms: int, primitive_id: int = 4, dock_index: int = 2, agent_id: int = 9) -> tuple[int, CloseDock]:
    return at_ms, CloseDock(primitive_id, dock_index, agent_id)


def played(port: DockingPort, *story: Any) -> list[Any]:
    """The port's commands and outcomes in a story: of primitives with their times, of facts, and of times that come."""
    told: list[Any] = []
    for it in story:
        match it:
            case int(at_ms):
                told += port.advance(at_ms)
            case (int(at_ms), primitive):
                told += port.receive(primitive, at_ms)
            case fact:
                told += port.receive(fact, fact.at_ms)
    return told


@pytest.fixture
def port() -> DockingPort:
    return DockingPort(VIRTUAL)


@pytest.fixture
def visual() -> DockingPort:
    return DockingPort(VISUAL)


@pytest.fixture
def stalling() -> DockingPort:
    return DockingPort(VIRTUAL, stall_s=20)


def test_a_go_to_succeeds_when_its_own_arrival_is_heard(port):
    assert played(port, (0, GO), Arrived(900, 99)) == [GO]
    assert played(port, Arrived(2000, 1)) == [PrimitiveSucceeded(2000, 1)] and port.next_due_ms is None
    assert port.dropped == {"arrived: not of the running primitive": 1}


CLOSE = CloseDock(1, 2, 9)
"""The first command of `dock`."""
STORIES: dict[str, tuple[Callable[[], DockingPort], list[Any], list[Any], dict[str, int]]] = {
    "a go-to that the vehicle gives up fails with its reason": (
        partial(DockingPort, VIRTUAL),
        [(0, GO), CommandFailed(70, 1, "no GPS")],
        [GO, PrimitiveFailed(70, 1, "no GPS")],
        {},
    ),
    "slow and steady never stalls": (
        partial(DockingPort, VIRTUAL, stall_s=20),
        [(0, GO), *(pose(n * 1000, n * 0.03) for n in range(330))],
        [GO],
        {},
    ),
    "a port that follows another numbers its commands beyond the other's": (
        partial(DockingPort, VIRTUAL, first_command_id=1001),
        [(0, GO), Arrived(5, 1)],
        [replace(GO, command_id=1001)],
        {"arrived: not of the running primitive": 1},
    ),
    "the vehicle's report of the dock wins": (
        partial(DockingPort, VISUAL),
        [dock(0), DockClosed(10, 0, 9), (20, OpenDock(5, 2, 9))],
        [CLOSE, DockChanged(10, 0, 9, True, ((0, 9),)), PrimitiveSucceeded(10, 4), OpenDock(2, 0, 9)],
        {},
    ),
    "an aMussel that is held already is not asked for twice": (
        partial(DockingPort, VIRTUAL),
        [DockClosed(0, 3, 9), dock(1000)],
        [DockChanged(0, 3, 9, True, ((3, 9),)), PrimitiveSucceeded(1000, 4)],
        {},
    ),
    "one is docked by hand while the port still waits": (
        partial(DockingPort, VIRTUAL),
        [dock(0), DockClosed(3000, 1, 9), 100_000],
        [DockChanged(3000, 1, 9, True, ((1, 9),)), PrimitiveSucceeded(3000, 4)],
        {},
    ),
    "a refused mechanism fails with the vehicle's reason": (
        partial(DockingPort, VISUAL),
        [dock(0), CommandFailed(5, 1, "dock 2 holds aMussel 3")],
        [CLOSE, PrimitiveFailed(5, 4, "dock 2 holds aMussel 3")],
        {},
    ),
    "a late report after the time-out still tells of the dock": (
        partial(DockingPort, VISUAL),
        [dock(0), 60_000, DockClosed(61_000, 2, 9), CommandFailed(61_001, 1, "?")],
        [
            CLOSE,
            PrimitiveFailed(60_000, 4, "the vehicle did not answer within 60 s"),
            DockChanged(61_000, 2, 9, True, ((2, 9),)),
        ],
        {"command_failed: not of the running primitive": 1},
    ),
    "a dock on the way pre-empts the go-to and holds where it is": (
        partial(DockingPort, VIRTUAL),
        [(0, GO), pose(500, 1.5, 0.5), dock(1000), Arrived(1500, 1)],
        [GO, PrimitiveFailed(1000, 1, "pre-empted"), Hold(2, 1.5, 0.5)],
        {"arrived: not of the running primitive": 1},
    ),
    "without a pose there is nowhere to hold, and that is counted": (
        partial(DockingPort, VIRTUAL),
        [(0, GO), dock(1000)],
        [GO, PrimitiveFailed(1000, 1, "pre-empted")],
        {"hold: the vehicle never sent a pose": 1},
    ),
    "a go-to pre-empts a dock that still waits": (
        partial(DockingPort, VIRTUAL),
        [dock(0), (14_999, GO)],
        [PrimitiveFailed(14_999, 4, "pre-empted"), GO],
        {},
    ),
    **{
        f"a vehicle without {what} docks virtually": (
            partial(DockingPort, docking),
            [dock(0), 14_999, 15_000],
            [CLOSE],
            {},
        )
        for what, docking in (
            ("arms", replace(VIRTUAL, arm=ArmUse.MOVED)),
            ("a camera", replace(VIRTUAL, camera_ids=(9,))),
        )
    },
    **{
        f"a report of a dock that a vehicle of {docks} has not is dropped": (
            partial(DockingPort, VIRTUAL, capabilities=of_simulated_apad(docks)),
            [DockClosed(0, docks - 1, 9), DockClosed(0, docks, 8)],
            [DockChanged(0, docks - 1, 9, True, ((docks - 1, 9),))],
            {"dock: no such dock": 1},
        )
        for docks in (1, 4, 6)
    },
    "a vehicle that docks by its own eyes is not asked what the radius holds": (
        partial(DockingPort, VISUAL, capabilities=OF_B, distance_m=lambda *place: math.inf),
        [pose(0, 1.0, 2.0), dock(0)],
        [CLOSE],
        {},
    ),
    "what drifted away after a miss is not caught by the next try": (
        lambda: DockingPort(
            replace(VIRTUAL, attempts=2), distance_m=partial(lambda left, *_: left.pop(), [2.0, 0.0])
        ),
        [pose(0, 1.0, 2.0), dock(0), 15_000, CommandFailed(15_000, 1, "missed")],
        [CLOSE, NothingCaught(15_000, 4)],
        {"a dock was tried again: missed": 1},
    ),
    "battery reports are none of its business": (
        partial(DockingPort, VISUAL),
        [BatteryReported(0, 12.0, 0.4)],
        [],
        {},
    ),
}


@pytest.mark.parametrize(("make", "story", "told", "dropped"), STORIES.values(), ids=STORIES)
def test_a_story_has_commands_and_outcomes(make, story, told, dropped):
    port = make()
    assert played(port, *story) == told and port.dropped == dropped


def test_virtual_docking_waits_then_closes_and_hears(port):
    assert played(port, dock(1000), 15_999) == [] and port.next_due_ms == 16_000
    assert port.advance(16_000) == [CloseDock(1, 2, 9)]
    assert port.receive(DockClosed(16_010, 2, 9), 17_000) == [
        DockChanged(16_010, 2, 9, True, ((2, 9),)),
        PrimitiveSucceeded(17_000, 4),
    ]
    assert dict(port.docked) == {2: 9}


def test_virtual_undocking_waits_its_own_time(port):
    played(port, DockClosed(0, 2, 9))
    assert played(port, (1000, OpenDock(5, 2, 9)), 5999, 6000, DockOpened(6000, 2, 9)) == [
        OpenDock(1, 2, 9),
        DockChanged(6000, 2, 9, False, ()),
        PrimitiveSucceeded(6000, 5),
    ]
    assert dict(port.docked) == {}


def test_visual_docking_adds_no_time(visual):
    assert played(visual, dock(1000)) == [CloseDock(1, 2, 9)]
    assert played(visual, DockClosed(42_000, 2, 9))[-1] == PrimitiveSucceeded(42_000, 4)
    assert played(visual, (50_000, OpenDock(5, 2, 9))) == [OpenDock(2, 2, 9)]


def test_another_aMussel_in_the_dock_is_passed_on_and_is_not_the_one_asked_for(visual):
    assert played(visual, dock(0), DockClosed(10, 2, 8), DockOpened(20, 2, 9))[1:] == [
        DockChanged(10, 2, 8, True, ((2, 8),)),
        DockChanged(20, 2, 9, False, ((2, 8),)),
    ]
    assert visual.running == CloseDock(4, 2, 9)


@pytest.mark.parametrize("docking", [VIRTUAL, VISUAL])
@pytest.mark.parametrize("primitive", [CloseDock(4, 2, 9), OpenDock(4, 2, 9)])
def test_a_silent_vehicle_ends_a_docking_at_the_time_out(docking, primitive):
    port = DockingPort(docking)
    played(port, (1000, primitive), 60_999)
    [failure] = port.advance(61_000)
    assert isinstance(failure, PrimitiveFailed) and "within 60 s" in failure.reason
    assert (failure.at_ms, failure.primitive_id, port.next_due_ms) == (61_000, 4, None)


ACCEPTED = CommandAccepted(0, 1)


@pytest.mark.parametrize(
    ("story", "stalls_ms", "why"),
    [
        ([(1000, GO)], 21_000, "did not accept"),
        # From its acceptance on; that at 3 s is of another order.
        ([(1000, GO), CommandAccepted(3000, 7), CommandAccepted(5000, 1)], 25_000, "no pose"),
        # One that falls silent on the way is told apart from one that is stuck.
        ([(0, GO), ACCEPTED, pose(3000, 1.5)], 23_000, "no pose"),
    ],
)
def test_a_silent_vehicle_stalls_a_go_to(stalling, story, stalls_ms, why):
    played(stalling, *story)
    assert stalling.advance(stalls_ms - 1) == []
    failure = stalling.advance(stalls_ms)[0]
    assert isinstance(failure, PrimitiveFailed) and failure.at_ms == stalls_ms and why in failure.reason


def test_a_vehicle_that_gets_no_nearer_stalls_and_is_told_to_hold_where_it_is(stalling):
    """0.4 m are too little to count; 0.5 m since the start count."""
    nearer = pose(10_000, 0.4), pose(19_000, 0.5), pose(30_000, 0.9)
    assert played(stalling, pose(0, 0.0), (0, GO), ACCEPTED, *nearer, 38_999) == [GO]
    failure, hold = stalling.advance(39_000)
    assert isinstance(failure, PrimitiveFailed) and "9.5 m to go" in failure.reason
    assert hold == Hold(2, 0.9, 0.0)


@pytest.mark.parametrize("closed", [True, False])
def test_a_dock_whose_mechanism_was_commanded_is_waited_for(port, closed):
    played(port, dock(0), 15_000)
    ways = (15_001, replace(GO, command_id=7)), (15_002, replace(GO, command_id=8))
    assert played(port, *ways) == [PrimitiveFailed(15_002, 7, "pre-empted")]
    *_, docked, then = played(port, DockClosed(16_000, 0, 9) if closed else 60_000)
    assert docked.primitive_id == 4 and isinstance(docked, PrimitiveSucceeded) is closed
    assert (then, port.running) == (replace(GO, command_id=2), replace(GO, command_id=8))


def test_a_hold_lasts_until_it_is_replaced_and_has_then_succeeded(port):
    assert played(port, (0, Hold(3, 1.0, 2.0)), 10_000_000) == [Hold(1, 1.0, 2.0)]
    assert port.next_due_ms is None
    assert played(port, (10_000_000, GO))[0] == PrimitiveSucceeded(10_000_000, 3)


def test_the_first_cause_of_a_run_of_failures_is_kept_until_something_succeeds(visual):
    """Neither a pre-emption is a failure, nor does a hold clear the cause."""
    played(visual, (0, GO), (1, replace(GO, command_id=2)))
    assert visual.first_failure is None
    cause = PrimitiveFailed(2, 2, "no GPS")
    played(visual, CommandFailed(2, 2, "no GPS"), dock(3), 100_000)
    assert visual.first_failure == cause
    played(visual, (100_000, Hold(5, 0.0, 0.0)), (100_000, replace(GO, command_id=4)))
    assert visual.first_failure == cause
    played(visual, Arrived(100_001, 5))
    assert visual.first_failure is None


@pytest.mark.parametrize(
    ("fact", "reason"),
    [
        (pose(10, math.nan), "pose: north_m is outside -50000 to 50000"),
        (DockClosed(10, 4, 1), "dock: no such dock"),
        (DockOpened(10, -1, 1), "dock: no such dock"),
        (Arrived(10, 1), "arrived: while acting"),
        (CommandFailed(10, 0, "?"), "command_failed: not of the running primitive"),
    ],
)
def test_a_report_that_makes_no_sense_is_dropped_and_counted(visual, fact, reason):
    assert played(visual, dock(0), fact) == [CloseDock(1, 2, 9)]
    assert (visual.dropped, visual.running) == ({reason: 1}, CloseDock(4, 2, 9))


def test_time_going_back_and_a_stall_time_of_nothing_are_refused(port):
    port.advance(10)
    with pytest.raises(ValueError, match="back"):
        port.advance(9)
    with pytest.raises(ValueError, match="stall_s"):
        DockingPort(VIRTUAL, stall_s=0)


def test_a_mechanism_that_misses_is_tried_again_and_its_first_cause_told() -> None:
    port = DockingPort(replace(VIRTUAL, attempts=3))
    played(port, dock(0))
    for attempt in (1, 2, 3):
        due_ms = attempt * 15_000
        assert played(port, due_ms - 1, due_ms) == [CloseDock(attempt, 2, 9)]
        told = played(port, CommandFailed(due_ms, attempt, f"miss {attempt}"))
        assert told == ([] if attempt < 3 else [PrimitiveFailed(45_000, 4, "miss 1")])
    assert port.first_failure == PrimitiveFailed(45_000, 4, "miss 1")
    assert port.dropped == {f"a dock was tried again: miss {attempt}": 1 for attempt in (1, 2)}


def test_one_that_holds_at_the_second_try_has_succeeded() -> None:
    port = DockingPort(replace(VIRTUAL, attempts=2))
    played(port, dock(0), 15_000, CommandFailed(15_000, 1, "missed"), 30_000)
    assert PrimitiveSucceeded(30_000, 4) in played(port, DockClosed(30_000, 2, 9))
    assert port.first_failure is None


def test_what_waits_behind_a_mechanism_is_not_kept_waiting_by_another_try() -> None:
    port = DockingPort(replace(VIRTUAL, attempts=3))
    played(port, dock(0), 15_000, (16_000, Hold(2, 0.0, 0.0)))
    told = played(port, CommandFailed(17_000, 1, "missed"))
    assert PrimitiveFailed(17_000, 4, "missed") in told and port.running == Hold(2, 0.0, 0.0)


def test_a_virtual_docking_may_open_the_arm_meanwhile() -> None:
    port = DockingPort(replace(VIRTUAL, arm=ArmUse.MOVED), capabilities=OF_B)
    *arm, changed, done, back = played(port, dock(0), 15_000, DockClosed(15_000, 2, 9))
    assert arm == [MoveArm(1, 2, True), CloseDock(2, 2, 9)] and isinstance(changed, DockChanged)
    assert (done, back) == (PrimitiveSucceeded(15_000, 4), MoveArm(3, 2, False))


@pytest.mark.parametrize(("stack", "counted"), [(Generation.A, 2), (Generation.B, 0)])
def test_a_speed_or_radius_that_a_stack_cannot_be_told_is_counted(stack: Generation, counted: int) -> None:
    port = DockingPort(VIRTUAL, capabilities=stack_of(stack).capabilities(4), usual_go_to=(0.5, 0.5))
    speeds_and_radii = enumerate([(0.5, 0.5), (0.2, 0.5), (0.5, 1.0)], start=1)
    orders = [GoTo(n, 10.0, 0.0, *it) for n, it in speeds_and_radii]
    sent = played(port, *((0, it) for it in orders))
    assert [it for it in sent if isinstance(it, GoTo)] == orders
    assert port.dropped["speed or victory radius of a go-to: the aPad uses its own"] == counted


def test_a_single_amussel_may_be_docked_visually() -> None:
    port = DockingPort(replace(VIRTUAL, camera_ids=(9,), visual_ids=(8,)), capabilities=OF_B)
    for agent_id in (8, 9):
        assert isinstance(played(port, dock(0, agent_id, 2, agent_id))[-1], CloseDock)
        played(port, CommandFailed(0, agent_id - 7, "?"))
    assert played(port, dock(0, 7, 2, 7)) == []


@pytest.mark.parametrize(
    ("distance_m", "told"),
    [
        (0.5, [CloseDock(1, 2, 9)]),
        (0.51, [NothingCaught(0, 4)]),
        (math.inf, [NothingCaught(0, 4)]),
        (None, [CloseDock(1, 2, 9)]),
    ],
)
def test_a_virtual_docking_catches_what_floats_within_its_radius(distance_m, told):
    port = DockingPort(replace(VIRTUAL, catch_radius_m=0.5), distance_m=lambda *place: distance_m)
    assert played(port, pose(0, 1.0, 2.0), dock(0), 15_000) == told and port.first_failure is None
