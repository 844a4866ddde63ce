"""The facts, orders and failures that the docking port gets from a generation B aPad, its silences included."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import pytest
from stack_benches import cleared, fed

from apad_bridge.scenario.blocks.mission_options import Docking, DockingProfile, Servo
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
        """The new facts of a story: of messages, of orders with their times, of times that merely come, and of what is done
        to the vehicle.

        Left out are readings of pose and battery, acceptances, and places that only moved. A hold that the core asks for is
        ordered, as the gate's owner does.
        """
        told: list[LinkFact] = []
        for it in story:
            if callable(it):
                it(self)
                continue
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


OURS = GoTo(0, 5.0, 6.0, 0.5, 0.5)
"""THERE, as the vehicle gets it."""
HELD, REAL = Hold(0, 2.0, 3.0), partial(Apad, takes_back=False)


def answers(*, comes: bool) -> Callable[[Apad], None]:
    return lambda it: setattr(it, "answers", comes)


def refuses(why: str) -> Callable[[Apad], None]:
    return lambda it: setattr(it, "refusal", why)


def holding(still_running_ms: int = 0) -> list[Any]:
    """A hold that was taken at 0, and a late status of the go-to that it pre-empted."""
    return [(0, Hold(1, 2.0, 3.0)), goes(still_running_ms, RUNNING), goes(1_000, PREEMPTED)]


UNDOCKED = [
    (0, CloseDock(1, 2, 8)),
    docks(0, RUNNING),
    docks(40_000, DONE),
    (50_000, OpenDock(2, 2, 8)),
    ArmReceived(50_000, 2),
    docks(50_000, RUNNING),
    60_000,
]
UNDOCKING_TOLD = [DockClosed(40_000, 2, 8), DockOpened(50_000, 2, 8), LetGo(50_000, 8)]
UNDOCKING_ORDERS = [BY_EYE, HELD, replace(BY_EYE, docks=False, agent_id=8)]
PILOTED = [(0, THERE), goes(0, RUNNING), ManualReceived(1_000, True), goes(1_000, PREEMPTED)]
AGAIN = "the aPad did not hold its position, and got the hold again"
SENT_AWAY = "goto_status: another client sent the aPad away from its hold"
STORIES: dict[str, tuple[Callable[[], Apad], list[Any], list[LinkFact | str], list[ServiceOrder]]] = {
    "a hold that was taken at 4 s is not astray at 13 s": (
        Apad,
        [answers(comes=False), (0, Hold(1, 20.0, 20.0)), answers(comes=True), 4_000, at(13_000, 2.0, 3.0)],
        [],
        [Hold(0, 20.0, 20.0)],
    ),
    "a hold that was taken at 4 s is astray at 14 s": (
        Apad,
        [answers(comes=False), (0, Hold(1, 20.0, 20.0)), answers(comes=True), 4_000, at(14_000, 2.0, 3.0)],
        [AGAIN],
        [Hold(0, 20.0, 20.0)] * 2,
    ),
    "the end of the go-to before is not the end of this one": (
        Apad,
        [
            (0, THERE),
            goes(0, RUNNING),
            answers(comes=False),
            (1_000, GoTo(2, -5.0, -6.0, 0.5, 0.5)),
            goes(1_000, RUNNING),
            goes(1_000, PREEMPTED),
            answers(comes=True),
            1_000,
            goes(1_000, PREEMPTED),
            2_000,
            goes(2_000, RUNNING),
            10_000,
            at(30_000, -5.0, -6.0),
            goes(30_000, DONE),
        ],
        [Arrived(30_000, 2)],
        [OURS, *[GoTo(0, -5.0, -6.0, 0.5, 0.5)] * 2, Hold(0, -5.0, -6.0)],
    ),
    "without any message on goto_status the position decides": (
        Apad,
        [(0, THERE), *(at(at_ms, 5.1, 6.0) for at_ms in range(10_000, 14_000, 1_000))],
        [Arrived(13_000, 1), "goto_status was silent: arrival by position"],
        [OURS, Hold(0, 5.0, 6.0)],
    ),
    "a service that refuses is asked three times, and the first cause kept": (
        Apad,
        [refuses("first"), (0, THERE), refuses("later"), *range(1_000, 6_000, 1_000)],
        [CommandFailed(3_000, 1, "first")],
        [OURS] * 3 + [HELD] * 3,
    ),
    "a service that does not answer fails by time-out": (
        Apad,
        [answers(comes=False), (0, THERE), *range(0, 30_000, 1_000)],
        [CommandFailed(18_000, 1, "its service did not answer within 5 s")],
        [],
    ),
    "a vehicle that does not hold for 9 s is left alone": (
        Apad,
        [(0, Hold(1, 2.0, 3.0, 0.7)), at(5_000, 2.0, 7.0), 9_000],
        [],
        [Hold(0, 2.0, 3.0, 0.7)],
    ),
    "a vehicle that does not hold for 10 s is told again": (
        Apad,
        [(0, Hold(1, 2.0, 3.0, 0.7)), at(5_000, 2.0, 7.0), 9_000, 10_000],
        [AGAIN],
        [Hold(0, 2.0, 3.0, 0.7)] * 2,
    ),
    "a go-to of another's during a hold is noticed and let go on": (
        Apad,
        [
            *holding(),
            at(11_000, 2.5, 3.0),
            goes(11_000, RUNNING),
            goes(12_000, RUNNING),
            at(30_000, 9.0, 3.0),
        ],
        [SENT_AWAY],
        [HELD],
    ),
    # It has ended somewhere, and the controllers are off since. The hold is ordered every ten seconds at most; a go-to that
    # still runs a moment later is a late status.
    "a go-to of another's that has ended is followed by the hold, once": (
        Apad,
        [
            *holding(),
            at(11_000, 2.5, 3.0),
            goes(11_000, RUNNING),
            goes(12_000, RUNNING),
            at(30_000, 9.0, 3.0),
            goes(31_000, DONE),
            at(31_000, 2.5, 3.0),
            goes(31_500, RUNNING),
            goes(32_000, PREEMPTED),
            60_000,
        ],
        [SENT_AWAY, AGAIN],
        [HELD, HELD],
    ),
    "a goal that nobody here ordered is another's and ends our go-to": (
        REAL,
        [
            (0, THERE),
            GoalOfOthers(100, "/apad1/commander", THERE.north_m, THERE.east_m),
            1_000,
            GoalOfOthers(2_000, "/apad1/commander", 80.0, 6.0),
            goes(3_000, RUNNING),
            goes(9_000, DONE),
        ],
        [
            CommandFailed(2_000, THERE.command_id, REPLACED),
            GoalOfOthers(2_000, "/apad1/commander", 80.0, 6.0),
            CommandedByOthers(2_000, "/apad1/commander"),
        ],
        [OURS],
    ),
    **{
        f"a goal at {north_m:g} m is another's like any other, without its place, and counted": (
            REAL,
            [(0, THERE), GoalOfOthers(1_000, "/planner", north_m, 6.0), goes(9_000, DONE)],
            [
                CommandFailed(1_000, THERE.command_id, REPLACED),
                GoalOfOthers(1_000, "/planner", None, None, "north_m is outside -50000 to 50000"),
                CommandedByOthers(1_000, "/planner"),
                "go2point/goal: north_m is outside -50000 to 50000",
            ],
            [OURS],
        )
        for north_m in (math.nan, math.inf, 51_000.0)
    },
    "a go-to of ours that a hold pre-empts is nobody else's": (Apad, [*holding(900), 20_000], [], [HELD]),
    "a docking of another's during a hold is let go on": (
        Apad,
        [*holding(), docks(2_000, RUNNING), at(40_000, 2.0, 8.0)],
        [],
        [HELD],
    ),
    "a docking of another's that has ended is followed by the hold": (
        Apad,
        [*holding(), docks(2_000, RUNNING), at(40_000, 2.0, 8.0), docks(41_000, DONE), at(41_000, 2.0, 4.0)],
        [AGAIN, "docking by hand: no arm was seen to open"],
        [HELD, HELD],
    ),
    **{
        f"a {name} of another's that never ends holds nothing up {'for ever' if again else 'for 199 s'}": (
            Apad,
            [*holding(), runs, at(201_000, 2.0, 8.0), *[202_000] * again],
            [*[SENT_AWAY] * (name == "go-to"), *[AGAIN] * again],
            [HELD] * (1 + again),
        )
        for name, runs in {"go-to": goes(2_000, RUNNING), "docking": docks(2_000, RUNNING)}.items()
        for again in (0, 1)
    },
    # The aMussel is believed at (2, 4), the boat is west of it: two metres west, with dock 2, the stern, towards it.
    "a visual docking stands off, orders, and ends by its status and not by an earlier one's": (
        Apad,
        [
            (0, GoTo(1, 2.0, 4.0, 0.5, 0.5)),
            goes(0, RUNNING),
            goes(0, DONE),
            (1_000, CloseDock(2, 2, 8)),
            docks(1_000, DONE),
            at(5_000, 2.0, 2.1, -1.5),
            docks(5_000, RUNNING),
            60_000,
            docks(60_000, DONE),
        ],
        [Arrived(0, 1), DockClosed(60_000, 2, 8)],
        [
            GoTo(0, 2.0, 4.0, 0.5, 0.5),
            Hold(0, 2.0, 4.0),
            Hold(0, pytest.approx(2.0), pytest.approx(2.0), pytest.approx(-math.pi / 2)),
            BY_EYE,
            Hold(0, 2.0, 2.1),
        ],
    ),
    "an undocking lets go when the arm opens, and the next order waits while it still pulls back": (
        Apad,
        [*UNDOCKED, (60_000, THERE)],
        UNDOCKING_TOLD,
        UNDOCKING_ORDERS,
    ),
    "the next order follows when it has pulled back": (
        Apad,
        [*UNDOCKED, (60_000, THERE), docks(85_000, DONE)],
        UNDOCKING_TOLD,
        [*UNDOCKING_ORDERS, OURS],
    ),
    "a real aMussel takes a dock, and no simulated one does then": (
        Apad,
        [(0, CloseDock(1, 2, 20)), docks(0, RUNNING), docks(40_000, DONE), (42_000, CloseDock(2, 2, 7))],
        [DockClosed(40_000, 2, 20), CommandFailed(42_000, 2, "dock 3 holds aMussel 20")],
        [BY_EYE, HELD],
    ),
    "a docking by hand far from all is counted": (
        partial(Apad, {6: (9.0, 9.0)}),
        [ArmReceived(0, 1), docks(0, RUNNING), docks(40_000, DONE)],
        ["a docking by others: no simulated aMussel was near"],
        [],
    ),
    "a pilot is not fought": (
        Apad,
        [*PILOTED, (2_000, GoTo(2, 7.0, 8.0, 0.5, 0.5)), 20_000],
        [CommandFailed(1_000, 1, PILOT)],
        [OURS],
    ),
    "a simulated vehicle goes on when its pilot lets go": (
        Apad,
        [*PILOTED, (2_000, GoTo(2, 7.0, 8.0, 0.5, 0.5)), 20_000, ManualReceived(21_000, False)],
        [CommandFailed(1_000, 1, PILOT)],
        [OURS, GoTo(0, 7.0, 8.0, 0.5, 0.5)],
    ),
    "a simulated vehicle that had no order holds its place when its pilot lets go": (
        Apad,
        [ManualReceived(1_000, True), 20_000, ManualReceived(21_000, False)],
        [],
        [HELD],
    ),
    "a real vehicle stays with its pilot when the pilot lets go, until a person gives it back": (
        REAL,
        [
            *PILOTED,
            (2_000, Hold(2, 7.0, 8.0)),
            20_000,
            ManualReceived(21_000, False),
            *(at(at_ms, 30.0, 30.0) for at_ms in range(22_000, 120_000, 1_000)),
            (120_000, GoTo(3, 7.0, 8.0, 0.5, 0.5)),
        ],
        [
            CommandFailed(1_000, 1, PILOT),
            PilotReported(1_000, True),
            CommandedByOthers(1_000),
            CommandFailed(2_000, 2, PILOT),
            PilotReported(21_000, False),
        ],
        [OURS, GoTo(0, 7.0, 8.0, 0.5, 0.5)],
    ),
    # It may have rebooted, and a go-to that nobody runs would stall.
    "a vehicle that is heard again after a silence is told again": (
        Apad,
        [
            (0, THERE),
            goes(0, RUNNING),
            *range(1_000, 8_000, 1_000),
            at(8_000, 2.0, 3.0),
            at(9_000, 2.0, 3.0),
        ],
        [],
        [OURS, OURS],
    ),
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
            (0, THERE),
            (1_000, Hold(2, 2.0, 3.0, pre_empts=True)),
            GoalOfOthers(1_500, "/apad1/commander", THERE.north_m, THERE.east_m),
            2_000,
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
            ArmReceived(0, 1),
            docks(0, RUNNING),
            docks(40_000, DONE),
            ArmReceived(50_000, 1),
            docks(50_000, RUNNING),
            docks(90_000, DONE),
        ],
        [DockClosed(40_000, 1, 5), DockOpened(90_000, 1, 5), LetGo(90_000, 5)],
        [],
    ),
}


@pytest.mark.parametrize(("vehicle", "story", "told", "orders"), STORIES.values(), ids=STORIES)
def test_a_story_tells_and_orders(
    vehicle: Callable[[], Apad], story: list[Any], told: list[LinkFact | str], orders: list[ServiceOrder]
) -> None:
    """Each fact bears the time of the step that tells it; last comes what was dropped, each once."""
    apad = vehicle()
    assert [*apad.played(*story), *apad.core.dropped.elements()] == told
    assert apad.orders() == orders


@pytest.mark.parametrize("command", [THERE, Hold(1, 5.0, 6.0)])
def test_an_order_is_accepted_by_its_service_s_answer(command: GoTo | Hold) -> None:
    core = Apad().core
    core.advance(0)
    core.command(cleared(command), 0)
    assert core.advance(2_000) == []
    core.receive(ServiceAnswered(2_000, core.take_calls()[0].order.number, None), 2_000)
    assert core.advance(3_000) == [CommandAccepted(2_000, 1)]


@pytest.mark.parametrize(("ran_ms", "is_anothers"), [(0, False), (500, False), (3_000, True), (40_000, True)])
def test_a_go_to_that_runs_where_ours_was_pre_empted_is_anothers(ran_ms: int, is_anothers: bool) -> None:
    """Its server shows no goal. Soon after our order, the pre-empted one was an earlier order of ours."""
    real = Apad(takes_back=False)
    assert real.played((0, THERE), goes(100, RUNNING), goes(100 + ran_ms, PREEMPTED)) == []
    told = [CommandFailed(110 + ran_ms, THERE.command_id, REPLACED), CommandedByOthers(110 + ran_ms)]
    assert real.played(goes(110 + ran_ms, RUNNING)) == (told if is_anothers else [])
    assert (real.played(goes(9_000 + ran_ms, DONE)) == []) is is_anothers


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


def test_an_answer_to_an_order_that_was_replaced_changes_nothing() -> None:
    core = Apad().core
    core.command(cleared(THERE), 0)
    call = core.take_calls()[0].order
    core.command(cleared(Hold(2, 2.0, 3.0)), 0)
    core.receive(ServiceAnswered(0, call.number, None), 0)
    assert core.unacknowledged == ["order 2"]
