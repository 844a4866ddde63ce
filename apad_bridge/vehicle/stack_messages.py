"""ROS-free messages that both generations share, from a real aPad and to publish by the simulated one.

Stamps are mission milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass

UNSTAMPED = -1
"""Replaces a missing stamp: the reader of the inbox knows the time."""


@dataclass(frozen=True, slots=True)
class StateRefReceived:
    """`stateRef`. Our simulated aPad publishes it when it has handled everything due by its stamp."""

    at_ms: int


@dataclass(frozen=True, slots=True)
class BatteryReceived:
    """The battery message has no stamp: `at_ms` is the time of arrival."""

    at_ms: int
    percent: float
