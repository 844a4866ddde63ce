"""Watches the vehicle's own watchdog: a bench that flies beside a dead one believes in a stop that does not come."""

from __future__ import annotations

from collections.abc import Sequence

WATCHING = "WATCHING"
"""The state of `launch_scripts/vehicle_watchdog` in which a silence of the bench stops the vehicle."""
_STOPS = frozenset({"SILENT", "OFF"})
"""Its states while it stops the vehicle, perhaps without an answer, and after it has switched the thrusters off."""
FIRST_STATE_MS = 2_000
"""A watchdog of which nothing was heard for so long after the start counts as none, where an order waits for its word."""
UNWATCHED_MS = 15_000
"""A watchdog that has not said so for longer is lost. It says its state twice a second; a poor link has gaps of seconds."""
_LONGEST_STATE = 20


class WatchdogWatch:
    """`fault` is the reason why nobody watches; empty while the watchdog does, and where none is known or demanded."""

    def __init__(self, *, is_demanded: bool = False) -> None:
        """A demanded watchdog has to say `WATCHING` within `UNWATCHED_MS` of the first look, any other once at all."""
        self._is_demanded = is_demanded
        self._watched_ms: int | None = None
        """The newest time at which it watched; of a demanded one, at first the time of the first look."""
        self._says = ""
        self._said_ms: int | None = None
        self.fault = ""
        self.may_have_put_off = False
        """It has said, since this bench began to listen, that it stops the vehicle, or has switched the thrusters off."""

    @property
    def is_heard(self) -> bool:
        """It has said anything yet."""
        return self._said_ms is not None

    def look(self, said: Sequence[str], now_ms: int) -> bool:
        """Takes the states since the last look, in order. True when `fault` begins or ends with this look."""
        if said:
            self._says, self._said_ms = said[-1], now_ms
        self.may_have_put_off = self.may_have_put_off or not _STOPS.isdisjoint(said)
        if (self._says == WATCHING and said) or (self._watched_ms is None and self._is_demanded):
            self._watched_ms = now_ms
        was_lost = bool(self.fault)
        is_lost = self._watched_ms is not None and now_ms - self._watched_ms > UNWATCHED_MS
        self.fault = self._reason(now_ms) if is_lost else ""
        return is_lost != was_lost

    def _reason(self, now_ms: int) -> str:
        if self._said_ms is None or now_ms - self._said_ms > UNWATCHED_MS:
            return "the vehicle's watchdog is silent"
        return f"the vehicle's watchdog says {self._says[:_LONGEST_STATE]!r}"
