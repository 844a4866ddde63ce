"""The law of the road: after a stop's bytes leave no bytes of an older order, and after an OFF's none of a HOLD.

Two threads are played here: the supervisor's, which orders and stops, and the sender's, which takes what came, asks the
gate, writes and hears answers. The test draws in which order their steps happen, also between the gate's last word and the
bytes. Gate, guarded vehicle and both cores are the real ones; the judge reads the written bytes alone.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterator
from itertools import combinations, count
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.schema import Docking, DockingProfile
from apad_bridge.vehicle.commands import GoTo, Hold, PoseReported, Stop
from apad_bridge.vehicle.generation_a.core import GenerationACore
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_a.messages import GoalOrder
from apad_bridge.vehicle.generation_b.core import GenerationBCore
from apad_bridge.vehicle.guards.gate import Gate, Safety
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.guards.guards import Guard, unlimited_guards
from apad_bridge.vehicle.guards.monitor import Monitor
from apad_bridge.vehicle.guards.position_watch import PositionLimits, PositionWatch
from apad_bridge.vehicle.sending_road import (
    CUT,
    PATIENCE_MS,
    REPLACED,
    STOP_PATIENCE_MS,
    STOPPED_BEFORE,
    TOO_LATE,
    CutLine,
    Ended,
    OpenLine,
    Outgoing,
    Rank,
    RoadAction,
    SendingRoad,
    Write,
)
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact
from apad_bridge.world.apad.dock_mechanisms import Misses
from apad_bridge.world.generation_b.docks import BenchDocks

HERE_M = (30.0, 30.0)
BOTH = (Generation.A, Generation.B)
DOCKING = Docking(profile=DockingProfile.VIRTUAL, dock_s=15, undock_s=5, timeout_s=200)
MOVES, HOLDS, OFF = "moves", "holds", "off"


class Link:
    """A link of either generation, whose orders go into the sender's queue, with the lines that it has on ROS."""

    def __init__(self, generation: Generation, gate: Gate, queue: deque[Outgoing]) -> None:
        self._queue = queue
        battery_v, ids = (10.5, 16.0), range(1, 10)
        self.core: GenerationACore | GenerationBCore
        if generation is Generation.A:
            self.core = GenerationACore(ReportedDocks(ids), battery_v, "run", takes_back=False, gate=gate)
        else:
            self.core = GenerationBCore(
                BenchDocks(ids, Misses(1, 0.0)), battery_v, DOCKING, takes_back=False, gate=gate
            )

    def advance(self, now_ms: int) -> list[LinkFact]:
        self.core.receive(PoseReported(now_ms, *HERE_M, 0.0), now_ms)
        return self.core.advance(now_ms)

    def command(self, cleared: Cleared[Any], now_ms: int) -> None:
        goal = self.core.command(cleared, now_ms)
        if isinstance(self.core, GenerationACore):
            if goal is not None:
                self._queue.append(Outgoing(goal, Rank.HOLD if goal.order.pre_empts else Rank.ORDER, "goals"))
            if (off := self.core.take_off_order()) is not None:
                self._queue.append(Outgoing(off, Rank.OFF, "off"))
            return
        for call in self.core.take_calls():
            order = call.order.order
            if isinstance(order, Stop):
                self._queue.append(Outgoing(call, Rank.OFF, "off"))
            elif isinstance(order, Hold) and order.pre_empts:
                self._queue.append(Outgoing(call, Rank.HOLD, "hold"))
            else:
                self._queue.append(Outgoing(call, Rank.ORDER, "orders"))

    def close(self) -> None:
        pass


