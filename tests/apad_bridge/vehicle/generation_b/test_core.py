"""The facts, orders and failures that the docking port gets from a generation B aPad, its silences included."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest
from stack_benches import cleared

from apad_bridge.scenario.schema import Docking, DockingProfile, Servo
from apad_bridge.vehicle.commands import (
    Arrived,
    BatteryReported,
    CloseDock,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    DockClosed,
    DockOpened,
    GoalOfOthers,
    GoTo,
    Hold,
    HoldWanted,
    OpenDock,
    PilotLeft,
    PilotReported,
    PoseReported,
)
from apad_bridge.vehicle.generation_b.core import GenerationBCore
from apad_bridge.vehicle.generation_b.messages import (
    ArmReceived,
    DockingOrder,
    ManualReceived,
    PrimitiveStatus,
    ServiceAnswered,
    ServiceOrder,
    StatusReceived,
)
from apad_bridge.vehicle.generation_b.tasks import PILOT, REPLACED
from apad_bridge.vehicle.link import Carried, LetGo, LinkFact
from apad_bridge.vehicle.stack_messages import PoseReceived
from apad_bridge.world.apad.docks import MISSED, Misses
from apad_bridge.world.generation_b.docks import BenchDocks

THERE = GoTo(1, 5.0, 6.0, 0.5, 0.5)
SERVO = Servo(
    search_yaw_rate_rad_s=0.3, max_yaw_rate_rad_s=0.4, max_surge_m_s=0.2, surge_stdev=0.25, search_s=90
)
DOCKING = Docking(
    profile=DockingProfile.VIRTUAL,
    camera_ids=(8,),
    visual_ids=(20,),
    dock_s=15,
    undock_s=5,
    timeout_s=200,
    servo=SERVO,
)
BY_EYE = DockingOrder(True, 2, 0.3, 0.4, 0.2, 0.25)


class Apad:
    """A core, with methods for a vehicle's messages."""

    def __init__(
        self,
        floating: Mapping[int, tuple[float, float]] | None = None,
        probability: float = 0.0,
        *,
        takes_back: bool = True,
    ) -> None:
        places, misses = floating or {}, Misses(1, probability)
        docks = BenchDocks(range(1, 10), misses, lambda _: places)
        self.core = GenerationBCore(docks, (10.5, 16.0), DOCKING, takes_back=takes_back)
        self.is_at(0, 2.0, 3.0)

    def is_at(self, at_ms: int, north_m: float, east_m: float, heading_rad: float = 0.0) -> None:
        self.core.receive(PoseReceived(at_ms, north_m, east_m, heading_rad), at_ms)

    def answers(self, at_ms: int, refused: str | None = None) -> list[ServiceOrder]:
        """Answers all orders and returns them."""
        calls = [it.order for it in self.core.take_calls()]
        for call in calls:
            self.core.receive(ServiceAnswered(at_ms, call.number, refused), at_ms)
        return [call.order for call in calls]

    def goes(self, at_ms: int, status: PrimitiveStatus) -> None:
        self.core.receive(StatusReceived(at_ms, False, status), at_ms)

    def docks(self, at_ms: int, status: PrimitiveStatus) -> None:
        self.core.receive(StatusReceived(at_ms, True, status), at_ms)

    def tells(self, now_ms: int) -> list[LinkFact]:
        """The new facts, without readings of pose and battery, acceptances, and places that only moved.

        A hold that the core asks for is ordered, as the gate's owner does.
        """
        readings = PoseReported | BatteryReported | CommandAccepted | Carried | HoldWanted
        facts = self.core.advance(now_ms)
        for it in facts:
            if isinstance(it, HoldWanted):
                self.core.command(cleared(Hold(-1, it.north_m, it.east_m, it.heading_rad)), now_ms)
        return [it for it in facts if not isinstance(it, readings)]


def test_a_go_to_arrives_by_its_status_and_is_then_held() -> None:
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    assert apad.answers(0) == [GoTo(0, 5.0, 6.0, 0.5, 0.5)]
    apad.goes(0, PrimitiveStatus.RUNNING)
    assert apad.tells(1_000) == []
    apad.is_at(9_000, 4.8, 6.0)
    apad.goes(9_000, PrimitiveStatus.DONE)
    assert apad.tells(9_000) == [Arrived(9_000, 1)]
    # A primitive's end leaves the controllers off.
    assert apad.answers(9_000) == [Hold(0, 5.0, 6.0)]


