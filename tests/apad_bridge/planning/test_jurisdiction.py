"""Several aPads divide the fleet by themselves: no two are granted one aMussel, their shares agree, and nobody waits long."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.planning.allocation import Point, allocate
from apad_bridge.planning.jurisdiction import Jurisdiction, OwnSight, PeerState, Terms

NAMES = ("a", "b", "c", "d", "e")
STORM = Terms(lease_ms=100, clock_error_ms=40, margin_ms=30)


class Storm:
    """Any aPad claims one aMussel at any time; each message takes its own time, arrives twice or never; aPads are cut off
    from others, and killed and resumed. An observer who sees all clocks looks on.

    An aPad acts by its grants until its next `advance`, for `margin_ms` at most.
    """

    def __init__(self, seed: int, count: int) -> None:
        self.random = random.Random(seed)
        self.names = NAMES[:count]
        self.now_ms = 0
        self.offset_ms = {it: self.random.choice((0, STORM.clock_error_ms)) for it in self.names}
        self.group = dict.fromkeys(self.names, 0)
        self.wants = dict.fromkeys(self.names, False)
        self.under_way: list[tuple[int, str, tuple[PeerState, ...]]] = []
        self.parts = {it: self.started(it) for it in self.names}
        self.idle: set[str] = set()
        # Each storm has weather of its own: rare faults are found where others are absent.
        self.cut, self.change, self.kill, self.pause = (self.random.choice((0, 0.02, 0.1)) for _ in range(4))
        self.times_ms = self.random.choice(((1, 5, 10), (10, 20), (1, 20, 60)))
        self.delays_ms = self.random.choice(((0,), (0, 10, 80), (0, 200)))

    def clock_ms(self, name: str) -> int:
        return self.now_ms + self.offset_ms[name]

    def started(self, name: str, votes_from_ms: int = 0) -> Jurisdiction:
        state = PeerState(name, (0.0, 0.0), self.clock_ms(name) - 1)
        return Jurisdiction(name, [state], self.names, STORM, votes_from_ms)

    def step(self) -> None:
        draw = self.random
        self.now_ms += draw.choice(self.times_ms)
        if draw.random() < self.cut:
            self.group = {it: draw.randrange(2) for it in self.names}
        if draw.random() < self.pause:
            self.idle ^= {draw.choice(self.names)}
        if draw.random() < self.change + 0.02:
            self.wants[draw.choice(self.names)] ^= True
        if draw.random() < self.kill:
            name = draw.choice(self.names)
            self.parts[name] = self.started(name, Jurisdiction.votes_again_ms(self.clock_ms(name), STORM))
        self.deliver()
        for name in draw.sample(self.names, len(self.names)):
            if name not in self.idle and draw.random() < 0.7:
                self.look(name)

    def look(self, name: str) -> None:
        part, draw = self.parts[name], self.random
        if self.clock_ms(name) <= part.known[name].stamp_ms:
            return
        part.advance(OwnSight(busy=frozenset({7} if self.wants[name] else ())), self.clock_ms(name))
        for other in self.names:
            for _ in range(draw.choice((0, 1, 1, 2))):
                if self.group[other] == self.group[name]:
                    due_ms = self.now_ms + draw.choice(self.delays_ms)
                    self.under_way.append((due_ms, other, tuple(part.known.values())))

    def deliver(self) -> None:
        due = [it for it in self.under_way if it[0] <= self.now_ms]
        self.under_way = [it for it in self.under_way if it[0] > self.now_ms]
        self.random.shuffle(due)
        for _, name, states in due:
            self.parts[name].receive(states)

    def holders(self) -> list[str]:
        return [
            name
            for name, part in self.parts.items()
            if 7 in part.granted and self.clock_ms(name) <= part.known[name].stamp_ms + STORM.margin_ms
        ]


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 5))
def test_no_two_are_granted_one_aMussel_whatever_becomes_of_messages_and_aPads(seed: int, count: int) -> None:
    storm = Storm(seed, count)
    for _ in range(200):
        storm.step()
        assert len(storm.holders()) <= 1