class Crossing:
    """Both threads, and the wire."""

    def __init__(self, generation: Generation) -> None:
        guards: list[Guard] = unlimited_guards()
        safety = Safety(Gate(guards, PositionWatch(PositionLimits())), Monitor([]), needs_person=True)
        self._queue: deque[Outgoing] = deque()
        self.vehicle = GuardedVehicle(Link(generation, safety.gate, self._queue), safety)
        self.road = SendingRoad(safety.gate.lets_go)
        for line in ("orders", "hold", "off"):
            self.road.add_line(line)
            self.road.opened(line)
        self.road.add_line("goals", answers=False)
        self.wire: list[str] = []
        self._carried: list[str] = []
        """The lines with a call that the vehicle has not answered."""
        self.now_ms = 1_000
        self.vehicle.advance(self.now_ms)

    # The supervisor's steps.

    def go(self, number: int) -> None:
        self.vehicle.command(GoTo(number, 35.0, 30.0 + number, 0.5, 0.5), self.now_ms)

    def stop(self, *, off: bool = False) -> None:
        self.vehicle.stop("Anna", self.now_ms, off=off)

    def tick(self) -> None:
        self.now_ms += 1_000
        self.vehicle.advance(self.now_ms)

    # The sender's steps: a generator, which the test stops between the gate's word and the bytes.

    def send(self) -> Iterator[None]:
        for cycle in count(1):
            if self._queue:
                self.road.put(self._queue.popleft(), self.now_ms)
            yield
            for action in self.road.advance(self.now_ms):
                yield
                self._act(action)
            yield
            # A vehicle's answer is late, so that orders wait for those before them.
            if self._carried and cycle % 4 == 0:
                self.road.answered(self._carried.pop(0), None)

    def _act(self, action: RoadAction) -> None:
        match action:
            case Write(outgoing):
                self.wire.append(_what(outgoing))
                if outgoing.line != "goals":
                    self._carried.append(outgoing.line)
            case CutLine(line):
                self._carried = [it for it in self._carried if it != line]
            case OpenLine(line):
                self.road.opened(line)


def _what(outgoing: Outgoing) -> str:
    """The meaning of an order's bytes to a vehicle."""
    order = outgoing.cleared.order
    if outgoing.line == "off":
        return OFF
    if isinstance(order, GoalOrder):
        return HOLDS if order.pre_empts else MOVES
    return HOLDS if isinstance(order.order, Hold) and order.order.pre_empts else MOVES


def judge(wire: list[str]) -> None:
    """The law, by the order of the bytes."""
    first_stop = min((n for n, it in enumerate(wire) if it in (HOLDS, OFF)), default=len(wire))
    first_off = min((n for n, it in enumerate(wire) if it == OFF), default=len(wire))
    assert MOVES not in wire[first_stop:], wire
    assert HOLDS not in wire[first_off:], wire


def flown(generation: Generation, acts: list[Callable[[Crossing], None]], turns: list[bool]) -> list[str]:
    """Plays the supervisor's acts where a turn is True, and the sender's next step where it is False; then both on."""
    crossing = Crossing(generation)
    sender, left = crossing.send(), deque(acts)
    for is_supervisors in turns:
        if is_supervisors and left:
            left.popleft()(crossing)
        else:
            next(sender)
    for act in left:
        act(crossing)
    for _ in range(90):
        next(sender)
    return crossing.wire


@pytest.mark.parametrize("generation", BOTH)
def test_all_interleavings_of_two_calls_a_stop_and_an_off(generation: Generation) -> None:
    acts: list[Callable[[Crossing], None]] = [
        lambda it: it.go(1),
        lambda it: it.go(2),
        lambda it: it.stop(),
        lambda it: it.stop(off=True),
    ]
    steps, moved = 16, 0
    for places in combinations(range(steps), len(acts)):
        wire = flown(generation, acts, [step in places for step in range(steps)])
        judge(wire)
        assert wire[-1] == OFF
        moved += MOVES in wire
    assert moved > 0, "no order ever left before the stop: the schedules tell nothing"


_ACTS: dict[str, Callable[[Crossing], None]] = {
    "stop": lambda it: it.stop(),
    "off": lambda it: it.stop(off=True),
    "hands": lambda it: it.vehicle.stop("Bo", it.now_ms, hands=True),
    "tick": Crossing.tick,
}


@pytest.mark.parametrize("generation", BOTH)
@settings(max_examples=1000, deadline=None)
@given(st.data())
def test_drawn_interleavings_of_four_calls_and_stops(generation: Generation, data: st.DataObject) -> None:
    names = data.draw(
        st.permutations(["go 1", "go 2", "go 3", "go 4", "stop", "off", "hands", "tick", "tick"])
    )
    acts = [
        _ACTS[name] if name in _ACTS else (lambda it, number=int(name[3:]): it.go(number)) for name in names
    ]
    seed = data.draw(st.integers(0, 2**32))
    rng = random.Random(seed)
    wire = flown(generation, acts, [rng.random() < 0.25 for _ in range(60)])
    judge(wire)
    assert OFF in wire


