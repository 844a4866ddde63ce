"""Each fault of a stack as docs/failures.md describes it: port, core and simulated aPad in one loop without ROS."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from scenario_files import POOL_FILE
from stack_benches import cleared

from apad_bridge.scenario.faults import OF_A, OF_B, Fault
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import (
    CloseDock,
    CommandedByOthers,
    GoTo,
    Hold,
    HoldWanted,
    OpenDock,
    PoseReported,
    Primitive,
    ReleaseByName,
    ReleaseWanted,
    VehicleCommand,
)
from apad_bridge.vehicle.docking_port import DockingPort
from apad_bridge.vehicle.generation_a.core import GenerationACore
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_a.messages import (
    GO_TO,
    DocksReceived,
    GoalCode,
    GoalOrder,
    GoalStatusEntry,
    GoalStatusReceived,
    HeldPositionReceived,
)
from apad_bridge.vehicle.generation_b.core import GenerationBCore
from apad_bridge.vehicle.generation_b.messages import (
    ArmReceived,
    DockingOrder,
    ServiceAnswered,
    StatusReceived,
)
from apad_bridge.vehicle.link import Carried, LinkFact
from apad_bridge.vehicle.outcomes import DockChanged, Outcome, PrimitiveFailed, PrimitiveSucceeded
from apad_bridge.world.apad.apad import SimulatedAPad
from apad_bridge.world.apad.docks import Misses
from apad_bridge.world.apad.motion import Coast
from apad_bridge.world.generation_a import messages as shown_a
from apad_bridge.world.generation_a.vehicle import GenerationAVehicle
from apad_bridge.world.generation_b import messages as shown_b
from apad_bridge.world.generation_b.docks import BenchDocks
from apad_bridge.world.generation_b.vehicle import GenerationBVehicle
from apad_bridge.world.simulated_stack import PosePublished

ROOT = Path(__file__).parents[4]
POOL = load(POOL_FILE)
NORTH_M, EAST_M = POOL.apad.start_m
DOCKING = POOL.mission.docking
BATTERY_V = (10.5, 16.0)
ROWS = dict(
    re.findall(r"^\| `(\w+)` \| [AB, ]+ \| (.*) \|$", (ROOT / "docs/failures.md").read_text(), re.MULTILINE)
)
AWAY = GoTo(1, NORTH_M + 10.0, EAST_M, 0.5, 0.5)


class WithA:
    """Generation A: converts the vehicle's output to the messages of its topics and its action server."""

    def __init__(self, fault: Fault, *, takes_back: bool = True) -> None:
        self.vehicle = GenerationAVehicle(SimulatedAPad(POOL.apad), 0.5, 0.5, 0, fault)
        self.core = GenerationACore(ReportedDocks(range(1, 10)), BATTERY_V, "run", takes_back=takes_back)
        self.answers = True
        """Its services answer."""
        self._active: list[str] = []

    def advance(self, now_ms: int) -> None:
        self._receive(self.vehicle.advance(now_ms), now_ms)

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        if (goal := self.core.command(cleared(command), now_ms)) is not None:
            self.send(goal.order, now_ms)

    def send(self, order: GoalOrder, now_ms: int) -> None:
        """Sends a goal, of the core or of another party."""
        if self.vehicle.has_crashed:
            return
        goal = GoalOrder(order.key, order.kind, order.north_m, order.east_m, order.name)
        self._active.append(order.key)
        self._report(GoalStatusEntry(order.key, GoalCode.ACTIVE), now_ms)
        self._receive(self.vehicle.receive(goal, now_ms), now_ms)

    def answer(self, now_ms: int) -> None:
        for goal in self.core.take_orders():
            self.send(goal.order, now_ms)
        if self.core.take_question() and self.answers:
            self.core.receive(DocksReceived(now_ms, frozenset(self.vehicle.held)), now_ms)

    def _report(self, status: GoalStatusEntry, at_ms: int) -> None:
        self.core.receive(GoalStatusReceived(at_ms, (status,), whole=False), at_ms)

    def _receive(self, shown: list[shown_a.Published], now_ms: int) -> None:
        codes = {
            shown_a.GoalOutcome.SUCCEEDED: GoalCode.SUCCEEDED,
            shown_a.GoalOutcome.PREEMPTED: GoalCode.PREEMPTED,
            shown_a.GoalOutcome.ABORTED: GoalCode.ABORTED,
        }
        for it in shown:
            match it:
                case PosePublished(at_ms, pose):
                    self.core.receive(
                        PoseReported(at_ms, pose.north_m, pose.east_m, pose.heading_rad), now_ms
                    )
                case shown_a.HeldPositionPublished(at_ms, name, north_m, east_m, released):
                    agent_id = int(name.removeprefix("amussel"))
                    self.core.receive(
                        HeldPositionReceived(at_ms, agent_id, north_m, east_m, released), now_ms
                    )
                case shown_a.BatteryAndProgressPublished(at_ms) if not self.vehicle.has_crashed:
                    statuses = tuple(GoalStatusEntry(key, GoalCode.ACTIVE) for key in self._active)
                    self.core.receive(GoalStatusReceived(at_ms, statuses, whole=True), now_ms)
                case shown_a.GoalEnded(at_ms, key, outcome, reason):
                    self._active.remove(key)
                    self._report(GoalStatusEntry(key, codes[outcome], reason), at_ms)


