"""Messages on an aPad's topics that are stamped in a future that it has not reached."""

from __future__ import annotations

from collections import Counter
from typing import Any

from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.stack_messages import StateRefReceived
from apad_bridge.vehicle.telemetry import AHEAD_MS, DeferredMessages


def test_a_stamp_far_ahead_is_dropped_and_counted_and_a_near_one_has_its_time() -> None:
    dropped: Counter[str] = Counter()
    messages: DeferredMessages[Any] = DeferredMessages(0, dropped)
    near = PoseReported(AHEAD_MS, 1.0, 2.0, 0.0)
    assert messages.defers(near, 0)
    for n in range(1, 1001):
        assert messages.defers(PoseReported(AHEAD_MS + n, 1.0, 2.0, 0.0), 0)
    assert dropped == {"Pose: stamped more than 10 s ahead of the mission": 1000}
    assert messages.advance(1_000) == [near]


def test_a_progress_far_ahead_is_none_that_the_vehicle_has_made() -> None:
    """A link waits for `stateRef` at each tick: a foreign one from the future ended every later wait at once."""
    dropped: Counter[str] = Counter()
    messages: DeferredMessages[Any] = DeferredMessages(0, dropped)
    assert not messages.defers(StateRefReceived(AHEAD_MS), 0)
    assert messages.defers(StateRefReceived(10**12), 0) and sum(dropped.values()) == 1