# The road alone.


class Alone:
    def __init__(self) -> None:
        self.road = SendingRoad(lambda _: True)
        for line in ("orders", "hold", "off"):
            self.road.add_line(line)
            self.road.opened(line)

    def put(self, rank: Rank, now_ms: int) -> Outgoing:
        let_out = Gate.without_guards().clear(Stop(1), 0)
        assert isinstance(let_out, Cleared)
        outgoing = Outgoing(let_out, rank, {Rank.ORDER: "orders", Rank.HOLD: "hold", Rank.OFF: "off"}[rank])
        self.road.put(outgoing, now_ms)
        return outgoing


@pytest.fixture
def alone() -> Alone:
    return Alone()


def test_an_order_waits_for_the_one_before_it_and_makes_way_for_a_newer_one(alone: Alone) -> None:
    first = alone.put(Rank.ORDER, 0)
    assert alone.road.advance(0) == [Write(first)]
    second = alone.put(Rank.ORDER, 10)
    third = alone.put(Rank.ORDER, 20)
    assert alone.road.advance(20) == [Ended(second, REPLACED)]
    alone.road.answered("orders", None)
    assert alone.road.advance(30) == [Ended(first, None), Write(third)]


def test_a_stop_ends_the_order_under_way_and_the_one_that_waits_and_leaves_in_the_same_step(
    alone: Alone,
) -> None:
    under_way = alone.put(Rank.ORDER, 0)
    alone.road.advance(0)
    waits = alone.put(Rank.ORDER, 10)
    stop = alone.put(Rank.HOLD, 20)
    actions = alone.road.advance(20)
    assert actions[:4] == [
        Ended(waits, STOPPED_BEFORE),
        CutLine("orders"),
        Ended(under_way, CUT),
        Write(stop),
    ]
    assert actions[4:] == [OpenLine("orders")]


def test_an_off_ends_a_hold_under_way_and_no_hold_ends_an_off(alone: Alone) -> None:
    hold = alone.put(Rank.HOLD, 0)
    alone.road.advance(0)
    off = alone.put(Rank.OFF, 10)
    assert alone.road.advance(10)[:3] == [CutLine("hold"), Ended(hold, CUT), Write(off)]
    alone.road.opened("hold")
    later = alone.put(Rank.HOLD, 20)
    assert alone.road.advance(20) == [Write(later)]


@pytest.mark.parametrize(("rank", "patience_ms"), [(Rank.ORDER, PATIENCE_MS), (Rank.OFF, STOP_PATIENCE_MS)])
def test_no_answer_is_awaited_for_ever(alone: Alone, rank: Rank, patience_ms: int) -> None:
    order = alone.put(rank, 0)
    alone.road.advance(0)
    assert alone.road.next_due_ms() == patience_ms and alone.road.advance(patience_ms - 1) == []
    assert Ended(order, TOO_LATE) in alone.road.advance(patience_ms)


def test_a_line_that_had_ended_at_the_vehicle_carries_its_order_once_more_and_no_third_time(
    alone: Alone,
) -> None:
    order = alone.put(Rank.ORDER, 0)
    alone.road.advance(0)
    alone.road.ended("orders", 10)
    assert alone.road.advance(10) == [OpenLine("orders")]
    alone.road.opened("orders")
    assert alone.road.advance(20) == [Write(order)]
    alone.road.ended("orders", 30)
    assert [type(it) for it in alone.road.advance(30)] == [Ended, OpenLine]


def test_a_stop_without_a_line_waits_for_one_and_fails_in_time(alone: Alone) -> None:
    alone.road.ended("off", 0)
    off = alone.put(Rank.OFF, 0)
    assert alone.road.advance(0) == [OpenLine("off")]
    alone.road.not_opened("off", "nobody listens", 10)
    assert alone.road.advance(600) == [OpenLine("off")]
    (ended,) = alone.road.advance(STOP_PATIENCE_MS)
    assert isinstance(ended, Ended) and ended.outgoing is off and ended.refused is not None
