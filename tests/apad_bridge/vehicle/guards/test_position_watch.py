"""A position that is missing, old, jumping, frozen or absurd is not used."""

from __future__ import annotations

import math

from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.guards.position_watch import SETTLED_MS, PositionLimits, PositionWatch


def watched(*poses: tuple[int, float, float]) -> PositionWatch:
    watch = PositionWatch(PositionLimits(age_ms=5_000, jump_m=10.0, speed_m_s=1.0, frozen_ms=10_000))
    for at_ms, north_m, east_m in poses:
        watch.take(PoseReported(at_ms, north_m, east_m, 0.0))
    return watch


def test_a_position_is_known_and_fresh() -> None:
    assert "not known" in watched().fault(0)
    assert watched((0, 1.0, 1.0)).fault(5_000) == ""
    assert "older than 5 s" in watched((0, 1.0, 1.0)).fault(5_001)


def test_an_absurd_position_is_as_good_as_none() -> None:
    assert "not known" in watched((0, math.nan, 1.0), (0, math.inf, 1.0), (0, 60_000.0, 1.0)).fault(0)


def test_a_jump_is_not_believed_until_the_position_has_settled() -> None:
    assert watched((0, 0.0, 0.0), (1_000, 11.0, 0.0)).fault(1_000) == ""  # 10 m, and 1 m of way
    jumped = watched((0, 0.0, 0.0), (1_000, 11.1, 0.0))
    assert "jumped" in jumped.fault(1_000)
    assert jumped.velocity_m_s == (0.0, 0.0)
    jumped.take(PoseReported(1_000 + SETTLED_MS, 11.1, 0.0, 0.0))
    assert jumped.fault(1_000 + SETTLED_MS) == ""


def test_a_position_that_does_not_move_under_way_is_frozen() -> None:
    watch = watched(*((at_ms, 1.0, 1.0) for at_ms in range(0, 21_000, 1_000)))
    assert watch.fault(20_000) == ""  # at rest it may

    def under_way(from_ms: int, to_ms: int) -> None:
        watch.note_goal((5.0, 1.0))
        for at_ms in range(from_ms, to_ms + 1, 1_000):
            watch.take(PoseReported(at_ms, 1.0, 1.0, 0.0))
        watch.note_goal(None)

    under_way(21_000, 24_000)
    watch.take(PoseReported(25_000, 1.0, 1.0, 0.0))
    under_way(26_000, 30_000)
    assert watch.fault(30_000) == ""  # nine seconds by now, over two orders
    under_way(31_000, 31_000)
    assert "has not changed at all for 10 s" in watch.fault(31_000)
    watch.take(PoseReported(32_000, 1.0, 1.0, 0.0))
    assert "has not changed" in watch.fault(32_000)
    watch.take(PoseReported(33_000, 1.0, 1.0 + 1e-9, 0.0))
    assert watch.fault(33_000) == ""


def test_the_velocity_is_that_of_the_last_two_seconds() -> None:
    watch = watched(*((at_ms, at_ms / 1000 * 0.5, 3.0) for at_ms in range(0, 5_000, 100)))
    assert math.isclose(watch.velocity_m_s[0], 0.5)
    assert watch.velocity_m_s[1] == 0.0


def test_an_older_pose_changes_nothing() -> None:
    watch = watched((1_000, 1.0, 1.0), (500, 90.0, 90.0), (1_000, 90.0, 90.0))
    assert watch.place_m == (1.0, 1.0) and watch.fault(1_000) == ""
