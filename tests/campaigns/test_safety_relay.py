"""The relay of the safety campaign: each kind of false position is false in the way that its row says."""

from __future__ import annotations

import itertools
import math
import random
from typing import Any

import pytest

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402
from safety.nodes.relay import Falsifier  # noqa: E402

TENTHS = 300


def position(at_s: float) -> Any:
    message = NavSts()
    message.header.stamp.secs, message.header.stamp.nsecs = 1000 + int(at_s), round(1e9 * (at_s % 1))
    message.position.north, message.position.east, message.orientation.yaw = 0.5 * at_s, 30.0, 0.25
    return message


def passed(kind: str, **how: Any) -> list[tuple[float, Any]]:
    """(time of leaving, message) for half a minute of positions, ten a second, of a vehicle at 0.5 m/s."""
    now = [0.0]
    falsifier = Falsifier({"kind": kind, **how}, position(-0.1), random.Random(1), lambda: now[0])
    left = []
    for tenth in range(TENTHS):
        now[0] = tenth / 10
        left += [(now[0], it) for it in falsifier.take(position(now[0])) + falsifier.due()]
    return left


def places(kind: str, **how: Any) -> list[tuple[float, float]]:
    return [(it.position.north, it.position.east) for _, it in passed(kind, **how)]


def stamps_s(kind: str, **how: Any) -> list[float]:
    return [it.header.stamp.to_sec() - 1000 for _, it in passed(kind, **how)]


def test_numbers_that_are_none() -> None:
    assert all(math.isnan(north) and math.isnan(east) for north, east in places("nan"))
    assert all(math.isinf(north) and east == 30.0 for north, east in places("infinite"))
    yaw = passed("yaw_nan")
    assert all(math.isnan(it.orientation.yaw) and math.isfinite(it.position.north) for _, it in yaw)
    assert passed("silent") == [] and len(passed("good")) == TENTHS


def test_a_frozen_position_has_fresh_stamps_and_nothing_else_that_changes() -> None:
    frozen = [it for _, it in passed("frozen")]
    assert len({(it.position.north, it.position.east, it.orientation.yaw) for it in frozen}) == 1
    assert stamps_s("frozen") == pytest.approx([it / 10 for it in range(TENTHS)])
    noisy = places("frozen", noise_m=0.003)
    assert len(set(noisy)) == TENTHS and all(math.dist(it, (-0.05, 30.0)) < 0.03 for it in noisy)


def test_places_that_are_shifted_or_mirrored() -> None:
    assert places("offset", north_m=50.0, east_m=-1.0)[10] == pytest.approx((50.5, 29.0))
    assert places("north_sign")[10] == pytest.approx((-0.5, 30.0))


def test_two_receivers_of_one_node_speak_in_turns() -> None:
    turns = [north - it / 20 for it, (north, _) in enumerate(places("mux", apart_m=3.0))]
    assert turns[:4] == pytest.approx([3.0, 0.0, 3.0, 0.0])


def test_a_position_walks_off() -> None:
    north = [north for north, _ in places("walks", speed_m_s=0.4)]
    assert north[100] - 0.5 * 10 == pytest.approx(4.0)


def test_lag_grows_to_eight_seconds_and_keeps_the_order() -> None:
    late = passed("late_more")
    lags_s = [at_s - (it.header.stamp.to_sec() - 1000) for at_s, it in late]
    assert all(a <= b + 0.11 for a, b in itertools.pairwise(lags_s))
    assert lags_s[0] < 0.3 and lags_s[-1] == pytest.approx(8.0, abs=0.11)
    order = [it.header.stamp.to_sec() for _, it in late]
    assert order == sorted(order)


def test_clocks_that_are_old_or_run_back() -> None:
    assert stamps_s("stamps", by_s=-60.0)[0] == pytest.approx(-60.0)
    assert stamps_s("backwards") == pytest.approx([-it / 10 for it in range(TENTHS)])


def test_a_slow_one_comes_every_five_seconds() -> None:
    assert [at_s for at_s, _ in passed("slow", every_s=5.0)] == pytest.approx([0, 5, 10, 15, 20, 25])


def test_a_healthy_one_has_noise_waves_and_short_gaps() -> None:
    now = [0.0]
    order = {"kind": "rough", "noise_m": 0.5, "gap_s": 1.5, "waves_m": 0.3}
    falsifier = Falsifier(order, position(0.0), random.Random(2), lambda: now[0])
    errors, gap_s, last_s = [], 0.0, 0.0
    for tenth in range(6000):
        now[0] = tenth / 10
        for it in falsifier.take(position(now[0])):
            errors.append(it.position.east - 30.0)
            gap_s, last_s = max(gap_s, now[0] - last_s), now[0]
    assert sum(it * it for it in errors) / len(errors) == pytest.approx(0.25, rel=0.1)
    assert gap_s == pytest.approx(1.6, abs=0.11)
