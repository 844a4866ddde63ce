"""What the simulated aPad of generation A is told and shows, freed of ROS. Stamps are mission milliseconds."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from apad_bridge.ros.legacy_shown import PoseShown


class Outcome(Enum):
    SUCCEEDED = "succeeded"
    PREEMPTED = "pre-empted"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class Goal:
    key: str
    kind: int
    north_m: float
    east_m: float
    name: str
    """Of the object to perch or release: a bare namespace, as `amussel7`."""


@dataclass(frozen=True, slots=True)
class Held:
    """Where `name` is held; with `released`, for the last time."""

    at_ms: int
    name: str
    north_m: float
    east_m: float
    released: bool = False


@dataclass(frozen=True, slots=True)
class SlowShown:
    """Battery in percent, and for a running go-to the percentage covered, which is negative when it got farther away."""

    at_ms: int
    battery_percent: float
    goal_key: str | None
    covered_percent: float


@dataclass(frozen=True, slots=True)
class Ended:
    at_ms: int
    key: str
    outcome: Outcome
    reason: str = ""


Shown = PoseShown | Held | SlowShown | Ended
