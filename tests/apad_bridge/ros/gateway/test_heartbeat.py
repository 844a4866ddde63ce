"""The heartbeat's number, and when there is none."""

from __future__ import annotations

import pytest

from apad_bridge.ros.gateway.heartbeat import OFF, number_of


@pytest.mark.parametrize(
    ("heard_ms", "now_ms", "age_s"),
    [
        (None, 5_000, None),
        (4_600, 5_000, 0.4),
        (5_100, 5_000, 0.0),
        (2_000, 5_000, 3.0),
        (1_999, 5_000, None),
    ],
)
def test_it_is_the_position_s_age_and_ends_with_a_stale_one(
    heard_ms: int | None, now_ms: int, age_s: float | None
) -> None:
    assert number_of(heard_ms, now_ms, is_off=False) == age_s


@pytest.mark.parametrize("heard_ms", [None, 1_000, 4_900])
def test_an_off_in_force_is_told_whatever_the_position(heard_ms: int | None) -> None:
    """A vehicle without thrust is where the watchdog has to leave it, and a lossy link brings no position."""
    assert number_of(heard_ms, 5_000, is_off=True) == OFF
