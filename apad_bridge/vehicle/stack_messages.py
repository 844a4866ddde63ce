"""ROS-free messages that both generations share, from a real aPad and to publish by the simulated one.

Stamps are mission milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass

UNSTAMPED = -1
"""Replaces a missing stamp: the reader of the inbox knows the time."""


@dataclass(frozen=True, slots=True)
class PoseReceived:
    at_ms: int
    north_m: float
    east_m: float
    heading_rad: float
    stamp_ms: int | None = None
    """The message's own stamp, by whatever clock; None for none."""
    speed_m_s: float | None = None
    """The speed over ground that the message states; None for none."""
    publisher: str = ""
    """The node that published the message; empty where that is not known."""
    heard_ms: int | None = None
    """The time of arrival, by the clock of `PoseReported.heard_ms`."""


@dataclass(frozen=True, slots=True)
class StateRefReceived:
    """`stateRef`. Our simulated aPad publishes it when it has handled everything due by its stamp."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class BatteryReceived:
    """The battery message has no stamp: `at_ms` is the time of arrival."""

    at_ms: int
    percent: float
