"""All modems of a fleet side by side, as machines: where one of them can be opened, all must answer as modems do.

Three verbs, like one modem: what comes out is told with whose it is. Modems whose hosts are simulated are wired to them
without a line; those that are opened have one for whoever opened them.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Mapping
from dataclasses import replace

from agents.modem.facts import Action, Stimulus
from agents.modem.firmware import ModemConfig
from agents.modem.modem import Modem

Did = tuple[int, Action]
"""A node, and what its modem did."""


class Rack:
    """`addresses` of all nodes; `opened` are those with a serial line. What they do is told in the order of time."""

    def __init__(
        self, config: ModemConfig, addresses: Mapping[int, int], opened: Collection[int], now_ms: int = 0
    ) -> None:
        self.opened = frozenset(opened)
        self._modems = {
            node: Modem(replace(config, lines=int(node in self.opened)), address, now_ms)
            for node, address in sorted(addresses.items())
        }
        self._due_ms: dict[int, int] = {}
        self._heap: list[tuple[int, int]] = []
        self._now_ms = now_ms

    def __getitem__(self, node: int) -> Modem:
        return self._modems[node]

    @property
    def next_due_ms(self) -> int | None:
        while self._heap and self._due_ms.get(self._heap[0][1]) != self._heap[0][0]:
            heapq.heappop(self._heap)
        return self._heap[0][0] if self._heap else None

    def advance(self, now_ms: int) -> list[Did]:
        """Lets time pass for all (ValueError if it went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        did: list[Did] = []
        while (due_ms := self.next_due_ms) is not None and due_ms <= now_ms:
            self._now_ms = due_ms
            node = self._heap[0][1]
            did += [(node, action) for action in self._modems[node].advance(due_ms)]
            self._plan(node)
        self._now_ms = now_ms
        return did

    def receive(self, node: int, stimulus: Stimulus, now_ms: int) -> list[Did]:
        """Takes a fact for one modem at `now_ms`, after everything that was due by then."""
        did = self.advance(now_ms)
        did += [(node, action) for action in self._modems[node].receive(stimulus, now_ms)]
        self._plan(node)
        return did

    def _plan(self, node: int) -> None:
        due_ms = self._modems[node].next_due_ms
        if due_ms is None:
            self._due_ms.pop(node, None)
        elif self._due_ms.get(node) != due_ms or due_ms <= self._now_ms:
            self._due_ms[node] = due_ms
            heapq.heappush(self._heap, (due_ms, node))
