"""The law of the queue: after a stop's bytes leave no bytes of an older order, and after an OFF's none of a HOLD.

Two threads are played here: the supervisor's, which orders and stops, and the sender's, which takes what came, asks the
gate, writes and hears answers. The test draws in which order their steps happen, also between the gate's last word and the
bytes. Gate, guarded vehicle and both cores are the real ones; the judge reads the written bytes alone.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations, count
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.scenario.blocks.mission_options import Docking, DockingProfile
from apad_bridge.scenario.choices import Generation
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
from apad_bridge.vehicle.order_queue import (
    CUT,
    PATIENCE_MS,
    REPLACED,
    STOP_PATIENCE_MS,
    STOPPED_BEFORE,
    TOO_LATE,
    CutLine,
    Ended,
    OpenLine,
    OrderQueue,
    Outgoing,
    QueueAction,
    Rank,
    Write,
)
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact
from apad_bridge.world.apad.dock_mechanisms import Misses
from apad_bridge.world.generation_b.docks import BenchDocks

HERE_M = (30.0, 30.0)
BOTH = (Generation.A, Generation.B)
DOCKING = Docking(profile=DockingProfile.VIRTUAL, dock_s=15, undock_s=5, timeout_s=200)
LINES = {Rank.ORDER: "orders", Rank.HOLD: "hold", Rank.OFF: "off"}
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
            holds = isinstance(order, Hold) and order.pre_empts
            rank = Rank.OFF if isinstance(order, Stop) else Rank.HOLD if holds else Rank.ORDER
            self._queue.append(Outgoing(call, rank, LINES[rank]))

    def close(self) -> None:
        pass


def queue_of(lets_go: Callable[[Cleared[Any]], bool]) -> OrderQueue:
    """A queue whose lines are open."""
    queue = OrderQueue(lets_go)
    for line in LINES.values():
        queue.add_line(line)
        queue.opened(line)
    return queue


class Crossing:
    """Both threads, and the wire."""

    def __init__(self, generation: Generation) -> None:
        guards: list[Guard] = unlimited_guards()
        safety = Safety(Gate(guards, PositionWatch(PositionLimits())), Monitor([]), needs_person=True)
        self._queue: deque[Outgoing] = deque()
        self.vehicle = GuardedVehicle(Link(generation, safety.gate, self._queue), safety)
        self.queue = queue_of(safety.gate.lets_go)
        self.queue.add_line("goals", answers=False)
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
                self.queue.put(self._queue.popleft(), self.now_ms)
            yield
            for action in self.queue.advance(self.now_ms):
                yield
                self._act(action)
            yield
            # A vehicle's answer is late, so that orders wait for those before them.
            if self._carried and cycle % 4 == 0:
                self.queue.answered(self._carried.pop(0), None)

    def _act(self, action: QueueAction) -> None:
        match action:
            case Write(outgoing):
                self.wire.append(_what(outgoing))
                if outgoing.line != "goals":
                    self._carried.append(outgoing.line)
            case CutLine(line):
                self._carried = [it for it in self._carried if it != line]
            case OpenLine(line):
                self.queue.opened(line)


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


# The queue alone.

LET_OUT = Gate.without_guards().clear(Stop(1), 0)
assert isinstance(LET_OUT, Cleared)
FIRST, SECOND, THIRD = (Outgoing(replace(LET_OUT), Rank.ORDER, "orders") for _ in range(3))
HOLD, LATER, OFF_ORDER = (
    Outgoing(replace(LET_OUT), rank, LINES[rank]) for rank in (Rank.HOLD, Rank.HOLD, Rank.OFF)
)
Step = tuple[str, Any, int, list[QueueAction]]
"""What the queue is told, with its argument and the time, and the actions that follow at that time."""
STORIES: dict[str, list[Step]] = {
    "an order waits for the one before it and makes way for a newer one": [
        ("put", FIRST, 0, [Write(FIRST)]),
        ("put", SECOND, 10, []),
        ("put", THIRD, 20, [Ended(SECOND, REPLACED)]),
        ("answered", "orders", 30, [Ended(FIRST, None), Write(THIRD)]),
    ],
    "a stop ends the order under way and the one that waits, and leaves in the same step": [
        ("put", FIRST, 0, [Write(FIRST)]),
        ("put", SECOND, 10, []),
        (
            "put",
            HOLD,
            20,
            [
                Ended(SECOND, STOPPED_BEFORE),
                CutLine("orders"),
                Ended(FIRST, CUT),
                Write(HOLD),
                OpenLine("orders"),
            ],
        ),
    ],
    "an off ends a hold under way, and no hold ends an off": [
        ("put", HOLD, 0, [Write(HOLD)]),
        ("put", OFF_ORDER, 10, [CutLine("hold"), Ended(HOLD, CUT), Write(OFF_ORDER), OpenLine("hold")]),
        ("opened", "hold", 20, []),
        ("put", LATER, 20, [Write(LATER)]),
    ],
    **{
        f"no answer is awaited for ever: {order.line}": [
            ("put", order, 0, [Write(order)]),
            ("wait", None, patience_ms - 1, []),
            ("wait", None, patience_ms, [CutLine(order.line), Ended(order, TOO_LATE), OpenLine(order.line)]),
        ]
        for order, patience_ms in ((FIRST, PATIENCE_MS), (OFF_ORDER, STOP_PATIENCE_MS))
    },
    "a line that had ended at the vehicle carries its order once more and no third time": [
        ("put", FIRST, 0, [Write(FIRST)]),
        ("ended", "orders", 10, [OpenLine("orders")]),
        ("opened", "orders", 20, [Write(FIRST)]),
        ("ended", "orders", 30, [Ended(FIRST, "the connection ended"), OpenLine("orders")]),
    ],
    "an order whose line ended makes way for a newer one that waits": [
        ("put", FIRST, 0, [Write(FIRST)]),
        ("put", SECOND, 10, []),
        ("ended", "orders", 20, [Ended(FIRST, "the connection ended"), OpenLine("orders")]),
        ("opened", "orders", 30, [Write(SECOND)]),
    ],
    "a hold whose line ended makes way for another one that waits": [
        ("put", HOLD, 0, [Write(HOLD)]),
        ("put", LATER, 10, []),
        ("ended", "hold", 20, [Ended(HOLD, "the connection ended"), OpenLine("hold")]),
        ("opened", "hold", 30, [Write(LATER)]),
    ],
    "a stop without a line waits for one and fails in time": [
        ("ended", "off", 0, [OpenLine("off")]),
        ("put", OFF_ORDER, 0, []),
        ("not_opened", "off", 10, []),
        ("wait", None, 600, [OpenLine("off")]),
        ("wait", None, STOP_PATIENCE_MS, [Ended(OFF_ORDER, "no connection to the vehicle within 3 s")]),
    ],
}


@pytest.mark.parametrize("story", STORIES.values(), ids=STORIES)
def test_the_queue_alone(story: list[Step]) -> None:
    queue = queue_of(lambda _: True)
    told: dict[str, Callable[[Any, int], object]] = {
        "put": queue.put,
        "answered": lambda line, _: queue.answered(line, None),
        "opened": lambda line, _: queue.opened(line),
        "ended": queue.ended,
        "not_opened": lambda line, now_ms: queue.not_opened(line, "nobody listens", now_ms),
        "wait": lambda _, now_ms: None,
    }
    for number, (what, argument, now_ms, actions) in enumerate(story):
        told[what](argument, now_ms)
        assert queue.advance(now_ms) == actions, number


def test_a_line_is_open_while_it_carries_a_call_and_not_after_its_end() -> None:
    queue, seen = queue_of(lambda _: True), {}
    for what, act in (
        ("free", lambda: None),
        ("busy", lambda: (queue.put(FIRST, 0), queue.advance(0))),
        ("ended", lambda: queue.ended("orders", 10)),
    ):
        act()
        seen[what] = queue.is_open("orders")
    assert seen == {"free": True, "busy": True, "ended": False}


@pytest.mark.parametrize(("order", "patience_ms"), [(FIRST, PATIENCE_MS), (OFF_ORDER, STOP_PATIENCE_MS)])
def test_an_order_is_due_when_its_patience_ends(order: Outgoing, patience_ms: int) -> None:
    queue = queue_of(lambda _: True)
    queue.put(order, 0)
    queue.advance(0)
    assert queue.next_due_ms() == patience_ms
