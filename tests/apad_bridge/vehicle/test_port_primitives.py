"""The port with a vehicle that the test plays: profiles, pre-emption, time-outs, stalls, wrong and late reports."""

from __future__ import annotations

import math
from dataclasses import replace

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


def test_a_go_to_succeeds_when_its_own_arrival_is_heard():
    port = DockingPort(VIRTUAL)
    assert port.receive(GO, 0) == [GoTo(1, 10.0, 0.0, 0.5, 0.5)]
    assert port.receive(Arrived(900, 99), 1000) == []
    assert port.receive(Arrived(2000, 1), 2000) == [PrimitiveSucceeded(2000, 1)]
    assert port.next_due_ms is None
    assert port.dropped == {"arrived: not of the running primitive": 1}


def test_a_go_to_that_the_vehicle_gives_up_fails_with_its_reason():
    port = DockingPort(VIRTUAL)
    port.receive(GO, 0)
    assert port.receive(CommandFailed(70, 1, "no GPS"), 100) == [PrimitiveFailed(100, 1, "no GPS")]


def test_virtual_docking_waits_then_closes_and_hears():
    port = DockingPort(VIRTUAL)
    assert port.receive(CloseDock(4, 2, 9), 1000) == []
    assert port.next_due_ms == 16_000
    assert port.advance(15_999) == []
    assert port.advance(16_000) == [CloseDock(1, 2, 9)]
    assert port.receive(DockClosed(16_010, 2, 9), 17_000) == [
        DockChanged(16_010, 2, 9, True, ((2, 9),)),
        PrimitiveSucceeded(17_000, 4),
    ]
    assert dict(port.docked) == {2: 9}


def test_virtual_undocking_waits_its_own_time():
    port = DockingPort(VIRTUAL)
    port.receive(DockClosed(0, 2, 9), 0)
    assert port.receive(OpenDock(5, 2, 9), 1000) == []
    assert port.advance(6000) == [OpenDock(1, 2, 9)]
    assert port.receive(DockOpened(6000, 2, 9), 6000) == [
        DockChanged(6000, 2, 9, False, ()),
        PrimitiveSucceeded(6000, 5),
    ]
    assert dict(port.docked) == {}


def test_visual_docking_adds_no_time():
    port = DockingPort(VISUAL)
    assert port.receive(CloseDock(4, 2, 9), 1000) == [CloseDock(1, 2, 9)]
    assert port.receive(DockClosed(42_000, 2, 9), 42_000)[-1] == PrimitiveSucceeded(42_000, 4)
    assert port.receive(OpenDock(5, 2, 9), 50_000) == [OpenDock(2, 2, 9)]


def test_the_vehicles_report_of_the_dock_wins():
    port = DockingPort(VISUAL)
    port.receive(CloseDock(4, 2, 9), 0)
    assert port.receive(DockClosed(10, 0, 9), 10) == [
        DockChanged(10, 0, 9, True, ((0, 9),)),
        PrimitiveSucceeded(10, 4),
    ]
    assert port.receive(OpenDock(5, 2, 9), 20) == [OpenDock(2, 0, 9)]


def test_an_aMussel_that_is_held_already_is_not_asked_for_twice():
    port = DockingPort(VIRTUAL)
    port.receive(DockClosed(0, 3, 9), 0)
    assert port.receive(CloseDock(4, 2, 9), 1000) == [PrimitiveSucceeded(1000, 4)]


def test_docked_by_hand_while_the_port_still_waits():
    port = DockingPort(VIRTUAL)
    port.receive(CloseDock(4, 2, 9), 0)
    assert port.receive(DockClosed(3000, 1, 9), 3000) == [
        DockChanged(3000, 1, 9, True, ((1, 9),)),
        PrimitiveSucceeded(3000, 4),
    ]
    assert port.advance(100_000) == []


