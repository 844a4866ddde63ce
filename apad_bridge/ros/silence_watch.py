"""Notices that a vehicle has fallen silent, and that it is heard again: its Wi-Fi, or itself after a reboot."""

from __future__ import annotations

from dataclasses import dataclass

SILENT_MS = 5_000
"""Positions come at 10 Hz: fifty of them missing are no jitter."""


@dataclass(frozen=True, slots=True)
class Silence:
    """It has begun, or with `is_silent` false it is over; `since_ms` is when the vehicle was last heard before it."""

    is_silent: bool
    since_ms: int


class SilenceWatch:
    """In mission time, from its first `look` on."""

    def __init__(self) -> None:
        self._since_ms: int | None = None

    def look(self, heard_ms: int, now_ms: int) -> Silence | None:
        """What changed by `now_ms`; `heard_ms` is when a position was last heard."""
        is_silent = now_ms - heard_ms >= SILENT_MS
        if is_silent and self._since_ms is None:
            self._since_ms = heard_ms
            return Silence(True, heard_ms)
        if not is_silent and self._since_ms is not None:
            since_ms, self._since_ms = self._since_ms, None
            return Silence(False, since_ms)
        return None
