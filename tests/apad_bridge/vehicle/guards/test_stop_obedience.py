"""A hull that obeys a stop, and one that does not, told by places alone, against motions worked out by hand."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.events.guard_events import StopKind
from apad_bridge.vehicle.guards.monitor import Stopping
from apad_bridge.vehicle.guards.stop_obedience import STANDS_M_S, Obedience, Obeys, Sight

STOPPING = Stopping(0.0, 4.2, 0.6)
Way = Callable[[float], float]
"""Metres made by a time in seconds since the vehicle has taken the stop; before it, the time is negative."""


def coasts(speed_m_s: float, drag_m: float = 1.2) -> Way:
    """A hull with quadratic drag alone: v = v0 / (1 + v0 t / L), so its way is L ln(1 + v0 t / L)."""
    return lambda s: speed_m_s * s if s < 0 else drag_m * math.log(1 + speed_m_s * s / drag_m)


def goes_on(speed_m_s: float) -> Way:
    return lambda s: speed_m_s * s


def judged(
    kind: StopKind, way: Way, *, flow_m_s: float = 0.0, noise_m: float = 0.0, seconds: int = 30, seed: int = 0
) -> tuple[Obeys, float]:
    """The first verdict that is one, and its time; or the last, for a hull that is never judged otherwise."""
    rng = random.Random(seed)

    def sight(s: float) -> Sight:
        place, before = (way(it) + flow_m_s * it + rng.gauss(0, noise_m) for it in (s, s - 2.0))
        velocity = (place - before) / 2.0
        return Sight(round(1000 * s), (place, 0.0), (velocity, 0.0), (flow_m_s, 0.0), max(0.1, 4.2 * noise_m))

    held = (way(0.0), 0.0) if kind is StopKind.HOLD else None
    obedience, ends = Obedience(kind, held, STOPPING, sight(0.0)), {Obeys.NO}
    if kind is StopKind.OFF:
        ends.add(Obeys.YES)
    looks = ((obedience.look(sight(n / 5)), n / 5) for n in range(5 * seconds))
    verdict = (Obeys.UNKNOWN, 0.0)
    for verdict in looks:
        if verdict[0] in ends:
            break
    assert verdict[0] is not Obeys.NO or obedience.reason
    return verdict


@pytest.mark.parametrize("kind", StopKind)
@settings(max_examples=25, deadline=None)
@given(speed_m_s=st.floats(0.4, 2.0))
def test_a_deaf_hull_is_told_within_seconds(kind: StopKind, speed_m_s: float) -> None:
    verdict, at_s = judged(kind, goes_on(speed_m_s))
    assert verdict is Obeys.NO and 3.0 <= at_s <= 5.0


@settings(max_examples=25, deadline=None)
@given(speed_m_s=st.floats(0.4, 1.5), flow_m_s=st.floats(-0.3, 0.3))
def test_a_hull_that_coasts_in_a_known_flow_obeys(speed_m_s: float, flow_m_s: float) -> None:
    verdict, at_s = judged(StopKind.OFF, coasts(speed_m_s), flow_m_s=flow_m_s)
    assert verdict is Obeys.YES and at_s <= 5.0


@settings(max_examples=25, deadline=None)
@given(speed_m_s=st.floats(0.0, 0.25), flow_m_s=st.floats(-0.5, 0.5))
def test_a_hull_that_lies_in_the_water_obeys_at_once_or_within_a_second(
    speed_m_s: float, flow_m_s: float
) -> None:
    verdict, at_s = judged(StopKind.OFF, goes_on(speed_m_s), flow_m_s=flow_m_s)
    assert verdict is Obeys.YES and at_s <= (0.0 if speed_m_s <= STANDS_M_S else 1.0)


def gains(m_s2: float, since_s: float, top_m_s: float) -> Way:
    """The way of a hull that began to move so long before the stop, and goes on."""

    def way(s: float) -> float:
        moved_s, gains_s = max(0.0, s + since_s), top_m_s / m_s2
        return m_s2 * min(moved_s, gains_s) ** 2 / 2 + top_m_s * max(0.0, moved_s - gains_s)

    return way


@settings(max_examples=50, deadline=None)
@given(m_s2=st.floats(0.25, 0.5), since_s=st.floats(1.0, 2.0), top_m_s=st.floats(0.5, 0.8))
def test_a_deaf_hull_that_has_just_begun_to_move_does_not_obey(
    m_s2: float, since_s: float, top_m_s: float
) -> None:
    """By the mean of two seconds it makes less than 0.3 m/s as it takes an OFF."""
    way = gains(m_s2, since_s, top_m_s)
    verdict, at_s = judged(StopKind.OFF, way)
    assert verdict is Obeys.NO and 3.0 <= at_s <= 6.0


@settings(max_examples=25, deadline=None)
@given(speed_m_s=st.floats(0.0, 0.8))
def test_reversed_thrusters_drive_the_hull_away_from_the_held_place(speed_m_s: float) -> None:
    """It gathers 0.2 m/s each second, up to 0.8 m/s, away from where it should stay."""

    def way(s: float) -> float:
        return speed_m_s * s if s < 0 else speed_m_s * s + (0.1 * s * s if s < 4 else 1.6 + 0.8 * (s - 4))

    verdict, at_s = judged(StopKind.HOLD, way)
    assert verdict is Obeys.NO and at_s <= 10.0


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), noise_m=st.sampled_from([0.05, 0.2, 0.5]), speed_m_s=st.floats(0.0, 0.6))
def test_noise_does_not_make_a_good_hold_disobey(seed: int, noise_m: float, speed_m_s: float) -> None:
    verdict, _ = judged(StopKind.HOLD, coasts(speed_m_s, 0.6), noise_m=noise_m, seconds=60, seed=seed)
    assert verdict is not Obeys.NO
