"""ROS-free messages of generation A: goals, the aPad's answers, and the simulated aPad's messages.

Stamps are mission milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.stack_messages import BatteryReceived, StateRefReceived

GO_TO, PERCH, RELEASE = 0, 1, 2
"""Kinds of goals, by their id."""
OBJECT_PREFIX = "amussel"
"""An object that a dock holds is called by this and the aMussel's id."""


class GoalCode(IntEnum):
    """Codes of actionlib_msgs/GoalStatus; only the client sets LOST."""

    PENDING = 0
    ACTIVE = 1
    PREEMPTED = 2
    SUCCEEDED = 3
    ABORTED = 4
    REJECTED = 5
    PREEMPTING = 6
    RECALLING = 7
    RECALLED = 8
    LOST = 9


ENDS = frozenset(
    {
        GoalCode.PREEMPTED,
        GoalCode.SUCCEEDED,
        GoalCode.ABORTED,
        GoalCode.REJECTED,
        GoalCode.RECALLED,
        GoalCode.LOST,
    }
)
"""The codes that end a goal."""


# Messages between the bridge and an aPad.


@dataclass(frozen=True, slots=True)
class GoalOrder:
    """A goal to send: `kind` 0 goes to (north, east), 1 perches `name`, 2 releases `name`."""

    key: str
    kind: int
    north_m: float = 0.0
    east_m: float = 0.0
    name: str = ""
    agent_id: int = field(default=0, compare=False)
    """The aMussel that is called `name`; 0 for a go-to."""
    pre_empts: bool = field(default=False, compare=False)
    """A stop's: it takes the vehicle from every other client."""
    ends: tuple[str, ...] = field(default=(), compare=False)
    """The goals to cancel before a stop's, by key. A cancel of all could overtake the stop's own goal, and end it."""


@dataclass(frozen=True, slots=True)
class OffOrder:
    """Ends every client's goal, and switches the controllers off; `number` comes back with the answer."""

    number: int


@dataclass(frozen=True, slots=True)
class OffAnswered:
    """The vehicle has switched its controllers off; or the reason why it has not."""

    at_ms: int
    number: int
    refused: str | None


@dataclass(frozen=True, slots=True)
class GoalSeen:
    """A go-to on its way to the action server, and the node that sent it."""

    at_ms: int
    key: str
    kind: int
    north_m: float
    east_m: float
    client: str


@dataclass(frozen=True, slots=True)
class HeldPositionReceived:
    """`position_static` of an aMussel: held there, or, with `released`, let go."""

    at_ms: int
    agent_id: int
    north_m: float
    east_m: float
    released: bool


@dataclass(frozen=True, slots=True)
class GoalStatusEntry:
    """One goal's status in a GoalStatusReceived."""

    key: str
    code: GoalCode
    text: str = ""


@dataclass(frozen=True, slots=True)
class GoalStatusReceived:
    """The server's status array (`whole`: a goal that is missing from it is lost), or one result."""

    at_ms: int
    words: tuple[GoalStatusEntry, ...]
    whole: bool


@dataclass(frozen=True, slots=True)
class DocksReceived:
    """The answer of `check_docking_availability`: the names of the held objects; None when nobody answered."""

    at_ms: int
    held: frozenset[str] | None


Received = (
    PoseReported
    | StateRefReceived
    | BatteryReceived
    | HeldPositionReceived
    | GoalStatusReceived
    | DocksReceived
    | GoalSeen
    | OffAnswered
)
