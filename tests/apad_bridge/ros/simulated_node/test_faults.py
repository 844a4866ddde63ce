"""Each fault of a stack as docs/apads.md describes it: port, core and simulated aPad in one loop without ROS."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from apad_bridge.scenario.faults import OF_A, OF_B, Fault
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import VehicleCommand
from apad_bridge.vehicle.docking import DockingPort
from apad_bridge.vehicle.generation_a import messages as shown_a
from apad_bridge.vehicle.generation_a.core import GenerationACore
from apad_bridge.vehicle.generation_a.messages import (
    GoalCode,
    GoalStatusEntry,
    GoalStatusReceived,
    HeldPositionReceived,
)
from apad_bridge.vehicle.generation_a.simulated import GenerationAVehicle
from apad_bridge.vehicle.generation_b import messages as shown_b
from apad_bridge.vehicle.generation_b.core import GenerationBCore
from apad_bridge.vehicle.generation_b.messages import ArmReceived, ServiceAnswered, StatusReceived
from apad_bridge.vehicle.generation_b.simulated import GenerationBVehicle
from apad_bridge.vehicle.primitives import (
    DockChanged,
    DockMussel,
    GoToPoint,
    HoldPosition,
    Outcome,
    Primitive,
    PrimitiveFailed,
    PrimitiveSucceeded,
    UndockMussel,
)
from apad_bridge.vehicle.simulated.apad import SimulatedAPad
from apad_bridge.vehicle.simulated.misses import Misses
from apad_bridge.vehicle.stack_messages import PosePublished, PoseReceived

ROOT = Path(__file__).parents[4]
POOL = load(ROOT / "launch_scripts" / "scenarios" / "pool-12.yaml")
NORTH_M, EAST_M = POOL.apad.start_m
DOCKING = POOL.mission.docking
BATTERY_V = (10.5, 16.0)
ROWS = dict(
    re.findall(
        r"^\| `(\w+)` \| [AB, ]+ \| .* \| (.*) \|$", (ROOT / "docs/apads.md").read_text(), re.MULTILINE
    )
)
AWAY = GoToPoint(1, NORTH_M + 10.0, EAST_M, 0.5, 0.5)


class WithA:
    """Generation A: converts the vehicle's output to the messages of its topics and its action server."""

    def __init__(self, fault: Fault) -> None:
        self.vehicle = GenerationAVehicle(SimulatedAPad(POOL.apad), 0.5, 0.5, 0, fault)
        self.core = GenerationACore(range(1, 10), BATTERY_V, "run")
        self._active: list[str] = []

    def advance(self, now_ms: int) -> None:
        self._receive(self.vehicle.advance(now_ms), now_ms)

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        order = self.core.command(command, now_ms)
        if order is None or self.vehicle.has_crashed:
            return
        goal = shown_a.Goal(order.key, order.kind, order.north_m, order.east_m, order.name)
        self._active.append(order.key)
        self._report(GoalStatusEntry(order.key, GoalCode.ACTIVE), now_ms)
        self._receive(self.vehicle.receive(goal, now_ms), now_ms)

    def _report(self, status: GoalStatusEntry, at_ms: int) -> None:
        self.core.receive(GoalStatusReceived(at_ms, (status,), whole=False), at_ms)

    def _receive(self, shown: list[shown_a.Published], now_ms: int) -> None:
        codes = {
            shown_a.Outcome.SUCCEEDED: GoalCode.SUCCEEDED,
            shown_a.Outcome.PREEMPTED: GoalCode.PREEMPTED,
            shown_a.Outcome.ABORTED: GoalCode.ABORTED,
        }
        for it in shown:
            match it:
                case PosePublished(at_ms, pose):
                    self.core.receive(
                        PoseReceived(at_ms, pose.north_m, pose.east_m, pose.heading_rad), now_ms
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
        self.core = GenerationBCore(range(1, 10), BATTERY_V, DOCKING, Misses(1, 0.0))

    def advance(self, now_ms: int) -> None:
        self._receive(self.vehicle.advance(now_ms), now_ms)

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        self.core.command(command, now_ms)

    def answer(self, now_ms: int) -> None:
        for call in self.core.take_calls():
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
                        PoseReceived(at_ms, pose.north_m, pose.east_m, pose.heading_rad), now_ms
                    )
                case shown_b.StatusPublished(at_ms, docking, status):
                    self.core.receive(StatusReceived(at_ms, docking, status), now_ms)
                case shown_b.ArmPublished(at_ms, arm):
                    dock_index = arm.is_open.index(True) if True in arm.is_open else None
                    self.core.receive(ArmReceived(at_ms, dock_index), now_ms)


