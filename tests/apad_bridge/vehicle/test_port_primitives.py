"""The port with a vehicle that the test plays: profiles, pre-emption, time-outs, stalls, wrong and late reports."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from apad_bridge.assembly.stacks import stack_of
from apad_bridge.scenario.blocks.mission_options import ArmUse, Docking, DockingProfile
from apad_bridge.scenario.choices import Generation
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


CLOSE = CloseDock(1, 2, 9)
"""The first command of `dock`."""
ACCEPTED = CommandAccepted(0, 1)
SILENT = "the vehicle did not answer within 60 s"
SECOND, THIRD = replace(GO, command_id=7), replace(GO, command_id=8)
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
    "a go-to succeeds when its own arrival is heard": (
        partial(DockingPort, VIRTUAL),
        [(0, GO), Arrived(900, 99), Arrived(2000, 1)],
        [GO, PrimitiveSucceeded(2000, 1)],
        {"arrived: not of the running primitive": 1},
    ),
    "a virtual docking waits": (partial(DockingPort, VIRTUAL), [dock(1000), 15_999], [], {}),
    "a virtual docking then closes and hears": (
        partial(DockingPort, VIRTUAL),
        [dock(1000), 15_999, 16_000, DockClosed(16_010, 2, 9)],
        [CLOSE, DockChanged(16_010, 2, 9, True, ((2, 9),)), PrimitiveSucceeded(16_010, 4)],
        {},
    ),
    "a virtual undocking waits its own time": (
        partial(DockingPort, VIRTUAL),
        [DockClosed(0, 2, 9), (1000, OpenDock(5, 2, 9)), 5999],
        [DockChanged(0, 2, 9, True, ((2, 9),))],
        {},
    ),
    "a virtual undocking then opens and hears": (
        partial(DockingPort, VIRTUAL),
        [DockClosed(0, 2, 9), (1000, OpenDock(5, 2, 9)), 5999, 6000, DockOpened(6000, 2, 9)],
        [
            DockChanged(0, 2, 9, True, ((2, 9),)),
            OpenDock(1, 2, 9),
            DockChanged(6000, 2, 9, False, ()),
            PrimitiveSucceeded(6000, 5),
        ],
        {},
    ),
    "visual docking adds no time": (
        partial(DockingPort, VISUAL),
        [dock(1000), DockClosed(42_000, 2, 9), (50_000, OpenDock(5, 2, 9))],
        [
            CLOSE,
            DockChanged(42_000, 2, 9, True, ((2, 9),)),
            PrimitiveSucceeded(42_000, 4),
            OpenDock(2, 2, 9),
        ],
        {},
    ),
    "another aMussel in the dock is passed on, and is not the one asked for": (
        partial(DockingPort, VISUAL),
        [dock(0), DockClosed(10, 2, 8), DockOpened(20, 2, 9)],
        [CLOSE, DockChanged(10, 2, 8, True, ((2, 8),)), DockChanged(20, 2, 9, False, ((2, 8),))],
        {},
    ),
    **{
        f"a silent vehicle ends a {name} docking by {type(order).__name__} at the time-out": (
            partial(DockingPort, docking),
            [(1000, order), *[16_000] * (docking is VIRTUAL), 60_999, 61_000],
            [replace(order, command_id=1), PrimitiveFailed(61_000, 4, SILENT)],
            {},
        )
        for name, docking in {"virtual": VIRTUAL, "visual": VISUAL}.items()
        for order in (CloseDock(4, 2, 9), OpenDock(4, 2, 9))
    },
    "a vehicle that does not accept a go-to stalls after 20 s": (
        partial(DockingPort, VIRTUAL, stall_s=20),
        [(1000, GO), 20_999, 21_000],
        [GO, PrimitiveFailed(21_000, 1, "stalled: the vehicle did not accept the go-to within 20 s")],
        {"hold: the vehicle never sent a pose": 1},
    ),
    "one that falls silent stalls 20 s after its acceptance, and not after another order's": (
        partial(DockingPort, VIRTUAL, stall_s=20),
        [(1000, GO), CommandAccepted(3000, 7), CommandAccepted(5000, 1), 24_999, 25_000],
        [GO, PrimitiveFailed(25_000, 1, "stalled: the vehicle sent no pose for 20 s")],
        {"hold: the vehicle never sent a pose": 1},
    ),
    "one that falls silent on the way is told apart from one that is stuck": (
        partial(DockingPort, VIRTUAL, stall_s=20),
        [(0, GO), ACCEPTED, pose(3000, 1.5), 22_999, 23_000],
        [GO, PrimitiveFailed(23_000, 1, "stalled: the vehicle sent no pose for 20 s"), Hold(2, 1.5, 0.0)],
        {},
    ),
    # 0.4 m are too little to count; 0.5 m since the start count.
    "a vehicle that gets no nearer stalls and is told to hold where it is": (
        partial(DockingPort, VIRTUAL, stall_s=20),
        [
            pose(0, 0.0),
            (0, GO),
            ACCEPTED,
            pose(10_000, 0.4),
            pose(19_000, 0.5),
            pose(30_000, 0.9),
            38_999,
            39_000,
        ],
        [
            GO,
            PrimitiveFailed(39_000, 1, "stalled: not 0.5 m nearer within 20 s, 9.5 m to go"),
            Hold(2, 0.9, 0.0),
        ],
        {},
    ),
    **{
        f"a dock whose mechanism was commanded is waited for: {name}": (
            partial(DockingPort, VIRTUAL),
            [dock(0), 15_000, (15_001, SECOND), (15_002, THIRD), end],
            [CLOSE, PrimitiveFailed(15_002, 7, "pre-empted"), *told, replace(GO, command_id=2)],
            {},
        )
        for name, end, told in [
            (
                "it closes",
                DockClosed(16_000, 0, 9),
                [DockChanged(16_000, 0, 9, True, ((0, 9),)), PrimitiveSucceeded(16_000, 4)],
            ),
            ("it does not", 60_000, [PrimitiveFailed(60_000, 4, SILENT)]),
        ]
    },
    "a hold lasts until it is replaced, and has then succeeded": (
        partial(DockingPort, VIRTUAL),
        [(0, Hold(3, 1.0, 2.0)), 10_000_000, (10_000_000, GO)],
        [Hold(1, 1.0, 2.0), PrimitiveSucceeded(10_000_000, 3), replace(GO, command_id=2)],
        {},
    ),
    **{
        f"a report that makes no sense is dropped and counted: {fact}": (
            partial(DockingPort, VISUAL),
            [dock(0), fact],
            [CLOSE],
            {reason: 1},
        )
        for fact, reason in [
            (pose(10, math.nan), "pose: north_m is outside -50000 to 50000"),
            (DockClosed(10, 4, 1), "dock: no such dock"),
            (DockOpened(10, -1, 1), "dock: no such dock"),
            (Arrived(10, 1), "arrived: while acting"),
            (CommandFailed(10, 0, "?"), "command_failed: not of the running primitive"),
        ]
    },
    "a mechanism that misses is tried again, and its first cause told": (
        partial(DockingPort, replace(VIRTUAL, attempts=3)),
        [
            dock(0),
            *(
                step
                for n in (1, 2, 3)
                for step in (n * 15_000 - 1, n * 15_000, CommandFailed(n * 15_000, n, f"miss {n}"))
            ),
        ],
        [*(CloseDock(n, 2, 9) for n in (1, 2, 3)), PrimitiveFailed(45_000, 4, "miss 1")],
        {f"a dock was tried again: miss {n}": 1 for n in (1, 2)},
    ),
    "one that holds at the second try has succeeded": (
        partial(DockingPort, replace(VIRTUAL, attempts=2)),
        [dock(0), 15_000, CommandFailed(15_000, 1, "missed"), 30_000, DockClosed(30_000, 2, 9)],
        [
            CLOSE,
            CloseDock(2, 2, 9),
            DockChanged(30_000, 2, 9, True, ((2, 9),)),
            PrimitiveSucceeded(30_000, 4),
        ],
        {"a dock was tried again: missed": 1},
    ),
    "what waits behind a mechanism is not kept waiting by another try": (
        partial(DockingPort, replace(VIRTUAL, attempts=3)),
        [dock(0), 15_000, (16_000, Hold(2, 0.0, 0.0)), CommandFailed(17_000, 1, "missed")],
        [CLOSE, PrimitiveFailed(17_000, 4, "missed"), Hold(2, 0.0, 0.0)],
        {},
    ),
    "a virtual docking may open the arm meanwhile": (
        partial(DockingPort, replace(VIRTUAL, arm=ArmUse.MOVED), capabilities=OF_B),
        [dock(0), 15_000, DockClosed(15_000, 2, 9)],
        [
            MoveArm(1, 2, True),
            CloseDock(2, 2, 9),
            DockChanged(15_000, 2, 9, True, ((2, 9),)),
            PrimitiveSucceeded(15_000, 4),
            MoveArm(3, 2, False),
        ],
        {},
    ),
    "a single aMussel may be docked visually": (
        partial(DockingPort, replace(VIRTUAL, camera_ids=(9,), visual_ids=(8,)), capabilities=OF_B),
        [
            dock(0, 8, 2, 8),
            CommandFailed(0, 1, "?"),
            dock(0, 9, 2, 9),
            CommandFailed(0, 2, "?"),
            dock(0, 7, 2, 7),
        ],
        [
            CloseDock(1, 2, 8),
            PrimitiveFailed(0, 8, "?"),
            CloseDock(2, 2, 9),
            PrimitiveFailed(0, 9, "?"),
        ],
        {},
    ),
    **{
        f"a virtual docking with the aMussel {distance_m} m off and a radius of 0.5 m": (
            partial(
                DockingPort,
                replace(VIRTUAL, catch_radius_m=0.5),
                distance_m=partial(lambda it, *_: it, distance_m),
            ),
            [pose(0, 1.0, 2.0), dock(0), 15_000],
            [told],
            {},
        )
        for distance_m, told in [
            (0.5, CLOSE),
            (0.51, NothingCaught(0, 4)),
            (math.inf, NothingCaught(0, 4)),
            (None, CLOSE),
        ]
    },
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
    # What the port says of itself agrees with what it told: the docks, what runs, and the first failure.
    docks = next((it.docked for it in reversed(told) if isinstance(it, DockChanged)), ())
    ends = [it for it in told if isinstance(it, PrimitiveSucceeded | PrimitiveFailed | NothingCaught)]
    given = [it[1].command_id for it in story if isinstance(it, tuple)]
    left = [it for it in given if it not in {end.primitive_id for end in ends}]
    running = None if port.running is None else port.running.command_id
    assert (port.docked, running) == (docks, left[-1] if left else None)
    assert left or port.next_due_ms is None
    failed = [it for it in ends if isinstance(it, PrimitiveFailed) and it.reason != "pre-empted"]
    has_succeeded = any(isinstance(it, PrimitiveSucceeded) for it in ends)
    assert has_succeeded or port.first_failure == (failed[0] if failed else None)


def test_a_virtual_docking_is_due_after_its_time(port):
    played(port, dock(1000))
    assert port.next_due_ms == 16_000


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


def test_time_going_back_and_a_stall_time_of_nothing_are_refused(port):
    port.advance(10)
    with pytest.raises(ValueError, match="back"):
        port.advance(9)
    with pytest.raises(ValueError, match="stall_s"):
        DockingPort(VIRTUAL, stall_s=0)


@pytest.mark.parametrize(("stack", "counted"), [(Generation.A, 2), (Generation.B, 0)])
def test_a_speed_or_radius_that_a_stack_cannot_be_told_is_counted(stack: Generation, counted: int) -> None:
    port = DockingPort(VIRTUAL, capabilities=stack_of(stack).capabilities(4), usual_go_to=(0.5, 0.5))
    speeds_and_radii = enumerate([(0.5, 0.5), (0.2, 0.5), (0.5, 1.0)], start=1)
    orders = [GoTo(n, 10.0, 0.0, *it) for n, it in speeds_and_radii]
    sent = played(port, *((0, it) for it in orders))
    assert [it for it in sent if isinstance(it, GoTo)] == orders
    assert port.dropped["speed or victory radius of a go-to: the aPad uses its own"] == counted
