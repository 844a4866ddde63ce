"""Why a mission ended."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.events.run import EndReason


@dataclass(frozen=True, slots=True)
class MissionEnd:
    """A reason, and the text for people where it says more than the reason; the text alone is `str(end)`."""

    reason: EndReason
    text: str = ""

    def __str__(self) -> str:
        return self.text or self.reason.value