@pytest.mark.parametrize("command", [THERE, Hold(1, 5.0, 6.0)])
def test_an_order_is_accepted_by_its_service_s_answer(command: GoTo | Hold) -> None:
    apad = Apad()
    apad.core.advance(0)
    apad.core.command(cleared(command), 0)
    assert apad.core.advance(2_000) == []
    apad.answers(2_000)
    assert apad.core.advance(3_000) == [CommandAccepted(2_000, 1)]


def test_a_hold_is_astray_by_its_acceptance_and_not_by_its_order() -> None:
    apad = Apad()
    apad.core.command(cleared(Hold(1, 20.0, 20.0)), 0)
    apad.tells(4_000)
    assert apad.answers(4_000) == [Hold(0, 20.0, 20.0)]
    for now_ms, orders in ((13_000, []), (14_000, [Hold(0, 20.0, 20.0)])):
        apad.is_at(now_ms, 2.0, 3.0)
        apad.tells(now_ms)
        assert apad.answers(now_ms) == orders


def test_the_end_of_the_go_to_before_is_not_the_end_of_this_one() -> None:
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    apad.goes(0, PrimitiveStatus.RUNNING)
    apad.core.command(cleared(GoTo(2, -5.0, -6.0, 0.5, 0.5)), 1_000)
    apad.goes(1_000, PrimitiveStatus.RUNNING)
    apad.goes(1_000, PrimitiveStatus.PREEMPTED)
    apad.answers(1_000)
    apad.goes(1_000, PrimitiveStatus.PREEMPTED)
    assert apad.tells(2_000) == []
    apad.goes(2_000, PrimitiveStatus.RUNNING)
    assert apad.tells(10_000) == []
    apad.is_at(30_000, -5.0, -6.0)
    apad.goes(30_000, PrimitiveStatus.DONE)
    assert apad.tells(30_000) == [Arrived(30_000, 2)]


def test_a_go_to_that_was_so_short_that_nobody_saw_it_run_has_arrived() -> None:
    apad = Apad()
    apad.core.command(cleared(GoTo(1, 2.1, 3.0, 0.5, 0.5)), 0)
    apad.answers(0)
    apad.goes(1_000, PrimitiveStatus.DONE)
    assert apad.tells(1_000) == [Arrived(1_000, 1)]


def test_a_go_to_that_the_vehicle_drops_fails_after_three_seconds() -> None:
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    apad.goes(0, PrimitiveStatus.RUNNING)
    apad.goes(2_000, PrimitiveStatus.PREEMPTED)
    assert apad.tells(4_999) == []
    assert apad.tells(5_000) == [
        CommandFailed(5_000, 1, "the aPad ended the go-to by itself: its status says PREEMPTED")
    ]
    assert apad.answers(5_000) == [Hold(0, 2.0, 3.0)]


def test_a_go_to_said_to_be_done_far_from_its_goal_has_failed() -> None:
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    apad.goes(0, PrimitiveStatus.RUNNING)
    apad.goes(2_000, PrimitiveStatus.DONE)
    (failed,) = apad.tells(2_000)
    assert failed == CommandFailed(2_000, 1, "the aPad reports an arrival, 4.2 m from the goal")


def test_without_any_message_on_goto_status_the_position_decides() -> None:
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    for at_ms in range(10_000, 14_000, 1_000):
        apad.is_at(at_ms, 5.1, 6.0)
        told = apad.tells(at_ms)
        assert told == ([Arrived(13_000, 1)] if at_ms == 13_000 else [])
    assert apad.core.dropped == {"goto_status was silent: arrival by position": 1}


def test_a_service_that_refuses_is_asked_three_times_and_the_first_cause_kept() -> None:
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    apad.answers(0, "first")
    seconds = []
    for now_ms in range(0, 6_000, 1_000):
        if told := apad.tells(now_ms):
            seconds.append((now_ms, told))
        apad.answers(now_ms, "later")
    assert seconds == [(3_000, [CommandFailed(3_000, 1, "first")])]


def test_a_service_that_does_not_answer_fails_by_time_out() -> None:
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    told = [fact for now_ms in range(0, 30_000, 1_000) for fact in apad.tells(now_ms)]
    assert told == [CommandFailed(18_000, 1, "its service did not answer within 5 s")]