class Bench:
    """A port with one of them, in ticks of a second; `outcomes` are its outcomes, with their ticks."""

    def __init__(self, stack: WithA | WithB) -> None:
        self.stack = stack
        self.port = DockingPort(DOCKING)
        self.now_ms = 0
        self.outcomes: list[tuple[int, Outcome]] = []
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
            if isinstance(self.stack, WithB):
                self.stack.answer(self.now_ms)
            for fact in self.stack.core.advance(self.now_ms):
                if not hasattr(fact, "agent_id") or hasattr(fact, "dock_index"):
                    self._pass_on(self.port.receive(fact, self.now_ms))
        self._pass_on(self.port.advance(self.now_ms))

    def _pass_on(self, actions: list) -> None:
        for action in actions:
            if isinstance(action, PrimitiveSucceeded | PrimitiveFailed | DockChanged):
                self.outcomes.append((self.now_ms, action))
            else:
                self.stack.command(action, self.now_ms)


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
        DockMussel(2, 0, 7),
        HoldPosition(3, NORTH_M + 10, EAST_M),
        UndockMussel(4, 0, 7),
    ):
        bench.order(primitive)
        if primitive.primitive_id != 3:
            assert isinstance(bench.outcome(primitive.primitive_id)[1], PrimitiveSucceeded)
    assert bench.stack.core.dropped == {}


def test_of_a_silent_release_the_dock_is_open_after_two_seconds() -> None:
    bench = Bench(WithA(Fault.RELEASE_SILENT))
    bench.order(DockMussel(1, 0, 7))
    bench.outcome(1)
    bench.order(UndockMussel(2, 0, 7))
    begun_ms = bench.now_ms + 5_000  # the virtual profile's time
    at_ms, outcome = bench.outcome(2)
    assert isinstance(outcome, PrimitiveSucceeded) and at_ms == begun_ms + 2_000
    assert "2 s of silence" in ROWS["release_silent"]


def test_after_a_release_that_crashes_the_server_the_next_order_fails() -> None:
    bench = Bench(WithA(Fault.RELEASE_CRASHES))
    bench.order(DockMussel(1, 0, 7))
    bench.outcome(1)
    bench.order(UndockMussel(2, 0, 7))
    assert isinstance(bench.outcome(2)[1], PrimitiveSucceeded)
    bench.order(replace(AWAY, primitive_id=3))
    begun_ms = bench.now_ms
    at_ms, outcome = bench.outcome(3)
    assert isinstance(outcome, PrimitiveFailed) and outcome.reason == documented(Fault.RELEASE_CRASHES)
    assert at_ms == begun_ms + 5_000


def test_a_perch_that_holds_nothing_fails() -> None:
    bench = Bench(WithA(Fault.PERCHES_NOTHING))
    bench.order(DockMussel(1, 0, 7))
    _, outcome = bench.outcome(1)
    assert isinstance(outcome, PrimitiveFailed) and outcome.reason == documented(Fault.PERCHES_NOTHING)
    assert bench.port.first_failure == outcome


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


def test_a_vehicle_that_wanders_is_told_again() -> None:
    bench = Bench(WithB(Fault.WANDERS, drift_m_s=(0.3, 0.0)))
    bench.order(HoldPosition(1, NORTH_M, EAST_M))
    farthest_m = 0.0
    for _ in range(120):
        bench.run(1_000)
        farthest_m = max(farthest_m, bench.stack.vehicle.pose.north_m - NORTH_M)
    # 10 s at most at 0.3 m/s beyond the 3 m.
    assert 3.0 < farthest_m < 6.5
    assert bench.stack.core.dropped["the aPad did not hold its position, and was told again"] >= 3


def test_a_fault_of_the_other_generation_is_refused() -> None:
    assert {Fault.NONE, Fault.STUCK} == OF_A & OF_B and set(Fault) == OF_A | OF_B
    with pytest.raises(ValueError, match="of the other generation"):
        replace(POOL.apad, fault=Fault.LIES)
