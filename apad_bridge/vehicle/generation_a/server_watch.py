"""Watches `action_server/status`: whether the server lives, and whether another party's goal runs on it."""

from __future__ import annotations

from collections import Counter

from apad_bridge.vehicle.generation_a.messages import ENDS, GoalStatusReceived
from apad_bridge.vehicle.telemetry import Readings

SERVER_SILENT_MS = 5_000
"""The status comes five times a second, goals or none. A server that is silent for so long, while the aPad's positions
come, is dead."""


class ServerWatch:
    """Keys of our goals begin with `nonce`; every other goal is another party's."""

    def __init__(self, nonce: str) -> None:
        self.dropped: Counter[str] = Counter()
        self.status_ms = -1
        """The newest stamp of a whole status."""
        self._nonce = nonce
        self._others: set[str] | None = None
        """Goals of others in the newest status; None before the first."""
        self._others_running = False
        self._has_new = False
        self._was_silent = False

    @property
    def others_run(self) -> bool:
        """Another party's goal was under way at the newest status."""
        return self._others_running

    def receive(self, message: GoalStatusReceived) -> None:
        if not message.whole:
            return
        self.status_ms = max(self.status_ms, message.at_ms)
        others = {it.key: it.code for it in message.words if not it.key.startswith(f"{self._nonce}-")}
        if self._others is not None:
            self._has_new |= bool(set(others) - self._others)
        self._others = set(others)
        self._others_running = any(code not in ENDS for code in others.values())

    def take_new(self) -> bool:
        """True, once, when another party has sent a goal."""
        has_new, self._has_new = self._has_new, False
        return has_new

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