class WithB:
    """Generation B: answers calls as its services do, at once or never."""

    def __init__(self, fault: Fault, drift_m_s: tuple[float, float] = (0.0, 0.0)) -> None:
        self.vehicle = GenerationBVehicle(SimulatedAPad(replace(POOL.apad, drift_m_s=drift_m_s)), 0, fault)
        self.core = GenerationBCore(BenchDocks(range(1, 10), Misses(1, 0.0)), BATTERY_V, DOCKING)

    def advance(self, now_ms: int) -> None:
        self._receive(self.vehicle.advance(now_ms), now_ms)

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        self.core.command(cleared(command), now_ms)

    def answer(self, now_ms: int) -> None:
        for let_out in self.core.take_calls():
            call = let_out.order
            self._receive(self.vehicle.receive(call.order, now_ms), now_ms)
            if self.vehicle.takes is not None:
                refused = (
                    None if self.vehicle.takes else "its service answered that it does not take the order"
                )
                self.core.receive(ServiceAnswered(now_ms, call.number, refused), now_ms)

    def _receive(self, shown: list[shown_b.Published], now_ms: int) -> None:
        for it in shown:
            match it:
                case PosePublished(at_ms, pose):
                    self.core.receive(
                        PoseReported(at_ms, pose.north_m, pose.east_m, pose.heading_rad), now_ms
                    )
                case shown_b.StatusPublished(at_ms, docking, status):
                    self.core.receive(StatusReceived(at_ms, docking, status), now_ms)
                case shown_b.ArmPublished(at_ms, arm):
                    if True in arm.is_open:
                        self.core.receive(ArmReceived(at_ms, arm.is_open.index(True)), now_ms)


class Bench:
    """A port with one of them, in ticks of a second; `outcomes` are its outcomes, with their ticks."""

    def __init__(self, stack: WithA | WithB) -> None:
        self.stack = stack
        self.port = DockingPort(DOCKING)
        self.now_ms = 0
        self.outcomes: list[tuple[int, Outcome]] = []
        self.facts: list[LinkFact] = []
        self.run(1_000)

    def order(self, primitive: Primitive) -> None:
        self._pass_on(self.port.receive(primitive, self.now_ms))
        self._settle()

    def run(self, for_ms: int) -> None:
        until_ms = self.now_ms + for_ms
        while self.now_ms < until_ms:
            self.now_ms += 1_000
            self.stack.advance(self.now_ms)
            self._settle()

    def done(self, primitive: Primitive) -> tuple[int, Outcome]:
        """Orders a primitive, and returns its end and the time of that."""
        self.order(primitive)
        return self.outcome(primitive.command_id)

    def refused(self, primitive: Primitive) -> str:
        """The reason why a primitive failed."""
        _, outcome = self.done(primitive)
        assert isinstance(outcome, PrimitiveFailed)
        return outcome.reason

    def outcome(self, primitive_id: int) -> tuple[int, Outcome]:
        """The end of a primitive, and its time. Waits up to five minutes for it."""
        for _ in range(300):
            ends = [
                (at_ms, it)
                for at_ms, it in self.outcomes
                if isinstance(it, PrimitiveSucceeded | PrimitiveFailed) and it.primitive_id == primitive_id
            ]
            if ends:
                return ends[0]
            self.run(1_000)
        raise AssertionError("it waits for ever")

    def _settle(self) -> None:
        """Receives the vehicle's messages within the tick, as a flight does."""
        for _ in range(4):
            self.stack.answer(self.now_ms)
            for fact in self.stack.core.advance(self.now_ms):
                if isinstance(fact, HoldWanted):  # what a link asks for is ordered, as the gate's owner does
                    self.stack.command(Hold(-1, fact.north_m, fact.east_m, fact.heading_rad), self.now_ms)
                    continue
                if isinstance(fact, ReleaseWanted):
                    self.stack.command(ReleaseByName(-1, fact.dock_index, fact.agent_id), self.now_ms)
                    continue
                self.facts.append(fact)
                if not hasattr(fact, "agent_id") or hasattr(fact, "dock_index"):
                    self._pass_on(self.port.receive(fact, self.now_ms))
        self._pass_on(self.port.advance(self.now_ms))

    def _pass_on(self, actions: list) -> None:
        for action in actions:
            if isinstance(action, PrimitiveSucceeded | PrimitiveFailed | DockChanged):
                self.outcomes.append((self.now_ms, action))
            else:
                self.stack.command(action, self.now_ms)