def test_another_aMussel_in_the_dock_is_passed_on_and_is_not_the_one_asked_for():
    port = DockingPort(VISUAL)
    port.receive(CloseDock(4, 2, 9), 0)
    assert port.receive(DockClosed(10, 2, 8), 10) == [DockChanged(10, 2, 8, True, ((2, 8),))]
    assert port.receive(DockOpened(20, 2, 9), 20) == [DockChanged(20, 2, 9, False, ((2, 8),))]
    assert port.running == CloseDock(4, 2, 9)


@pytest.mark.parametrize("docking", [VIRTUAL, VISUAL])
@pytest.mark.parametrize("primitive", [CloseDock(4, 2, 9), OpenDock(4, 2, 9)])
def test_a_silent_vehicle_ends_a_docking_at_the_time_out(docking, primitive):
    port = DockingPort(docking)
    port.receive(primitive, 1000)
    port.advance(60_999)
    [failure] = port.advance(61_000)
    assert isinstance(failure, PrimitiveFailed)
    assert (failure.at_ms, failure.primitive_id) == (61_000, 4)
    assert "within 60 s" in failure.reason
    assert port.next_due_ms is None


def test_a_late_report_after_the_time_out_still_tells_of_the_dock():
    port = DockingPort(VISUAL)
    port.receive(CloseDock(4, 2, 9), 0)
    port.advance(60_000)
    assert port.receive(DockClosed(61_000, 2, 9), 61_000) == [DockChanged(61_000, 2, 9, True, ((2, 9),))]
    assert port.receive(CommandFailed(61_001, 1, "?"), 61_001) == []
    assert port.dropped == {"command_failed: not of the running primitive": 1}


def test_a_refused_mechanism_fails_with_the_vehicles_reason():
    port = DockingPort(VISUAL)
    port.receive(CloseDock(4, 2, 9), 0)
    assert port.receive(CommandFailed(5, 1, "dock 2 holds aMussel 3"), 5) == [
        PrimitiveFailed(5, 4, "dock 2 holds aMussel 3")
    ]


def test_a_vehicle_that_does_not_accept_a_go_to_stalls_it():
    port = DockingPort(VIRTUAL, stall_s=20)
    port.receive(GO, 1000)
    [failure] = port.advance(21_000)
    assert isinstance(failure, PrimitiveFailed)
    assert (failure.at_ms, "did not accept" in failure.reason) == (21_000, True)


def test_a_silent_vehicle_stalls_a_go_to_from_its_acceptance_on():
    port = DockingPort(VIRTUAL, stall_s=20)
    port.receive(GO, 1000)
    port.receive(CommandAccepted(3000, 7), 3000)  # of another order
    port.receive(CommandAccepted(5000, 1), 5000)
    assert port.advance(24_999) == []
    [failure] = port.advance(25_000)
    assert isinstance(failure, PrimitiveFailed)
    assert (failure.at_ms, "no pose" in failure.reason) == (25_000, True)


def test_a_vehicle_that_gets_no_nearer_stalls_and_is_told_to_hold_where_it_is():
    port = DockingPort(VIRTUAL, stall_s=20)
    port.receive(pose(0, 0.0), 0)
    port.receive(GO, 0)
    port.receive(CommandAccepted(0, 1), 0)
    port.receive(pose(10_000, 0.4), 10_000)  # 0.4 m: too little to count
    port.receive(pose(19_000, 0.5), 19_000)  # 0.5 m since the start: counts
    port.receive(pose(30_000, 0.9), 30_000)
    assert port.advance(38_999) == []
    failure, hold = port.advance(39_000)
    assert isinstance(failure, PrimitiveFailed)
    assert "9.5 m to go" in failure.reason
    assert hold == Hold(2, 0.9, 0.0)


def test_a_vehicle_that_falls_silent_on_the_way_is_told_apart_from_one_that_is_stuck():
    port = DockingPort(VIRTUAL, stall_s=20)
    port.receive(GO, 0)
    port.receive(CommandAccepted(0, 1), 0)
    port.receive(pose(3000, 1.5), 3000)
    failure, _hold = port.advance(23_000)
    assert isinstance(failure, PrimitiveFailed)
    assert "no pose" in failure.reason


