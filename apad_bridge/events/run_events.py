"""Events of a run as a whole: its begin, its end, and another supervisor that continues it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, TypedDict

from apad_bridge.events.event import Category, Event, Meaning, Uncounted


class EndReason(StrEnum):
    """`commands/outcome.py` gives each its exit code; the value is `end_reason` in the journal and in summary.json."""

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
    NODE_ENDED = "loss of the node"
    """Another told our node to end: a person by `rosnode kill`, or the master because a node took its name."""
    DISK_FULL = "a disk that takes no more"
    RECORDS_GONE = "loss of the run's directory"
    """The directory was deleted or moved while the run flew."""


class AgentStart(TypedDict):
    id: int
    north_m: float
    east_m: float
    primary: float
    secondary: float


class RepairedBag(TypedDict):
    name: str
    messages: int
    last_ms: int
    torn_bytes: int


@dataclass(frozen=True)
class RunBegan(Event):
    kind = "run"
    when = "the first line of a run"
    counted = Uncounted("it repeats the scenario")

    format: Annotated[int, Meaning("of the journal")]
    scenario: Annotated[str, Meaning("its name")]
    theta: Annotated[int, Meaning("agent time per mission time")]
    seed: Annotated[int, Meaning("of all that is random")]
    duration_s: Annotated[float, Meaning("how long the mission is", "s")]
    pool_threshold: Annotated[float, Meaning("charge at which an aMussel becomes a candidate", "0 to 1")]
    full_threshold: Annotated[float, Meaning("charge at which it counts as full", "0 to 1")]
    agents: Annotated[list[AgentStart], Meaning("where each aMussel starts, and its charges", "m, 0 to 1")]


@dataclass(frozen=True)
class TickPassed(Event):
    kind = "tick"
    when = "a tick without another event; its time shows the progress of the flight"
    counted = Uncounted("nothing happened")


@dataclass(frozen=True)
class RunEnded(Event):
    kind = "end"
    when = "the mission has ended"
    counted = ("end_reason",)

    reason: Annotated[str, Meaning("why, for people")]
    end_reason: Annotated[EndReason | None, Meaning("why: one of a fixed set")] = None

    def text(self) -> str:
        return f"the mission ended: {self.reason}"


@dataclass(frozen=True)
class RunResumed(Event):
    kind = "resumed"
    when = "another supervisor continues the run"
    counted = Uncounted("the records' own repair")
    category = Category.TROUBLE

    journal_dropped: Annotated[int, Meaning("lines of the journal that could not be read")]
    journal_torn_bytes: Annotated[int, Meaning("of a torn last line", "bytes")]
    bag_repaired: Annotated[
        RepairedBag | None, Meaning("the bag that was never closed; null if there was none")
    ]
    bag_lost_ms: Annotated[int, Meaning("samples that are lost from its end", "mission ms")]
    granted_ms: Annotated[
        int | None, Meaning("time without a supervisor, which the fleet lives through at once", "mission ms")
    ] = None

    def text(self) -> str:
        return "another supervisor continued"


@dataclass(frozen=True)
class KnowledgeRestored(Event):
    kind = "restored"
    when = "the knowledge that this supervisor restored"
    counted = Uncounted("the records' own repair")

    told: Annotated[list[str], Meaning("the lines printed for people")]