def test_a_vehicle_that_does_not_hold_is_told_again() -> None:
    apad = Apad()
    apad.core.command(cleared(Hold(1, 2.0, 3.0, 0.7)), 0)
    assert apad.answers(0) == [Hold(0, 2.0, 3.0, 0.7)]
    apad.is_at(5_000, 2.0, 7.0)
    apad.tells(9_000)
    assert apad.answers(9_000) == []
    apad.tells(10_000)
    assert apad.answers(10_000) == [Hold(0, 2.0, 3.0, 0.7)]


def holding(still_running_ms: int = 0) -> Apad:
    """A hold that was taken at 0, and a late status of the go-to that it pre-empted."""
    apad = Apad()
    apad.core.command(cleared(Hold(1, 2.0, 3.0)), 0)
    assert apad.answers(0) == [Hold(0, 2.0, 3.0)]
    apad.goes(still_running_ms, PrimitiveStatus.RUNNING)
    apad.goes(1_000, PrimitiveStatus.PREEMPTED)
    assert apad.tells(1_000) == [] and apad.answers(1_000) == []
    return apad


def test_a_go_to_of_anothers_during_a_hold_is_noticed_and_let_end() -> None:
    apad = holding()
    apad.goes(11_000, PrimitiveStatus.RUNNING)
    apad.goes(12_000, PrimitiveStatus.RUNNING)
    apad.is_at(30_000, 9.0, 3.0)
    assert apad.tells(30_000) == [] and apad.answers(30_000) == []
    assert apad.core.dropped["goto_status: another client sent the aPad away from its hold"] == 1
    apad.goes(31_000, PrimitiveStatus.DONE)
    # That go-to has ended somewhere, and the controllers are off since.
    apad.is_at(31_000, 2.5, 3.0)
    assert apad.tells(31_000) == [] and apad.answers(31_000) == [Hold(0, 2.0, 3.0)]
    # Ordered every ten seconds at most; a go-to that still runs a moment later is a late status.
    apad.goes(31_500, PrimitiveStatus.RUNNING)
    apad.goes(32_000, PrimitiveStatus.PREEMPTED)
    assert apad.tells(60_000) == [] and apad.answers(60_000) == []


def test_a_goal_that_nobody_here_ordered_is_anothers_and_ends_our_go_to() -> None:
    apad = Apad(takes_back=False)
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    apad.core.receive(GoalOfOthers(100, "/apad1/commander", THERE.north_m, THERE.east_m), 100)
    assert apad.tells(1_000) == []
    apad.core.receive(GoalOfOthers(2_000, "/apad1/commander", 80.0, 6.0), 2_000)
    assert apad.tells(2_000) == [
        CommandFailed(2_000, THERE.command_id, REPLACED),
        GoalOfOthers(2_000, "/apad1/commander", 80.0, 6.0),
        CommandedByOthers(2_000, "/apad1/commander"),
    ]
    apad.goes(3_000, PrimitiveStatus.RUNNING)
    apad.goes(9_000, PrimitiveStatus.DONE)
    assert apad.tells(9_000) == [] and apad.answers(9_000) == []


@pytest.mark.parametrize(("ran_ms", "is_anothers"), [(0, False), (500, False), (3_000, True), (40_000, True)])
def test_a_go_to_that_runs_where_ours_was_pre_empted_is_anothers(ran_ms: int, is_anothers: bool) -> None:
    """Its server shows no goal. Soon after our order, the pre-empted one was an earlier order of ours."""
    apad = Apad(takes_back=False)
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    apad.goes(100, PrimitiveStatus.RUNNING)
    apad.goes(100 + ran_ms, PrimitiveStatus.PREEMPTED)
    assert apad.tells(100 + ran_ms) == []
    apad.goes(110 + ran_ms, PrimitiveStatus.RUNNING)
    told = [CommandFailed(110 + ran_ms, THERE.command_id, REPLACED), CommandedByOthers(110 + ran_ms)]
    assert apad.tells(110 + ran_ms) == (told if is_anothers else [])
    apad.goes(9_000 + ran_ms, PrimitiveStatus.DONE)
    assert (apad.tells(9_000 + ran_ms) == []) is is_anothers


def test_an_earlier_goal_of_ours_that_is_shown_late_is_nobody_elses() -> None:
    apad = Apad(takes_back=False)
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    apad.core.command(cleared(Hold(2, 2.0, 3.0, pre_empts=True)), 1_000)
    apad.answers(1_000)
    apad.core.receive(GoalOfOthers(1_500, "/apad1/commander", THERE.north_m, THERE.east_m), 1_500)
    assert apad.tells(2_000) == []


