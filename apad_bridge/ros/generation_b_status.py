"""What became of an order, made out of a status topic of generation B: its words name no order."""

from __future__ import annotations

from apad_bridge.vehicle.generation_b.messages import Status

GRACE_MS = 3_000
"""A vehicle that took an order and does not run it for so long has dropped it."""


class StatusWatch:
    """Of one order, from when it was sent. Words about an earlier order are still on their way then."""

    def __init__(self) -> None:
        self._is_running = False
        self._idle_since_ms: int | None = None
        self._last: Status | None = None

    def hear(self, status: Status, at_ms: int, *, answered: bool, plausible: bool) -> bool:
        """Whether the order is done. `answered`: the service took it; `plausible`: it looks done from where the aPad is."""
        self._last = status
        if status is Status.RUNNING:
            self._is_running, self._idle_since_ms = True, None
            return False
        if not answered:
            self._is_running = False
            return False
        if status is Status.DONE and (self._is_running or plausible):
            return True
        self._is_running = False
        if self._idle_since_ms is None:
            self._idle_since_ms = at_ms
        return False

    @property
    def was_heard(self) -> bool:
        return self._last is not None

    def why_lost(self, now_ms: int) -> str | None:
        """Why the vehicle is believed to run the order no more; None while it may."""
        if self._idle_since_ms is None or now_ms - self._idle_since_ms < GRACE_MS or self._last is None:
            return None
        return f"its status says {self._last.name}"