def carried(facts: list[LinkFact], agent_id: int) -> list[tuple[float, float]]:
    return [(it.north_m, it.east_m) for it in facts if isinstance(it, Carried) and it.agent_id == agent_id]


def documented(fault: Fault) -> str:
    """The reason on the page."""
    (reason,) = re.findall(r'"(.+)"', ROWS[fault.value])
    return reason


def test_every_fault_has_its_row_and_its_test() -> None:
    assert set(ROWS) == {fault.value for fault in Fault} - {"none"}


@pytest.mark.parametrize("stack", [WithA(Fault.NONE), WithB(Fault.NONE)], ids=["a", "b"])
def test_without_a_fault_all_primitives_succeed(stack: WithA | WithB) -> None:
    bench = Bench(stack)
    for primitive in (
        AWAY,
        CloseDock(2, 0, 7),
        Hold(3, NORTH_M + 10, EAST_M),
        OpenDock(4, 0, 7),
    ):
        bench.order(primitive)
        if primitive.command_id != 3:
            assert isinstance(bench.outcome(primitive.command_id)[1], PrimitiveSucceeded)
    assert bench.stack.core.dropped == {}


def test_of_a_silent_release_the_dock_is_open_after_two_seconds() -> None:
    bench = Bench(WithA(Fault.RELEASE_SILENT))
    bench.done(CloseDock(1, 0, 7))
    bench.order(OpenDock(2, 0, 7))
    begun_ms = bench.now_ms + 5_000  # the virtual profile's time
    at_ms, outcome = bench.outcome(2)
    assert isinstance(outcome, PrimitiveSucceeded) and at_ms == begun_ms + 2_000
    assert "2 s of silence" in ROWS["release_silent"]


def test_after_a_release_that_crashes_the_server_the_next_order_fails() -> None:
    bench = Bench(WithA(Fault.RELEASE_CRASHES))
    bench.done(CloseDock(1, 0, 7))
    assert isinstance(bench.done(OpenDock(2, 0, 7))[1], PrimitiveSucceeded)
    bench.order(replace(AWAY, command_id=3))
    begun_ms = bench.now_ms
    at_ms, outcome = bench.outcome(3)
    assert isinstance(outcome, PrimitiveFailed) and outcome.reason == documented(Fault.RELEASE_CRASHES)
    assert at_ms == begun_ms + 5_000


def test_a_go_to_whose_server_died_arrives_by_its_position_and_the_next_order_fails() -> None:
    loud, silent = Bench(WithA(Fault.NONE)), Bench(WithA(Fault.SERVER_DIES))
    for bench in (loud, silent):
        bench.order(AWAY)
    (loud_ms, _), (silent_ms, outcome) = loud.outcome(1), silent.outcome(1)
    assert isinstance(outcome, PrimitiveSucceeded)
    assert loud_ms < silent_ms <= loud_ms + 4_000 and ROWS["server_dies"].startswith("3 s within")
    assert silent.stack.core.dropped["the action server fell silent"] == 1
    assert silent.refused(CloseDock(2, 0, 7)) == documented(Fault.SERVER_DIES)


def test_a_go_to_of_a_dead_server_that_comes_no_nearer_has_failed() -> None:
    bench = Bench(WithA(Fault.SERVER_DIES))
    bench.order(AWAY)
    bench.run(4_000)
    bench.stack.vehicle._apad.receive(Coast(), bench.stack.vehicle.now_ms)  # the water stops it
    at_ms, outcome = bench.outcome(1)
    assert isinstance(outcome, PrimitiveFailed)
    assert outcome.reason == "the aPad's action server fell silent after it took the goal"
    assert at_ms < 20_000