@pytest.mark.parametrize("north_m", (math.nan, math.inf, 1e12))
def test_a_goal_at_no_place_is_counted(north_m: float) -> None:
    apad = Apad(takes_back=False)
    apad.core.receive(GoalOfOthers(1_000, "/planner", north_m, 0.0), 1_000)
    assert apad.tells(1_000) == []
    assert [it for it in apad.core.dropped if it.startswith("go2point/goal: ")]


def test_a_go_to_of_anothers_that_never_ends_holds_nothing_up_for_ever() -> None:
    apad = holding()
    apad.goes(2_000, PrimitiveStatus.RUNNING)
    apad.is_at(201_000, 2.0, 8.0)
    assert apad.tells(201_000) == [] and apad.answers(201_000) == []
    assert apad.tells(202_000) == [] and apad.answers(202_000) == [Hold(0, 2.0, 3.0)]


def test_a_go_to_of_ours_that_a_hold_pre_empts_is_nobody_elses() -> None:
    apad = holding(still_running_ms=900)
    assert apad.tells(20_000) == [] and apad.answers(20_000) == [] and not apad.core.dropped


def test_a_docking_of_anothers_during_a_hold_is_let_end_and_then_held() -> None:
    apad = holding()
    apad.docks(2_000, PrimitiveStatus.RUNNING)
    apad.is_at(40_000, 2.0, 8.0)
    assert apad.tells(40_000) == [] and apad.answers(40_000) == []
    apad.docks(41_000, PrimitiveStatus.DONE)
    apad.is_at(41_000, 2.0, 4.0)
    assert apad.tells(41_000) == [] and apad.answers(41_000) == [Hold(0, 2.0, 3.0)]


def test_a_docking_of_anothers_that_never_ends_holds_nothing_up_for_ever() -> None:
    apad = holding()
    apad.docks(2_000, PrimitiveStatus.RUNNING)
    apad.is_at(201_000, 2.0, 8.0)
    assert apad.tells(201_000) == [] and apad.answers(201_000) == []
    assert apad.tells(202_000) == [] and apad.answers(202_000) == [Hold(0, 2.0, 3.0)]


def test_a_virtual_docking_is_the_benchs_contact_and_is_carried_along() -> None:
    apad = Apad()
    apad.core.command(cleared(CloseDock(1, 1, 7)), 0)
    assert apad.core.advance(0)[:2] == [
        DockClosed(0, 1, 7),
        Carried(0, 7, pytest.approx(2.0), pytest.approx(3.4)),
    ]
    apad.is_at(1_000, 4.0, 5.0, math.pi / 2)  # facing east: dock 1, to starboard, is south
    carried = [it for it in apad.core.advance(1_000) if isinstance(it, Carried)]
    assert carried == [Carried(1_000, 7, pytest.approx(3.6), pytest.approx(5.0))]
    apad.core.command(cleared(OpenDock(2, 1, 7)), 2_000)
    assert apad.tells(2_000) == [DockOpened(2_000, 1, 7), LetGo(2_000, 7)]
    assert apad.answers(2_000) == []  # a virtual docking orders nothing of the vehicle


def test_a_docking_can_miss() -> None:
    apad = Apad(probability=1.0)
    apad.core.command(cleared(CloseDock(1, 1, 7)), 0)
    assert apad.tells(0) == [CommandFailed(0, 1, MISSED)]


def test_visual_docking_stands_off_orders_and_ends_by_its_status() -> None:
    apad = Apad()
    apad.core.command(cleared(GoTo(1, 2.0, 4.0, 0.5, 0.5)), 0)
    apad.answers(0)
    apad.goes(0, PrimitiveStatus.RUNNING)
    apad.goes(0, PrimitiveStatus.DONE)
    apad.tells(0)
    apad.answers(0)
    apad.core.command(cleared(CloseDock(2, 2, 8)), 1_000)
    (stand,) = apad.answers(1_000)
    # The aMussel is believed at (2, 4), the boat is west of it: two metres west, with dock 2, the stern, towards it.
    assert stand == Hold(0, pytest.approx(2.0), pytest.approx(2.0), pytest.approx(-math.pi / 2))
    apad.docks(1_000, PrimitiveStatus.DONE)  # of an earlier docking
    apad.is_at(5_000, 2.0, 2.1, -1.5)
    assert apad.tells(5_000) == []
    assert apad.answers(5_000) == [BY_EYE]
    apad.docks(5_000, PrimitiveStatus.RUNNING)
    assert apad.tells(60_000) == []
    apad.docks(60_000, PrimitiveStatus.DONE)
    assert apad.tells(60_000) == [DockClosed(60_000, 2, 8)]
    assert apad.answers(60_000) == [Hold(0, 2.0, 2.1)]


