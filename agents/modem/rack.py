"""All modems of a fleet, simulated in full: if somebody can open one of them, all must answer as modems do.

A rack has the three verbs of a modem, and adds the node to each action. A simulated host needs no serial line to its
modem; an opened modem has a line for whoever opened it.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Mapping
from dataclasses import replace

from agents.modem.facts import ModemAction, ModemStimulus
from agents.modem.modem import Modem
from agents.modem.modem_model import ModemConfig
from firmware_model.keyed_hash import blake2b

NodeAction = tuple[int, ModemAction]
"""A node, and an action of its modem."""


class Rack:
    """The modems with these `addresses`; `opened` nodes have a serial line. Actions come in the order of time."""

    def __init__(
        self, config: ModemConfig, addresses: Mapping[int, int], opened: Collection[int], now_ms: int = 0
    ) -> None:
        self.opened = frozenset(opened)
        self._modems = {
            node: Modem(
                replace(config, lines=int(node in self.opened), unique_id=_chip(node)), address, now_ms
            )
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

    def advance(self, now_ms: int) -> list[NodeAction]:
        """Lets time pass for all modems (ValueError if it went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        actions: list[NodeAction] = []
        while (due_ms := self.next_due_ms) is not None and due_ms <= now_ms:
            self._now_ms = due_ms
            node = self._heap[0][1]
            actions += [(node, action) for action in self._modems[node].advance(due_ms)]
            self._schedule(node)
        self._now_ms = now_ms
        return actions

    def receive(self, node: int, stimulus: ModemStimulus, now_ms: int) -> list[NodeAction]:
        """Takes a fact for one modem at `now_ms`, after everything that was due by then."""
        actions = self.advance(now_ms)
        actions += [(node, action) for action in self._modems[node].receive(stimulus, now_ms)]
        self._schedule(node)
        return actions

    def _schedule(self, node: int) -> None:
        if (due_ms := self._modems[node].next_due_ms) is None:
            self._due_ms.pop(node, None)
        elif self._due_ms.get(node) != due_ms or due_ms <= self._now_ms:
            self._due_ms[node] = due_ms
            heapq.heappush(self._heap, (due_ms, node))


def _chip(node: int) -> int:
    """The serial number of a node's modem: 96 bits of its own, the same in every run."""
    return int.from_bytes(
        blake2b(node.to_bytes(4, "big", signed=True), digest_size=12, person=b"chip").digest(), "big"
    )