@pytest.mark.parametrize("answers", [True, False])
def test_a_higher_dock_that_falls_silent_with_a_lower_ones_release_is_still_closed(answers: bool) -> None:
    stack = WithA(Fault.COUNTS_DOCKS)
    stack.answers = answers
    bench = Bench(stack)
    for n, agent_id in enumerate((7, 8, 9), start=1):
        bench.done(CloseDock(n, 0, agent_id))
    bench.done(OpenDock(4, 0, 7))
    bench.done(replace(AWAY, command_id=5))
    bench.run(20_000)
    assert bench.port.docked == ((1, 8), (2, 9))
    assert carried(bench.facts, 9)[-1] == pytest.approx(stack.vehicle._apad.dock_position(2), abs=1e-6)
    assert isinstance(bench.done(OpenDock(6, 2, 9))[1], PrimitiveSucceeded)
    assert stack.vehicle.held == ["amussel8"]
    assert (
        stack.core.dropped["silence on position_static of an aMussel that the aPad holds: dead reckoning"]
        == 1
    )
    assert "the bench asks" in ROWS["counts_docks"]


def test_what_a_crashed_server_held_is_let_go_after_a_silence() -> None:
    bench = Bench(WithA(Fault.RELEASE_CRASHES))
    for n, agent_id in enumerate((7, 8), start=1):
        bench.done(CloseDock(n, 0, agent_id))
    bench.done(OpenDock(3, 0, 7))
    assert bench.port.docked == ((1, 8),)
    bench.run(16_000)
    assert not bench.port.docked
    assert bench.stack.core.dropped["silence on position_static, taken for a release without an order"] == 1


def foreign(north_m: float) -> GoalOrder:
    return GoalOrder("another's-1", GO_TO, north_m, EAST_M)


def test_anothers_go_to_during_a_hold_is_let_end_and_then_the_hold_goes_on() -> None:
    bench = Bench(WithA(Fault.NONE))
    bench.order(Hold(1, NORTH_M, EAST_M))
    bench.run(5_000)
    bench.stack.send(foreign(NORTH_M + 6.0), bench.now_ms)
    north_m = []
    for _ in range(60):
        bench.run(1_000)
        north_m.append(bench.stack.vehicle.pose.north_m - NORTH_M)
    assert max(north_m) > 5.5, "the other's go-to was cut short"
    assert north_m[-1] == pytest.approx(0.0, abs=0.5)
    assert bench.stack.core.dropped == {"another client sent the aPad away from its hold": 1}
    assert isinstance(bench.port.running, Hold)


def test_a_real_apad_stays_where_another_sent_it_until_the_next_order() -> None:
    bench = Bench(WithA(Fault.NONE, takes_back=False))
    bench.order(Hold(2, NORTH_M, EAST_M))
    bench.run(5_000)
    bench.stack.send(foreign(NORTH_M + 6.0), bench.now_ms)
    bench.run(90_000)
    assert bench.stack.vehicle.pose.north_m == pytest.approx(NORTH_M + 6.0, abs=0.5)
    assert bench.stack.core.dropped == {"another client sent the aPad away from its hold": 1}
    assert [type(it) for it in bench.facts if isinstance(it, CommandedByOthers)] == [CommandedByOthers]
    assert isinstance(bench.done(AWAY)[1], PrimitiveSucceeded)


def test_a_hold_does_not_stop_what_another_ordered_of_a_real_apad() -> None:
    """A mission that stands aside orders a hold first."""
    bench = Bench(WithA(Fault.NONE, takes_back=False))
    bench.order(AWAY)
    bench.run(3_000)
    bench.stack.send(foreign(NORTH_M - 8.0), bench.now_ms)
    bench.run(2_000)
    assert any(isinstance(it, CommandedByOthers) for it in bench.facts)
    bench.order(Hold(2, bench.stack.vehicle.pose.north_m, EAST_M))
    bench.run(90_000)
    assert bench.stack.vehicle.pose.north_m == pytest.approx(NORTH_M - 8.0, abs=0.5)
    assert isinstance(bench.port.running, Hold)


def test_a_go_to_that_anothers_pre_empted_fails_when_the_others_has_ended() -> None:
    bench = Bench(WithA(Fault.NONE))
    bench.order(AWAY)
    bench.run(3_000)
    bench.stack.send(foreign(NORTH_M - 8.0), bench.now_ms)
    _, outcome = bench.outcome(1)
    assert isinstance(outcome, PrimitiveFailed)
    assert outcome.reason == "the aPad's action server reports PREEMPTED: another client's goal replaced it"
    assert bench.stack.vehicle.pose.north_m == pytest.approx(NORTH_M - 8.0, abs=0.6), (
        "the other's was cut short"
    )