def test_slow_and_steady_never_stalls():
    port = DockingPort(VIRTUAL, stall_s=20)
    port.receive(GO, 0)
    for second in range(0, 330):
        assert port.receive(pose(second * 1000, second * 0.03), second * 1000) == []


def test_a_dock_on_the_way_pre_empts_the_go_to_and_holds_where_it_is():
    port = DockingPort(VIRTUAL)
    port.receive(GO, 0)
    port.receive(pose(500, 1.5, 0.5), 500)
    assert port.receive(CloseDock(2, 0, 9), 1000) == [
        PrimitiveFailed(1000, 1, "pre-empted"),
        Hold(2, 1.5, 0.5),
    ]
    assert port.receive(Arrived(1500, 1), 1500) == []


def test_without_a_pose_there_is_nowhere_to_hold_and_that_is_counted():
    port = DockingPort(VIRTUAL)
    port.receive(GO, 0)
    assert port.receive(CloseDock(2, 0, 9), 1000) == [PrimitiveFailed(1000, 1, "pre-empted")]
    assert port.dropped == {"hold: the vehicle never sent a pose": 1}


def test_a_go_to_pre_empts_a_dock_that_still_waits():
    port = DockingPort(VIRTUAL)
    port.receive(CloseDock(2, 0, 9), 0)
    assert port.receive(GO, 14_999) == [
        PrimitiveFailed(14_999, 2, "pre-empted"),
        GoTo(1, 10.0, 0.0, 0.5, 0.5),
    ]


@pytest.mark.parametrize("closed", [True, False])
def test_a_dock_whose_mechanism_was_commanded_is_waited_for(closed):
    port = DockingPort(VIRTUAL)
    port.receive(CloseDock(2, 0, 9), 0)
    port.advance(15_000)
    assert port.receive(replace(GO, command_id=7), 15_001) == []
    assert port.receive(replace(GO, command_id=8), 15_002) == [PrimitiveFailed(15_002, 7, "pre-empted")]
    go = GoTo(2, 10.0, 0.0, 0.5, 0.5)
    if closed:
        assert port.receive(DockClosed(16_000, 0, 9), 16_000)[1:] == [PrimitiveSucceeded(16_000, 2), go]
    else:
        failure, then = port.advance(60_000)
        assert (failure.primitive_id, then) == (2, go)
    assert port.running == replace(GO, command_id=8)


def test_a_hold_lasts_until_it_is_replaced_and_has_then_succeeded():
    port = DockingPort(VIRTUAL)
    assert port.receive(Hold(3, 1.0, 2.0), 0) == [Hold(1, 1.0, 2.0)]
    assert port.next_due_ms is None
    assert port.advance(10_000_000) == []
    assert port.receive(GO, 10_000_000)[0] == PrimitiveSucceeded(10_000_000, 3)


def test_the_first_cause_of_a_run_of_failures_is_kept_until_something_succeeds():
    port = DockingPort(VISUAL)
    assert port.first_failure is None
    port.receive(GO, 0)
    port.receive(replace(GO, command_id=2), 1)  # a pre-emption is no failure
    assert port.first_failure is None
    port.receive(CommandFailed(2, 2, "no GPS"), 2)
    port.receive(CloseDock(3, 0, 9), 3)
    port.advance(100_000)
    assert port.first_failure == PrimitiveFailed(2, 2, "no GPS")
    port.receive(Hold(5, 0.0, 0.0), 100_000)
    port.receive(replace(GO, command_id=4), 100_000)
    assert port.first_failure == PrimitiveFailed(2, 2, "no GPS")  # a hold does not clear the cause
    port.receive(Arrived(100_001, 5), 100_001)
    assert port.first_failure is None


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
def test_a_report_that_makes_no_sense_is_dropped_and_counted(fact, reason):
    port = DockingPort(VISUAL)
    port.receive(CloseDock(2, 0, 9), 0)
    assert port.receive(fact, 10) == []
    assert (port.dropped, port.running) == ({reason: 1}, CloseDock(2, 0, 9))


