"""The heartbeat's number, and when there is none."""

from __future__ import annotations

import pytest

from apad_bridge.ros.gateway.heartbeat import age_of


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
    assert age_of(heard_ms, now_ms) == age_s