def test_an_undocking_lets_go_when_the_arm_opens_and_the_next_order_waits_until_the_vehicle_has_pulled_back() -> (
    None
):
    apad = Apad()
    apad.core.command(cleared(CloseDock(1, 2, 7)), 0)
    apad.tells(0)
    apad.core.receive(ArmReceived(1_000, 2), 1_000)  # moved for people to see: 7 is docked virtually
    assert apad.tells(1_000) == []
    core = Apad().core
    core.command(cleared(CloseDock(1, 2, 8)), 0)
    call = core.take_calls()[0].order
    core.receive(ServiceAnswered(0, call.number, None), 0)
    for at_ms, status in ((0, PrimitiveStatus.RUNNING), (40_000, PrimitiveStatus.DONE)):
        core.receive(StatusReceived(at_ms, True, status), at_ms)
    core.advance(40_000)
    core.take_calls()
    core.command(cleared(OpenDock(2, 2, 8)), 50_000)
    call = core.take_calls()[0].order
    core.receive(ArmReceived(50_000, 2), 50_000)
    core.receive(ServiceAnswered(50_000, call.number, None), 50_000)
    core.receive(StatusReceived(50_000, True, PrimitiveStatus.RUNNING), 50_000)
    assert core.advance(60_000) == [DockOpened(50_000, 2, 8), LetGo(50_000, 8)]
    core.command(cleared(GoTo(3, 5.0, 6.0, 0.5, 0.5)), 60_000)
    assert core.take_calls() == []  # it still pulls back
    core.receive(StatusReceived(85_000, True, PrimitiveStatus.DONE), 85_000)
    assert core.advance(85_000) == []
    assert [it.order.order for it in core.take_calls()] == [GoTo(0, 5.0, 6.0, 0.5, 0.5)]


def test_a_search_that_finds_nothing_is_given_up() -> None:
    apad = Apad()
    apad.core.command(cleared(CloseDock(1, 2, 8)), 0)
    assert apad.answers(0) == [BY_EYE]
    apad.docks(0, PrimitiveStatus.RUNNING)
    assert apad.tells(89_000) == []
    assert apad.tells(90_000) == [
        CommandFailed(90_000, 1, "the aPad's docking did not come to an end within 90 s")
    ]
    assert apad.answers(90_000) == [Hold(0, 2.0, 3.0)]


def test_a_real_amussel_takes_a_dock_and_no_simulated_one_does_then() -> None:
    apad = Apad()
    apad.core.command(cleared(CloseDock(1, 2, 20)), 0)
    apad.answers(0)
    apad.docks(0, PrimitiveStatus.RUNNING)
    apad.docks(40_000, PrimitiveStatus.DONE)
    assert apad.tells(40_000) == [DockClosed(40_000, 2, 20)]
    assert [it for it in apad.core.advance(41_000) if isinstance(it, Carried)] == []
    apad.core.command(cleared(CloseDock(2, 2, 7)), 42_000)
    assert apad.tells(42_000) == [CommandFailed(42_000, 2, "dock 3 holds aMussel 20")]


def test_a_docking_by_hand_takes_the_simulated_amussel_that_is_there() -> None:
    apad = Apad({5: (2.2, 3.5), 6: (9.0, 9.0)})
    apad.core.receive(ArmReceived(0, 1), 0)
    apad.docks(0, PrimitiveStatus.RUNNING)
    apad.docks(40_000, PrimitiveStatus.DONE)
    assert apad.tells(40_000) == [DockClosed(40_000, 1, 5)]
    apad.core.receive(ArmReceived(50_000, 1), 50_000)
    apad.docks(50_000, PrimitiveStatus.RUNNING)
    apad.docks(90_000, PrimitiveStatus.DONE)
    assert apad.tells(90_000) == [DockOpened(90_000, 1, 5), LetGo(90_000, 5)]