def test_battery_reports_are_none_of_its_business():
    port = DockingPort(VISUAL)
    assert port.receive(BatteryReported(0, 12.0, 0.4), 0) == []
    assert not port.dropped


def test_a_port_that_follows_another_numbers_its_commands_beyond_the_others():
    port = DockingPort(VIRTUAL, first_command_id=1001)
    assert port.receive(GO, 0) == [GoTo(1001, 10.0, 0.0, 0.5, 0.5)]
    assert port.receive(Arrived(5, 1), 5) == []


def test_time_going_back_and_a_stall_time_of_nothing_are_refused():
    port = DockingPort(VIRTUAL)
    port.advance(10)
    with pytest.raises(ValueError, match="back"):
        port.advance(9)
    with pytest.raises(ValueError, match="stall_s"):
        DockingPort(VIRTUAL, stall_s=0)


def test_a_mechanism_that_misses_is_tried_again_and_its_first_cause_told() -> None:
    port = DockingPort(replace(VIRTUAL, attempts=3))
    port.receive(CloseDock(1, 2, 9), 0)
    for attempt in (1, 2, 3):
        assert port.advance(attempt * 15_000 - 1) == []
        assert port.advance(attempt * 15_000) == [CloseDock(attempt, 2, 9)]
        told = port.receive(CommandFailed(attempt * 15_000, attempt, f"miss {attempt}"), attempt * 15_000)
        assert told == ([] if attempt < 3 else [PrimitiveFailed(45_000, 1, "miss 1")])
    assert port.first_failure == PrimitiveFailed(45_000, 1, "miss 1")
    assert port.dropped == {f"a dock was tried again: miss {attempt}": 1 for attempt in (1, 2)}


def test_one_that_holds_at_the_second_try_has_succeeded() -> None:
    port = DockingPort(replace(VIRTUAL, attempts=2))
    port.receive(CloseDock(1, 2, 9), 0)
    port.advance(15_000)
    port.receive(CommandFailed(15_000, 1, "missed"), 15_000)
    port.advance(30_000)
    assert PrimitiveSucceeded(30_000, 1) in port.receive(DockClosed(30_000, 2, 9), 30_000)
    assert port.first_failure is None


def test_what_waits_behind_a_mechanism_is_not_kept_waiting_by_another_try() -> None:
    port = DockingPort(replace(VIRTUAL, attempts=3))
    port.receive(CloseDock(1, 2, 9), 0)
    port.advance(15_000)
    port.receive(Hold(2, 0.0, 0.0), 16_000)
    told = port.receive(CommandFailed(17_000, 1, "missed"), 17_000)
    assert PrimitiveFailed(17_000, 1, "missed") in told and port.running == Hold(2, 0.0, 0.0)


def test_a_virtual_docking_may_open_the_arm_meanwhile() -> None:
    port = DockingPort(replace(VIRTUAL, arm=ArmUse.MOVED), capabilities=OF_B)
    assert port.receive(CloseDock(1, 2, 9), 0) == [MoveArm(1, 2, True)]
    assert port.advance(15_000) == [CloseDock(2, 2, 9)]
    told = port.receive(DockClosed(15_000, 2, 9), 15_000)
    assert told[1:] == [PrimitiveSucceeded(15_000, 1), MoveArm(3, 2, False)]


def test_a_vehicle_without_an_order_for_its_arms_is_given_none() -> None:
    port = DockingPort(replace(VIRTUAL, arm=ArmUse.MOVED))
    assert port.receive(CloseDock(1, 2, 9), 0) == []
    assert port.advance(15_000) == [CloseDock(1, 2, 9)]


