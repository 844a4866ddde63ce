"""Detects that one of several aPads is stuck and has to leave its aMussels to others."""

from __future__ import annotations

from apad_bridge.vehicle.docking import PRE_EMPTED
from apad_bridge.vehicle.primitives import GoToPoint, Outcome, Primitive, PrimitiveFailed


class Breakdown:
    """Counts go-tos that failed in a row, and nothing else: a docking may miss, an aMussel may be deaf."""

    def __init__(self, after: int) -> None:
        """`after` failures in a row are a breakdown."""
        self._after = after
        self._failed = 0
        self._last_reason = ""

    def note(self, primitive: Primitive, outcome: Outcome) -> None:
        if not isinstance(primitive, GoToPoint):
            return
        if not isinstance(outcome, PrimitiveFailed):
            self._failed = 0
        elif outcome.reason != PRE_EMPTED:
            self._failed, self._last_reason = self._failed + 1, outcome.reason

    def take(self) -> str | None:
        """The reason of a breakdown, once; the count then starts again. None without a breakdown."""
        if self._failed < self._after:
            return None
        self._failed = 0
        return f"{self._after} go-tos in a row failed: {self._last_reason}"