def test_anothers_goal_that_never_ends_is_left_alone_for_a_minute() -> None:
    bench = Bench(WithA(Fault.NONE))
    stack = bench.stack
    bench.order(Hold(1, NORTH_M, EAST_M))
    bench.run(5_000)
    stack.send(GoalOrder("another's-1", 7), bench.now_ms)  # of no known kind: active for ever
    bench.run(59_000)
    assert stack.vehicle._goal is not None and stack.vehicle._goal.key == "another's-1"
    bench.run(3_000)
    assert stack.vehicle._goal is None or stack.vehicle._goal.key != "another's-1"


def test_a_perch_that_holds_nothing_fails() -> None:
    bench = Bench(WithA(Fault.PERCHES_NOTHING))
    reason = bench.refused(CloseDock(1, 0, 7))
    assert reason == documented(Fault.PERCHES_NOTHING) == bench.port.first_failure.reason


@pytest.mark.parametrize("kind", [WithA, WithB])
def test_a_vehicle_that_is_stuck_stalls(kind: type[WithA | WithB]) -> None:
    bench = Bench(kind(Fault.STUCK))
    bench.order(AWAY)
    begun_ms = bench.now_ms
    at_ms, outcome = bench.outcome(1)
    assert isinstance(outcome, PrimitiveFailed) and outcome.reason.startswith(documented(Fault.STUCK))
    assert at_ms == begun_ms + 60_000


def test_a_silent_vehicle_arrives_by_its_position() -> None:
    loud, silent = Bench(WithB(Fault.NONE)), Bench(WithB(Fault.SILENT))
    for bench in (loud, silent):
        bench.order(AWAY)
    (loud_ms, _), (silent_ms, outcome) = loud.outcome(1), silent.outcome(1)
    assert isinstance(outcome, PrimitiveSucceeded)
    assert loud_ms < silent_ms <= loud_ms + 4_000 and ROWS["silent"].startswith("3 s within")


@pytest.mark.parametrize(
    ("fault", "after_ms"),
    [(Fault.REFUSES, 3_000), (Fault.HANGS, 18_000), (Fault.DROPS, 3_000), (Fault.LIES, 3_000)],
)
def test_a_vehicle_that_does_otherwise_than_it_was_told(fault: Fault, after_ms: int) -> None:
    bench = Bench(WithB(fault))
    bench.order(AWAY)
    begun_ms = bench.now_ms
    at_ms, outcome = bench.outcome(1)
    assert isinstance(outcome, PrimitiveFailed) and outcome.reason == documented(fault)
    assert at_ms == pytest.approx(begun_ms + after_ms, abs=1_000)


def test_a_vehicle_that_blocks_takes_no_call_for_the_27_s_in_which_its_servo_turns() -> None:
    """By the row it is the call that waits: the vehicle itself would take the order."""
    vehicle = GenerationBVehicle(SimulatedAPad(POOL.apad), 0, Fault.BLOCKS)
    dock = DockingOrder(True, 0, 0.1, 0.3, 0.2, 0.2)
    assert not vehicle.blocks
    vehicle.receive(dock, 0)
    blocked = []
    for now_ms in range(0, 60_000, 1_000):
        vehicle.advance(now_ms)
        blocked.append(vehicle.blocks)
    assert blocked == [True] * 27 + [False] * 33
    assert documented(Fault.BLOCKS) == documented(Fault.HANGS)


def test_a_vehicle_that_wanders_is_told_again() -> None:
    bench = Bench(WithB(Fault.WANDERS, drift_m_s=(0.3, 0.0)))
    bench.order(Hold(1, NORTH_M, EAST_M))
    farthest_m = 0.0
    for _ in range(120):
        bench.run(1_000)
        farthest_m = max(farthest_m, bench.stack.vehicle.pose.north_m - NORTH_M)
    # 10 s at most at 0.3 m/s beyond the 3 m.
    assert 3.0 < farthest_m < 6.5
    assert bench.stack.core.dropped["the aPad did not hold its position, and got the hold again"] >= 3


def test_a_fault_of_the_other_generation_is_refused() -> None:
    assert {Fault.NONE, Fault.STUCK} == OF_A & OF_B and set(Fault) == OF_A | OF_B
    with pytest.raises(ValueError, match="of another generation"):
        replace(POOL.apad, fault=Fault.LIES)
