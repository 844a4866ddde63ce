"""Watches the action server: whether it lives, whether another party's goal runs on it, and which node sent that goal."""

from __future__ import annotations

from collections import Counter

from apad_bridge.vehicle.generation_a.messages import ENDS, GoalSeen, GoalStatusReceived
from apad_bridge.vehicle.telemetry import Readings

SERVER_SILENT_MS = 5_000
"""The status comes five times a second, goals or none. A server that is silent for so long, while the aPad's positions
come, is dead."""
UNSEEN_MS = 500
"""A goal that runs for so long and was never seen on its way to the server: its client sent it before this end was
connected to it. Nobody here can tell where it leads."""
SEEN_MS = 10_000
"""A goal that was seen is remembered for so long before it runs."""


class ServerWatch:
    """Keys of our goals begin with `nonce`; every other goal is another party's. By the nodes `pilots` a pilot steers."""

    def __init__(self, nonce: str, pilots: frozenset[str] = frozenset()) -> None:
        self.dropped: Counter[str] = Counter()
        self.status_ms = -1
        """The newest stamp of a whole status."""
        self._nonce = nonce
        self._pilots = pilots
        self._others: set[str] | None = None
        """Goals of others in the newest status; None before the first."""
        self._running: set[str] = set()
        """Goals of others under way at the newest status."""
        self._clients: dict[str, str] = {}
        """The node of each goal that was seen on its way to the server, by key."""
        self._seen_ms: dict[str, int] = {}
        """The time at which each goal was seen on its way to the server, by key."""
        self._first_ms: dict[str, int] = {}
        """The time of the first status of each goal of others since the bench was opened, by key, until it is judged."""
        self._new: list[str] = []
        self._was_silent = False

    @property
    def others_run(self) -> bool:
        """Another party's goal was under way at the newest status."""
        return bool(self._running)

    @property
    def others_under_way(self) -> list[str]:
        """Keys of other parties' goals that run, or were seen on their way to the server since the newest status."""
        return sorted(self._running | (set(self._clients) - (self._others or set())))

    @property
    def pilot_runs(self) -> bool:
        """A goal of a node by which a pilot steers was under way at the newest status."""
        return any(self.client_of(key) in self._pilots for key in self._running)

    def is_ours(self, key: str) -> bool:
        return key.startswith(f"{self._nonce}-")

    def client_of(self, key: str) -> str:
        """The node that sent the goal: as seen, or by the form NODE-NUMBER-TIME that actionlib gives a key."""
        if key in self._clients:
            return self._clients[key]
        parts = key.rsplit("-", 2)
        return parts[0] if len(parts) == 3 and parts[0].startswith("/") else ""

    def see(self, goal: GoalSeen) -> None:
        """Takes a goal on its way to the server."""
        if not self.is_ours(goal.key):
            self._clients[goal.key] = goal.client
            self._seen_ms[goal.key] = goal.at_ms

    def receive(self, message: GoalStatusReceived) -> None:
        if not message.whole:
            return
        self.status_ms = max(self.status_ms, message.at_ms)
        others = {it.key: it.code for it in message.words if not self.is_ours(it.key)}
        if self._others is not None:
            new = [key for key in others if key not in self._others]
            self._new += [self.client_of(key) for key in new]
            self._first_ms |= dict.fromkeys(new, message.at_ms)
        self._others = set(others)
        self._running = {key for key, code in others.items() if code not in ENDS}
        self._clients = {key: node for key, node in self._clients.items() if key in self._others}

    def take_new(self) -> list[str]:
        """The nodes of the goals that other parties have sent since the last call; empty names for unknown ones."""
        new, self._new = self._new, []
        return new

    def take_unseen(self, now_ms: int) -> list[str]:
        """The nodes of other parties' goals that run, and were not seen on their way to the server, each goal once."""
        due = [key for key, at_ms in self._first_ms.items() if now_ms - at_ms >= UNSEEN_MS]
        for key in due:
            del self._first_ms[key]
        unseen = [self.client_of(key) for key in due if key in self._running and key not in self._seen_ms]
        kept = self._others or set()
        self._seen_ms = {k: at for k, at in self._seen_ms.items() if k in kept or now_ms - at < SEEN_MS}
        return [it for it in unseen if it not in self._pilots]

    def silent_for_ms(self, readings: Readings, since_ms: int = -1) -> int:
        """Time of the server's silence, from `since_ms` on, while the aPad's positions came."""
        return readings.position_ms - max(self.status_ms, readings.heard_since_ms, since_ms)

    def lives(self, readings: Readings) -> bool:
        return self.status_ms >= 0 and self.silent_for_ms(readings) < SERVER_SILENT_MS

    def look(self, readings: Readings) -> None:
        """Counts each time at which the server falls silent."""
        is_silent = self.status_ms >= 0 and self.silent_for_ms(readings) >= SERVER_SILENT_MS
        if is_silent and not self._was_silent:
            self.dropped["the action server fell silent"] += 1
        self._was_silent = is_silent
