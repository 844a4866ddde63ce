"""The facts, orders and failures that the docking port gets from a generation B aPad, its silences included."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import pytest
from stack_benches import cleared, fed

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
from apad_bridge.vehicle.vehicle_link import Carried, LetGo, LinkFact
from apad_bridge.world.apad.dock_mechanisms import MISSED, Misses
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


RUNNING, DONE, PREEMPTED = PrimitiveStatus.RUNNING, PrimitiveStatus.DONE, PrimitiveStatus.PREEMPTED


def at(at_ms: int, north_m: float, east_m: float, heading_rad: float = 0.0) -> PoseReported:
    return PoseReported(at_ms, north_m, east_m, heading_rad)


def goes(at_ms: int, status: PrimitiveStatus) -> StatusReceived:
    return StatusReceived(at_ms, False, status)


def docks(at_ms: int, status: PrimitiveStatus) -> StatusReceived:
    return StatusReceived(at_ms, True, status)


class Apad:
    """A core at (2, 3), with the services of a vehicle, which answer each order at once."""

    def __init__(
        self,
        floating: Mapping[int, tuple[float, float]] | None = None,
        probability: float = 0.0,
        *,
        takes_back: bool = True,
    ) -> None:
        places, misses = floating or {}, Misses(1, probability)
        bench_docks = BenchDocks(range(1, 10), misses, lambda _: places)
        self.core = GenerationBCore(bench_docks, (10.5, 16.0), DOCKING, takes_back=takes_back)
        self.core.receive(at(0, 2.0, 3.0), 0)
        self.answers = True
        self.refusal: str | None = None
        self._orders: list[ServiceOrder] = []

    def played(self, *story: Any) -> list[LinkFact]:
        """The new facts of a story: of messages, of orders with their times, and of times that merely come.

        Left out are readings of pose and battery, acceptances, and places that only moved. A hold that the core asks for is
        ordered, as the gate's owner does.
        """
        told: list[LinkFact] = []
        for it in story:
            at_ms = fed(self.core, it)
            self._answer(at_ms)
            for fact in self.core.advance(at_ms):
                if isinstance(fact, HoldWanted):
                    hold = Hold(-1, fact.north_m, fact.east_m, fact.heading_rad)
                    self.core.command(cleared(hold), at_ms)
                elif not isinstance(fact, PoseReported | BatteryReported | CommandAccepted | Carried):
                    told.append(fact)
            self._answer(at_ms)
        return told

    def orders(self) -> list[ServiceOrder]:
        """Those that the vehicle got since the newest call."""
        orders, self._orders = self._orders, []
        return orders

    def _answer(self, at_ms: int) -> None:
        if self.answers:
            for call in [it.order for it in self.core.take_calls()]:
                self._orders.append(call.order)
                self.core.receive(ServiceAnswered(at_ms, call.number, self.refusal), at_ms)


@pytest.fixture
def apad() -> Apad:
    return Apad()


OURS = GoTo(0, 5.0, 6.0, 0.5, 0.5)
"""THERE, as the vehicle gets it."""
STORIES: dict[str, tuple[Callable[[], Apad], list[Any], list[LinkFact], list[ServiceOrder]]] = {
    "a go-to arrives by its status and is then held: a primitive's end leaves the controllers off": (
        Apad,
        [(0, THERE), goes(0, RUNNING), 1_000, at(9_000, 4.8, 6.0), goes(9_000, DONE)],
        [Arrived(9_000, 1)],
        [OURS, Hold(0, 5.0, 6.0)],
    ),
    "a go-to that was so short that nobody saw it run has arrived": (
        Apad,
        [(0, GoTo(1, 2.1, 3.0, 0.5, 0.5)), goes(1_000, DONE)],
        [Arrived(1_000, 1)],
        [GoTo(0, 2.1, 3.0, 0.5, 0.5), Hold(0, 2.1, 3.0)],
    ),
    "a go-to that the vehicle drops fails after three seconds": (
        Apad,
        [(0, THERE), goes(0, RUNNING), goes(2_000, PREEMPTED), 4_999, 5_000],
        [CommandFailed(5_000, 1, "the aPad ended the go-to by itself: its status says PREEMPTED")],
        [OURS, Hold(0, 2.0, 3.0)],
    ),
    "a go-to said to be done far from its goal has failed": (
        Apad,
        [(0, THERE), goes(0, RUNNING), goes(2_000, DONE)],
        [CommandFailed(2_000, 1, "the aPad reports an arrival, 4.2 m from the goal")],
        [OURS, Hold(0, 2.0, 3.0)],
    ),
    "an earlier goal of ours that is shown late is nobody else's": (
        partial(Apad, takes_back=False),
        [
            *((0, THERE), (1_000, Hold(2, 2.0, 3.0, pre_empts=True))),
            *(GoalOfOthers(1_500, "/apad1/commander", THERE.north_m, THERE.east_m), 2_000),
        ],
        [],
        [OURS, Hold(0, 2.0, 3.0, pre_empts=True)],
    ),
    "a person who says that the pilot has left is not asked again": (
        partial(Apad, takes_back=False),
        [ManualReceived(1_000, True), (2_000, PilotLeft(1)), (3_000, THERE)],
        [PilotReported(1_000, True), CommandedByOthers(1_000)],
        [OURS],
    ),
    "a docking can miss": (
        partial(Apad, probability=1.0),
        [(0, CloseDock(1, 1, 7))],
        [CommandFailed(0, 1, MISSED)],
        [],
    ),
    "a virtual docking from afar fails": (
        partial(Apad, {7: (2.0, 13.0)}),
        [(0, CloseDock(1, 0, 7))],
        [CommandFailed(0, 1, "aMussel 7 floats 10.0 m away: go nearer than 5 m before docking it")],
        [],
    ),
    "an arm that is moved for people to see releases nobody that is docked virtually": (
        Apad,
        [(0, CloseDock(1, 2, 7)), ArmReceived(1_000, 2)],
        [DockClosed(0, 2, 7)],
        [],
    ),
    "a search that finds nothing is given up": (
        Apad,
        [(0, CloseDock(1, 2, 8)), docks(0, RUNNING), 89_000, 90_000],
        [CommandFailed(90_000, 1, "the aPad's docking did not come to an end within 90 s")],
        [BY_EYE, Hold(0, 2.0, 3.0)],
    ),
    "a docking by hand takes the simulated aMussel that is there": (
        partial(Apad, {5: (2.2, 3.5), 6: (9.0, 9.0)}),
        [
            *(ArmReceived(0, 1), docks(0, RUNNING), docks(40_000, DONE)),
            *(ArmReceived(50_000, 1), docks(50_000, RUNNING), docks(90_000, DONE)),
        ],
        [DockClosed(40_000, 1, 5), DockOpened(90_000, 1, 5), LetGo(90_000, 5)],
        [],
    ),
}


@pytest.mark.parametrize(("vehicle", "story", "told", "orders"), STORIES.values(), ids=STORIES)
def test_a_story_tells_and_orders(
    vehicle: Callable[[], Apad], story: list[Any], told: list[LinkFact], orders: list[ServiceOrder]
) -> None:
    """Each fact bears the time of the step that tells it."""
    apad = vehicle()
    assert apad.played(*story) == told
    assert apad.orders() == orders


@pytest.mark.parametrize("command", [THERE, Hold(1, 5.0, 6.0)])
def test_an_order_is_accepted_by_its_service_s_answer(command: GoTo | Hold) -> None:
    core = Apad().core
    core.advance(0)
    core.command(cleared(command), 0)
    assert core.advance(2_000) == []
    core.receive(ServiceAnswered(2_000, core.take_calls()[0].order.number, None), 2_000)
    assert core.advance(3_000) == [CommandAccepted(2_000, 1)]


def test_a_hold_is_astray_by_its_acceptance_and_not_by_its_order(apad: Apad) -> None:
    apad.answers = False
    apad.played((0, Hold(1, 20.0, 20.0)))
    apad.answers = True
    apad.played(4_000, at(13_000, 2.0, 3.0))
    assert apad.orders() == [Hold(0, 20.0, 20.0)]
    apad.played(at(14_000, 2.0, 3.0))
    assert apad.orders() == [Hold(0, 20.0, 20.0)]


def test_the_end_of_the_go_to_before_is_not_the_end_of_this_one(apad: Apad) -> None:
    apad.played((0, THERE), goes(0, RUNNING))
    apad.answers = False
    apad.played((1_000, GoTo(2, -5.0, -6.0, 0.5, 0.5)), goes(1_000, RUNNING), goes(1_000, PREEMPTED))
    apad.answers = True
    runs = goes(1_000, PREEMPTED), 2_000, goes(2_000, RUNNING), 10_000, at(30_000, -5.0, -6.0)
    assert apad.played(1_000, *runs) == []
    assert apad.played(goes(30_000, DONE)) == [Arrived(30_000, 2)]


def test_without_any_message_on_goto_status_the_position_decides(apad: Apad) -> None:
    there = (at(at_ms, 5.1, 6.0) for at_ms in range(10_000, 14_000, 1_000))
    assert apad.played((0, THERE), *there) == [Arrived(13_000, 1)]
    assert apad.core.dropped == {"goto_status was silent: arrival by position": 1}


def test_a_service_that_refuses_is_asked_three_times_and_the_first_cause_kept(apad: Apad) -> None:
    apad.refusal = "first"
    apad.played((0, THERE))
    apad.refusal = "later"
    assert apad.played(*range(1_000, 6_000, 1_000)) == [CommandFailed(3_000, 1, "first")]


def test_a_service_that_does_not_answer_fails_by_time_out(apad: Apad) -> None:
    apad.answers = False
    failed = CommandFailed(18_000, 1, "its service did not answer within 5 s")
    assert apad.played((0, THERE), *range(0, 30_000, 1_000)) == [failed]


def test_a_vehicle_that_does_not_hold_is_told_again(apad: Apad) -> None:
    apad.played((0, Hold(1, 2.0, 3.0, 0.7)), at(5_000, 2.0, 7.0), 9_000)
    assert apad.orders() == [Hold(0, 2.0, 3.0, 0.7)]
    apad.played(10_000)
    assert apad.orders() == [Hold(0, 2.0, 3.0, 0.7)]


def holding(still_running_ms: int = 0) -> Apad:
    """A hold that was taken at 0, and a late status of the go-to that it pre-empted."""
    apad = Apad()
    late = goes(still_running_ms, RUNNING), goes(1_000, PREEMPTED)
    assert apad.played((0, Hold(1, 2.0, 3.0)), *late) == [] and apad.orders() == [Hold(0, 2.0, 3.0)]
    return apad


def test_a_go_to_of_anothers_during_a_hold_is_noticed_and_let_end() -> None:
    apad = holding()
    away = at(11_000, 2.5, 3.0), goes(11_000, RUNNING), goes(12_000, RUNNING), at(30_000, 9.0, 3.0)
    assert apad.played(*away) == [] and apad.orders() == []
    assert apad.core.dropped["goto_status: another client sent the aPad away from its hold"] == 1
    # That go-to has ended somewhere, and the controllers are off since.
    assert apad.played(goes(31_000, DONE), at(31_000, 2.5, 3.0)) == []
    assert apad.orders() == [Hold(0, 2.0, 3.0)]
    # Ordered every ten seconds at most; a go-to that still runs a moment later is a late status.
    assert apad.played(goes(31_500, RUNNING), goes(32_000, PREEMPTED), 60_000) == [] and apad.orders() == []


@pytest.fixture
def real() -> Apad:
    return Apad(takes_back=False)


def test_a_goal_that_nobody_here_ordered_is_anothers_and_ends_our_go_to(real: Apad) -> None:
    ours = GoalOfOthers(100, "/apad1/commander", THERE.north_m, THERE.east_m)
    assert real.played((0, THERE), ours, 1_000) == []
    assert real.played(GoalOfOthers(2_000, "/apad1/commander", 80.0, 6.0)) == [
        CommandFailed(2_000, THERE.command_id, REPLACED),
        GoalOfOthers(2_000, "/apad1/commander", 80.0, 6.0),
        CommandedByOthers(2_000, "/apad1/commander"),
    ]
    assert real.played(goes(3_000, RUNNING), goes(9_000, DONE)) == [] and len(real.orders()) == 1


@pytest.mark.parametrize(("ran_ms", "is_anothers"), [(0, False), (500, False), (3_000, True), (40_000, True)])
def test_a_go_to_that_runs_where_ours_was_pre_empted_is_anothers(
    real: Apad, ran_ms: int, is_anothers: bool
) -> None:
    """Its server shows no goal. Soon after our order, the pre-empted one was an earlier order of ours."""
    assert real.played((0, THERE), goes(100, RUNNING), goes(100 + ran_ms, PREEMPTED)) == []
    told = [CommandFailed(110 + ran_ms, THERE.command_id, REPLACED), CommandedByOthers(110 + ran_ms)]
    assert real.played(goes(110 + ran_ms, RUNNING)) == (told if is_anothers else [])
    assert (real.played(goes(9_000 + ran_ms, DONE)) == []) is is_anothers


@pytest.mark.parametrize("north_m", (math.nan, math.inf, 1e12))
def test_a_goal_at_no_place_is_counted(real: Apad, north_m: float) -> None:
    assert real.played(GoalOfOthers(1_000, "/planner", north_m, 0.0)) == []
    assert [it for it in real.core.dropped if it.startswith("go2point/goal: ")]


def test_a_go_to_of_ours_that_a_hold_pre_empts_is_nobody_elses() -> None:
    apad = holding(still_running_ms=900)
    assert apad.played(20_000) == [] and apad.orders() == [] and not apad.core.dropped


def test_a_docking_of_anothers_during_a_hold_is_let_end_and_then_held() -> None:
    apad = holding()
    assert apad.played(docks(2_000, RUNNING), at(40_000, 2.0, 8.0)) == [] and apad.orders() == []
    assert apad.played(docks(41_000, DONE), at(41_000, 2.0, 4.0)) == []
    assert apad.orders() == [Hold(0, 2.0, 3.0)]


@pytest.mark.parametrize("runs", [goes(2_000, RUNNING), docks(2_000, RUNNING)], ids=["go-to", "docking"])
def test_a_primitive_of_anothers_that_never_ends_holds_nothing_up_for_ever(runs: StatusReceived) -> None:
    apad = holding()
    assert apad.played(runs, at(201_000, 2.0, 8.0)) == [] and apad.orders() == []
    assert apad.played(202_000) == [] and apad.orders() == [Hold(0, 2.0, 3.0)]


def test_a_virtual_docking_is_the_benchs_contact_and_is_carried_along() -> None:
    """It orders nothing of the vehicle."""
    core = Apad().core
    core.command(cleared(CloseDock(1, 1, 7)), 0)
    carried = Carried(0, 7, pytest.approx(2.0), pytest.approx(3.4))
    assert core.advance(0)[:2] == [DockClosed(0, 1, 7), carried]
    core.receive(at(1_000, 4.0, 5.0, math.pi / 2), 1_000)  # facing east: dock 1, to starboard, is south
    assert Carried(1_000, 7, pytest.approx(3.6), pytest.approx(5.0)) in core.advance(1_000)
    core.command(cleared(OpenDock(2, 1, 7)), 2_000)
    assert core.advance(2_000) == [DockOpened(2_000, 1, 7), LetGo(2_000, 7)] and core.take_calls() == []


def test_visual_docking_stands_off_orders_and_ends_by_its_status(apad: Apad) -> None:
    """The aMussel is believed at (2, 4), the boat is west of it: two metres west, with dock 2, the stern, towards it."""
    apad.played(
        (0, GoTo(1, 2.0, 4.0, 0.5, 0.5)), goes(0, RUNNING), goes(0, DONE), (1_000, CloseDock(2, 2, 8))
    )
    stand = Hold(0, pytest.approx(2.0), pytest.approx(2.0), pytest.approx(-math.pi / 2))
    assert apad.orders()[-1] == stand
    of_an_earlier_docking = docks(1_000, DONE)
    assert apad.played(of_an_earlier_docking, at(5_000, 2.0, 2.1, -1.5)) == [] and apad.orders() == [BY_EYE]
    assert apad.played(docks(5_000, RUNNING), 60_000, docks(60_000, DONE)) == [DockClosed(60_000, 2, 8)]
    assert apad.orders() == [Hold(0, 2.0, 2.1)]


def test_an_undocking_lets_go_when_the_arm_opens_and_the_next_order_waits_until_the_vehicle_has_pulled_back(
    apad: Apad,
) -> None:
    apad.played((0, CloseDock(1, 2, 8)), docks(0, RUNNING), docks(40_000, DONE))
    opens = (50_000, OpenDock(2, 2, 8)), ArmReceived(50_000, 2), docks(50_000, RUNNING), 60_000
    assert apad.played(*opens) == [DockOpened(50_000, 2, 8), LetGo(50_000, 8)]
    apad.orders()
    assert apad.played((60_000, THERE)) == [] and apad.orders() == []  # it still pulls back
    assert apad.played(docks(85_000, DONE)) == [] and apad.orders() == [GoTo(0, 5.0, 6.0, 0.5, 0.5)]


def test_a_real_amussel_takes_a_dock_and_no_simulated_one_does_then(apad: Apad) -> None:
    by_eye = (0, CloseDock(1, 2, 20)), docks(0, RUNNING), docks(40_000, DONE)
    assert apad.played(*by_eye) == [DockClosed(40_000, 2, 20)]
    assert not any(isinstance(it, Carried) for it in apad.core.advance(41_000))
    failed = CommandFailed(42_000, 2, "dock 3 holds aMussel 20")
    assert apad.played((42_000, CloseDock(2, 2, 7))) == [failed]


def test_a_docking_by_hand_far_from_all_is_counted() -> None:
    apad = Apad({6: (9.0, 9.0)})
    assert apad.played(ArmReceived(0, 1), docks(0, RUNNING), docks(40_000, DONE)) == []
    assert apad.core.dropped == {"a docking by others: no simulated aMussel was near": 1}


def test_a_pilot_is_not_fought(apad: Apad) -> None:
    steers = ManualReceived(1_000, True), goes(1_000, PREEMPTED)
    assert apad.played((0, THERE), goes(0, RUNNING), *steers) == [CommandFailed(1_000, 1, PILOT)]
    apad.orders()
    assert apad.played((2_000, GoTo(2, 7.0, 8.0, 0.5, 0.5)), 20_000) == [] and apad.orders() == []
    apad.played(ManualReceived(21_000, False))
    assert apad.orders() == [GoTo(0, 7.0, 8.0, 0.5, 0.5)]


def test_a_real_vehicle_stays_with_its_pilot_when_the_pilot_lets_go(real: Apad) -> None:
    steers = ManualReceived(1_000, True), goes(1_000, PREEMPTED)
    assert real.played((0, THERE), goes(0, RUNNING), *steers, (2_000, Hold(2, 7.0, 8.0)), 20_000) == [
        CommandFailed(1_000, 1, PILOT),
        PilotReported(1_000, True),
        CommandedByOthers(1_000),
        CommandFailed(2_000, 2, PILOT),
    ]
    real.orders()
    far_from_any_order = (at(at_ms, 30.0, 30.0) for at_ms in range(22_000, 120_000, 1_000))
    told = real.played(ManualReceived(21_000, False), *far_from_any_order)
    assert told == [PilotReported(21_000, False)] and real.orders() == []
    real.played((120_000, GoTo(3, 7.0, 8.0, 0.5, 0.5)))  # a person has given it back
    assert real.orders() == [GoTo(0, 7.0, 8.0, 0.5, 0.5)]


def test_an_answer_to_an_order_that_was_replaced_changes_nothing() -> None:
    core = Apad().core
    core.command(cleared(THERE), 0)
    call = core.take_calls()[0].order
    core.command(cleared(Hold(2, 2.0, 3.0)), 0)
    core.receive(ServiceAnswered(0, call.number, None), 0)
    assert core.unacknowledged == ["order 2"]


def test_a_vehicle_that_is_heard_again_after_a_silence_is_told_again(apad: Apad) -> None:
    """The vehicle may have rebooted, and a go-to that nobody runs would stall."""
    assert apad.played((0, THERE), goes(0, RUNNING), *range(1_000, 8_000, 1_000)) == []
    assert len(apad.orders()) == 1
    assert apad.played(at(8_000, 2.0, 3.0), at(9_000, 2.0, 3.0)) == []
    assert apad.orders() == [GoTo(0, 5.0, 6.0, 0.5, 0.5)]