def test_a_docking_by_hand_far_from_all_is_counted() -> None:
    apad = Apad({6: (9.0, 9.0)})
    apad.core.receive(ArmReceived(0, 1), 0)
    apad.docks(0, PrimitiveStatus.RUNNING)
    apad.docks(40_000, PrimitiveStatus.DONE)
    assert apad.tells(40_000) == []
    assert apad.core.dropped == {"a docking by others: no simulated aMussel was near": 1}


def test_a_pilot_is_not_fought() -> None:
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    apad.goes(0, PrimitiveStatus.RUNNING)
    apad.core.receive(ManualReceived(1_000, True), 1_000)
    apad.goes(1_000, PrimitiveStatus.PREEMPTED)
    assert apad.tells(1_000) == [CommandFailed(1_000, 1, PILOT)]
    apad.core.command(cleared(GoTo(2, 7.0, 8.0, 0.5, 0.5)), 2_000)
    assert apad.tells(20_000) == []
    assert apad.answers(20_000) == []
    apad.core.receive(ManualReceived(21_000, False), 21_000)
    assert apad.answers(21_000) == [GoTo(0, 7.0, 8.0, 0.5, 0.5)]


def test_a_real_vehicle_stays_with_its_pilot_when_the_pilot_lets_go() -> None:
    apad = Apad(takes_back=False)
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    apad.goes(0, PrimitiveStatus.RUNNING)
    apad.core.receive(ManualReceived(1_000, True), 1_000)
    apad.goes(1_000, PrimitiveStatus.PREEMPTED)
    assert apad.tells(1_000) == [
        CommandFailed(1_000, 1, PILOT),
        PilotReported(1_000, True),
        CommandedByOthers(1_000),
    ]
    apad.core.command(cleared(Hold(2, 7.0, 8.0)), 2_000)
    assert apad.tells(20_000) == [CommandFailed(2_000, 2, PILOT)]
    apad.core.receive(ManualReceived(21_000, False), 21_000)
    assert apad.tells(21_000) == [PilotReported(21_000, False)]
    for at_ms in range(22_000, 120_000, 1_000):
        apad.is_at(at_ms, 30.0, 30.0)  # far from anything that it was ever told
        apad.tells(at_ms)
        assert apad.answers(at_ms) == []
    apad.core.command(cleared(GoTo(3, 7.0, 8.0, 0.5, 0.5)), 120_000)  # a person has given it back
    assert apad.answers(120_000) == [GoTo(0, 7.0, 8.0, 0.5, 0.5)]


def test_a_person_who_says_that_the_pilot_has_left_is_not_asked_again() -> None:
    apad = Apad(takes_back=False)
    apad.core.receive(ManualReceived(1_000, True), 1_000)
    apad.tells(1_000)
    apad.core.command(cleared(PilotLeft(1)), 2_000)
    assert apad.tells(2_000) == []
    apad.core.command(cleared(GoTo(2, 7.0, 8.0, 0.5, 0.5)), 3_000)
    assert apad.answers(3_000) == [GoTo(0, 7.0, 8.0, 0.5, 0.5)]


def test_an_answer_to_an_order_that_was_replaced_changes_nothing() -> None:
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    call = apad.core.take_calls()[0].order
    apad.core.command(cleared(Hold(2, 2.0, 3.0)), 0)
    apad.core.receive(ServiceAnswered(0, call.number, None), 0)
    assert apad.core.unacknowledged == ["order 2"]


def test_a_vehicle_that_is_heard_again_after_a_silence_is_told_again() -> None:
    """The vehicle may have rebooted, and a go-to that nobody runs would stall."""
    apad = Apad()
    apad.core.command(cleared(THERE), 0)
    apad.answers(0)
    apad.goes(0, PrimitiveStatus.RUNNING)
    for now_ms in range(1_000, 8_000, 1_000):
        assert apad.tells(now_ms) == []
    apad.is_at(8_000, 2.0, 3.0)
    assert apad.tells(8_000) == []
    assert apad.answers(8_000) == [GoTo(0, 5.0, 6.0, 0.5, 0.5)]
    apad.is_at(9_000, 2.0, 3.0)
    apad.tells(9_000)
    assert apad.answers(9_000) == []


def test_a_virtual_docking_from_afar_fails() -> None:
    apad = Apad({7: (2.0, 13.0)})
    apad.core.command(cleared(CloseDock(1, 0, 7)), 0)
    assert apad.tells(0) == [
        CommandFailed(0, 1, "aMussel 7 floats 10.0 m away: go nearer than 5 m before docking it")
    ]
