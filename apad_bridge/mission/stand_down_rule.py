"""Detects an aPad that is stuck: one of several leaves its aMussels to others, and a single one says so and tries again."""

from __future__ import annotations

from apad_bridge.events.mission_events import PRE_EMPTED
from apad_bridge.events.run_events import EndReason
from apad_bridge.vehicle.outcomes import Outcome, PrimitiveFailed


class Breakdown:
    """Counts go-tos that failed in a row, and nothing else: a docking may miss, an aMussel may be deaf."""

    def __init__(self, after: int) -> None:
        """`after` failures in a row are a breakdown."""
        self._after = after
        self._taken = 0
        self._last_reason = ""
        self.failed = 0
        """Number of go-tos that failed since one last succeeded."""

    def go_to_ended(self, outcome: Outcome) -> None:
        if not isinstance(outcome, PrimitiveFailed):
            self.failed = self._taken = 0
        elif outcome.reason != PRE_EMPTED:
            self.failed, self._last_reason = self.failed + 1, outcome.reason

    def reason_to_end(self, battery: EndReason | None) -> EndReason | None:
        """None: this aPad stands down instead of ending, because others serve its aMussels."""
        return None

    def reason_to_stand_down(self, battery: EndReason | None) -> str | None:
        """The reason why the battery ends the aPad's work, or why the aPad is stuck; None without either."""
        return battery or self.take()

    def take(self) -> str | None:
        """The reason of a breakdown, once for each `after` failures in a row. None without a breakdown."""
        if self.failed < self._taken + self._after:
            return None
        self._taken = self.failed
        return f"{self.failed} go-tos in a row failed: {self._last_reason}"


class NeverStandsDown:
    """The rule of an aPad from which no other takes over: it tries again, and its mission ends with its battery."""

    def go_to_ended(self, outcome: Outcome) -> None:
        pass

    def reason_to_end(self, battery: EndReason | None) -> EndReason | None:
        return battery

    def reason_to_stand_down(self, battery: EndReason | None) -> None:
        return None


StandDownRule = Breakdown | NeverStandsDown
