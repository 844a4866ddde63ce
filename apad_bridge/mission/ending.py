"""Why a mission ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class EndReason(StrEnum):
    """`runs/exits.py` gives each its exit code; the value is `end_reason` in the journal and in summary.json."""

    MISSION_TIME = "mission time"
    APAD_BATTERY = "the aPad's battery"
    END_BY = "the time to be home"
    OPERATOR = "the operator"
    """Ctrl-C, or a process that was told to end."""
    CALL = "a call"
    """A person's call of the ROS service that ends the mission."""
    FIRST_PLAN = "the dry run's plan"
    SCRIPT_ENDED = "the script's end"
    SCRIPT_ABORTED = "the script"
    """The script ended the mission, in its own words."""
    SCRIPT_FAILED = "failure of the script"
    """The script raised an error, or was stuck."""
    STRATEGY_FAILED = "failure of strategy"
    """A strategy raised an error, or gave a plan that cannot be flown."""
    FLEET_LOST = "loss of the fleet"
    """No agent lives, and none can be started again."""
    SEA_LOST = "loss of the sea"
    """The process is gone that owns the sea which several aPads share."""
    CLOCK_LOST = "loss of the clock"
    """A simulated aPad does not confirm the time, or nobody publishes /clock any more."""
    DISK_FULL = "a disk that takes no more"
    RECORDS_GONE = "loss of the run's directory"
    """The directory was deleted or moved while the run flew."""


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
