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

    @classmethod
    def restored(cls, text: str, reason: str | None) -> MissionEnd:
        """An end from a record. Records of older versions have the text alone, whose beginning names the reason."""
        if reason is not None:
            return cls(EndReason(reason), text)
        return cls(next((it for it in EndReason if text.startswith(it)), EndReason.SCRIPT_ABORTED), text)