@pytest.mark.parametrize(("stack", "counted"), [(Generation.A, 2), (Generation.B, 0)])
def test_a_speed_or_radius_that_a_stack_cannot_be_told_is_counted(stack: Generation, counted: int) -> None:
    port = DockingPort(VIRTUAL, capabilities=stack_of(stack).capabilities(4), usual_go_to=(0.5, 0.5))
    for n, (speed_m_s, radius_m) in enumerate([(0.5, 0.5), (0.2, 0.5), (0.5, 1.0)], start=1):
        assert port.receive(GoTo(n, 10.0, 0.0, speed_m_s, radius_m), 0)[-1] == GoTo(
            n, 10.0, 0.0, speed_m_s, radius_m
        )
    assert port.dropped["speed or victory radius of a go-to: the aPad uses its own"] == counted


@pytest.mark.parametrize("docks", [1, 4, 6])
def test_a_report_of_a_dock_that_the_vehicle_has_not_is_dropped(docks: int) -> None:
    port = DockingPort(VIRTUAL, capabilities=of_simulated_apad(docks))
    assert port.receive(DockClosed(0, docks - 1, 9), 0) == [
        DockChanged(0, docks - 1, 9, True, ((docks - 1, 9),))
    ]
    assert port.receive(DockClosed(0, docks, 8), 0) == []
    assert port.dropped == {"dock: no such dock": 1}


def test_a_single_amussel_may_be_docked_visually() -> None:
    port = DockingPort(replace(VIRTUAL, camera_ids=(9,), visual_ids=(8,)), capabilities=OF_B)
    for agent_id in (8, 9):
        assert isinstance(port.receive(CloseDock(agent_id, 2, agent_id), 0)[-1], CloseDock)
        port.receive(CommandFailed(0, agent_id - 7, "?"), 0)
    assert port.receive(CloseDock(7, 2, 7), 0) == []


def test_for_a_vehicle_without_a_camera_the_camera_profile_is_virtual() -> None:
    port = DockingPort(replace(VIRTUAL, camera_ids=(9,)))
    assert port.receive(CloseDock(1, 2, 9), 0) == []
    assert port.advance(15_000) == [CloseDock(1, 2, 9)]


@pytest.mark.parametrize(
    ("distance_m", "caught"), [(0.5, True), (0.51, False), (math.inf, False), (None, True)]
)
def test_a_virtual_docking_catches_what_floats_within_its_radius(distance_m, caught):
    port = DockingPort(replace(VIRTUAL, catch_radius_m=0.5), distance_m=lambda *place: distance_m)
    port.receive(PoseReported(0, 1.0, 2.0, 0.0), 0)
    if caught:
        assert port.receive(CloseDock(1, 0, 7), 0) == []
        assert port.advance(15_000) == [CloseDock(1, 0, 7)]
    else:
        assert port.receive(CloseDock(1, 0, 7), 0) == [NothingCaught(0, 1)]
        assert (port.running, port.first_failure) == (None, None)


def test_a_vehicle_that_docks_by_its_own_eyes_is_not_asked_what_the_radius_holds():
    port = DockingPort(VISUAL, capabilities=OF_B, distance_m=lambda *place: math.inf)
    port.receive(PoseReported(0, 1.0, 2.0, 0.0), 0)
    assert port.receive(CloseDock(1, 0, 7), 0) == [CloseDock(1, 0, 7)]


def test_what_drifted_away_after_a_miss_is_not_caught_by_the_next_try():
    distances_m = iter([0.0, 2.0])
    port = DockingPort(replace(VIRTUAL, attempts=2), distance_m=lambda *place: next(distances_m))
    port.receive(PoseReported(0, 1.0, 2.0, 0.0), 0)
    port.receive(CloseDock(1, 0, 7), 0)
    port.advance(15_000)
    assert port.receive(CommandFailed(15_000, 1, "missed"), 15_000) == [NothingCaught(15_000, 1)]
