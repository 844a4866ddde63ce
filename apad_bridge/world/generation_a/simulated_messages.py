"""Messages of the simulated aPad of generation A, without ROS: the goals that it takes, and what it publishes.

Stamps are mission milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from apad_bridge.world.simulated_stack import PosePublished


class GoalOutcome(Enum):
    SUCCEEDED = "succeeded"
    PREEMPTED = "pre-empted"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class HeldPositionPublished:
    """The position at which the aPad holds `name`; with `released`, the last one."""

    at_ms: int
    name: str
    north_m: float
    east_m: float
    released: bool = False


@dataclass(frozen=True, slots=True)
class BatteryAndProgressPublished:
    """Battery in percent, and a running go-to's covered percentage, negative when the distance has grown."""

    at_ms: int
    battery_percent: float
    goal_key: str | None
    covered_percent: float


@dataclass(frozen=True, slots=True)
class GoalEnded:
    at_ms: int
    key: str
    outcome: GoalOutcome
    reason: str = ""


Published = PosePublished | HeldPositionPublished | BatteryAndProgressPublished | GoalEnded
