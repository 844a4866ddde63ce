"""A position that is missing, old, jumping, frozen or absurd is not used."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.events.guard_events import PositionErrorReported
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.guards.position_noise import PLACE_ERROR_M
from apad_bridge.vehicle.guards.position_watch import (
    LATE_FAULT_MS,
    SETTLED_MS,
    PositionLimits,
    PositionWatch,
)
from apad_bridge.vehicle.telemetry import Readings

LIMITS = PositionLimits(age_ms=5_000, jump_m=10.0, speed_m_s=1.0, frozen_ms=10_000)


def watched(*poses: tuple[int, float, float]) -> PositionWatch:
    """A watch of positions whose stamps are the times of their arrival."""
    watch = PositionWatch(LIMITS)
    for at_ms, north_m, east_m in poses:
        watch.take(PoseReported(at_ms, north_m, east_m, 0.0, at_ms))
    return watch


def told(watch: PositionWatch, at_ms: int, why: str) -> bool:
    """The watch's fault at a time has these words; none, for none."""
    fault = watch.fault(at_ms)
    return why in fault if why else fault == ""


@pytest.mark.parametrize(
    ("poses", "at_ms", "why"),
    [
        pytest.param([], 0, "not known", id="none"),
        pytest.param([(0, 1.0, 1.0)], 5_000, "", id="fresh"),
        pytest.param([(0, 1.0, 1.0)], 5_001, "older than 5 s", id="old"),
        pytest.param(
            [(0, math.nan, 1.0), (0, math.inf, 1.0), (0, 60_000.0, 1.0)], 0, "not known", id="absurd"
        ),
        # 10 m, and 1 m of way.
        pytest.param([(0, 0.0, 0.0), (1_000, 11.0, 0.0)], 1_000, "", id="far"),
        pytest.param([(0, 0.0, 0.0), (1_000, 11.1, 0.0)], 1_000, "jumped", id="a jump"),
        pytest.param(
            [(0, 0.0, 0.0), (1_000, 11.1, 0.0), (1_000 + SETTLED_MS, 11.1, 0.0)],
            1_000 + SETTLED_MS,
            "",
            id="settled",
        ),
        pytest.param(
            [(1_000, 1.0, 1.0), (500, 90.0, 90.0), (1_000, 90.0, 90.0)], 1_000, "", id="older poses"
        ),
    ],
)
def test_a_position_is_used_where_it_is_good(
    poses: list[tuple[int, float, float]], at_ms: int, why: str
) -> None:
    watch = watched(*poses)
    assert told(watch, at_ms, why)
    assert watch.velocity_m_s == (0.0, 0.0) or not why
    assert poses[1:2] != [(500, 90.0, 90.0)] or watch.place_m == (1.0, 1.0)


Step = PoseReported | tuple[tuple[float, float] | None, int]
"""A position, or a goal of an order that the vehicle accepted then; None for the order's end."""


def faults(watch: PositionWatch, steps: Iterable[Step]) -> dict[int, str]:
    """The faults, by the time of the pose after which each was there."""
    found = {}
    for step in steps:
        if isinstance(step, tuple):
            watch.note_goal(*step)
            continue
        watch.take(step)
        if fault := watch.fault(step.at_ms):
            found[step.at_ms] = fault
    return found


def stamped(at_ms: int, measured_ms: int, north_m: float, east_m: float = 0.0) -> PoseReported:
    """A position that was measured at a mission time and came at a later one, by a clock that is ahead of ours."""
    return PoseReported(at_ms, north_m, east_m, 0.0, measured_ms + AHEAD_MS)


def heard(at_ms: int, stamp_ms: int) -> PoseReported:
    """A position on its way at 0.5 m/s, by the clock of its arrival, which no late tick holds up."""
    return PoseReported(at_ms, stamp_ms / 2000, 0.0, 0.0, stamp_ms, heard_ms=9_000_000 + stamp_ms)


AHEAD_MS = 1_000_000
STRICT = PositionLimits(clock_step_ms=1_000, settled_ms=None)


def series(begin_ms: int, end_ms: int, pose: Callable[[int], Step], period_ms: int = 1_000) -> list[Step]:
    return [pose(at_ms) for at_ms in range(begin_ms, end_ms, period_ms)]


def still(at_ms: int) -> PoseReported:
    return PoseReported(at_ms, 1.0, 1.0, 0.0)


AWAY = (500.0, 0.0)
STEPS: dict[str, tuple[PositionLimits, list[Step], dict[int, str]]] = {
    "a position at rest is not frozen": (LIMITS, series(0, 21_000, still), {}),
    # It is under way from 20 to 24 s, from 25 to 30 s, and from 30 to 31 s: ten seconds over three orders.
    "a position that does not move under way is frozen until it moves": (
        LIMITS,
        [
            *series(0, 21_000, still),
            (AWAY, 20_000),
            *series(21_000, 25_000, still),
            (None, 0),
            still(25_000),
            (AWAY, 25_000),
            *series(26_000, 31_000, still),
            (None, 0),
            (AWAY, 30_000),
            still(31_000),
            (None, 0),
            still(32_000),
            PoseReported(33_000, 1.0, 1.0 + 1e-9, 0.0),
        ],
        dict.fromkeys((31_000, 32_000), "has not changed at all for 10 s") | {30_000: "", 33_000: ""},
    ),
    # The vehicle accepted the order at 10.3 s or before.
    **{
        f"positions from {name} the acceptance": (
            PositionLimits(frozen_ms=1_000),
            [
                *series(1_000, 11_000, lambda at_ms: stamped(at_ms, at_ms - 200, 1.0)),
                ((9.0, 0.0), 10_500),
                stamped(11_000, first_ms, 1.0),
                stamped(12_000, first_ms + 100, 1.0),
                stamped(13_000, last_ms, 1.0),
            ],
            told,
        )
        for name, first_ms, last_ms, told in (
            ("before", 9_900, 11_000, {}),
            ("after", 10_800, 12_800, {13_000: "has not changed"}),
        )
    },
    # Ten metres within a tick, and 2 m/s by its stamps; then two metres within a tenth of a second.
    "positions that come together after a stall are no jump, and others are": (
        PositionLimits(age_ms=20_000, jump_m=1.0, speed_m_s=2.0),
        [
            stamped(1_000, 1_000, 0.0),
            stamped(6_000, 2_000, 2.0),
            stamped(7_000, 7_000, 12.0),
            stamped(8_000, 7_100, 14.0),
        ],
        {7_000: "", 8_000: "jumped"},
    ),
    **{
        f"the vehicle's clock may be set by {by_ms} ms, and a position freezes after it": (
            LIMITS,
            [
                (AWAY, 0),
                *series(
                    1_000,
                    31_000,
                    lambda at_ms, by_ms=by_ms: stamped(at_ms, at_ms + by_ms * (at_ms > 15_000), at_ms / 2000),
                ),
                *series(31_000, 42_000, lambda at_ms, by_ms=by_ms: stamped(at_ms, at_ms + by_ms, 15.5)),
            ],
            {41_000: "has not changed"},
        )
        for by_ms in (-30_000, -500, 6_000, 10**9)
    },
    # Half a second of delay more each second, as when a queue fills up. Positions leave at half their rate.
    "a delay that goes on growing is noticed within two seconds": (
        STRICT,
        [
            *series(200, 30_000, lambda at_ms: stamped(at_ms, at_ms, at_ms / 2000), 200),
            *series(30_000, 32_001, lambda at_ms: stamped(at_ms, (at_ms + 30_000) // 2, at_ms / 2000), 200),
        ],
        {32_000: "its delay grows"},
    ),
    # Our machine is busy for a while, so that a late tick takes a position that is newer than its own time.
    **{
        f"a tick of ours that is {late_ms} ms late is no step of the vehicle's stamps": (
            STRICT,
            [
                *series(200, 30_000, lambda at_ms: heard(at_ms, at_ms), 200),
                *series(
                    30_000,
                    60_000 - late_ms,
                    lambda at_ms, late_ms=late_ms: heard(at_ms, at_ms + late_ms),
                    200,
                ),
            ],
            {},
        )
        for late_ms in (1_200, 4_000, 25_000)
    },
    "the vehicle's own clock steps": (
        STRICT,
        [
            *series(200, 60_000, lambda at_ms: heard(at_ms, at_ms), 200),
            PoseReported(60_000, 30.0, 0.0, 0.0, 64_000, heard_ms=9_060_000),
        ],
        {60_000: "its stamps went ahead by 4.0 s"},
    ),
}


@pytest.mark.parametrize(("limits", "steps", "told"), STEPS.values(), ids=STEPS)
def test_positions_are_good_until_they_are_not(
    limits: PositionLimits, steps: list[Step], told: dict[int, str]
) -> None:
    """At these times the fault has these words, or there is none; and none came more than 2 s before the first of them."""
    found = faults(PositionWatch(limits), steps)
    assert all(words in found[at_ms] if words else at_ms not in found for at_ms, words in told.items())
    assert min(found, default=0) >= min(told, default=0) - 2_000 and bool(found) is bool(told)


def test_a_vehicle_that_is_at_two_places_in_turn_is_believed_at_neither() -> None:
    """Two receivers under one node's name, 3 m apart, two seconds each."""
    watch = PositionWatch(PositionLimits(settled_ms=None))
    for at_ms in range(0, 20_000, 100):
        pose = PoseReported(at_ms, 3.0 * (at_ms // 2_000 % 2), 0.0, 0.0, at_ms)
        watch.look_at(pose)
        watch.take(pose)
    assert "alternates between two places 3.0 m apart" in watch.fault(20_000)


@pytest.mark.parametrize(
    ("poses", "velocity_m_s", "least_m_s"),
    [
        pytest.param(
            series(0, 5_000, lambda at_ms: PoseReported(at_ms, at_ms / 2000, 3.0, 0.0, at_ms), 100),
            (0.5, 0.0),
            None,
            id="of the last two seconds",
        ),
        # Positions are 4 s apart, or 5 s by a tick's error.
        *(
            pytest.param(
                series(1_000, 6_000, lambda at_ms, it=it: PoseReported(at_ms, at_ms / 1000, 0.0, 0.0, it)),
                (1.0, 0.0),
                (4.0 - PLACE_ERROR_M) / 5.0,
                id=f"without stamps that go on: {it}",
            )
            for it in (None, 77)
        ),
        *(
            pytest.param(
                series(
                    1_000,
                    31_000,
                    lambda at_ms, it=it: stamped(at_ms, at_ms + it * (at_ms > 15_000), at_ms / 2000),
                ),
                (0.5, 0.0),
                None,
                id=f"of a clock that was set by {it} ms",
            )
            for it in (-30_000, -500, 6_000, 10**9)
        ),
    ],
)
def test_the_velocity(poses: list[Step], velocity_m_s: tuple[float, float], least_m_s: float | None) -> None:
    watch = PositionWatch(LIMITS)
    assert faults(watch, [(AWAY, 0), *poses]) == {}
    assert watch.velocity_m_s == pytest.approx(velocity_m_s)
    assert watch.least_speed_m_s == pytest.approx(least_m_s) if least_m_s else watch.least_speed_m_s <= 1.0


def sailing(
    seconds: float,
    way_m: Callable[[float], float],
    noise_m: float = 0.0,
    *,
    own_m_s: Callable[[float], float | None] = lambda s: None,
    rough_s: float = 0.0,
    seed: int = 8,
    period_ms: int = 1_000,
) -> Iterator[PoseReported]:
    """A way north, by its seconds, behind white noise on each axis from a time on, and what the vehicle itself measures."""
    noise = random.Random(seed)
    for at_ms in range(0, round(1000 * seconds), period_ms):
        error_m = noise_m if at_ms >= 1000 * rough_s else 0.0
        north_m, east_m = way_m(at_ms / 1000) + noise.gauss(0.0, error_m), noise.gauss(0.0, error_m)
        yield PoseReported(at_ms, north_m, east_m, 0.0, at_ms, own_m_s(at_ms / 1000))


def half(s: float) -> float:
    """0.5 m/s."""
    return 0.5 * s


def too_fast_ms(poses: Iterable[PoseReported]) -> list[int]:
    """The times at which it is sure that the vehicle makes more than 0.8 m/s."""
    watch, found = PositionWatch(LIMITS), []
    for pose in poses:
        watch.take(pose)
        found += [pose.at_ms] * (watch.least_speed_m_s > 0.8)
    return found


HOURS = 36_000


@pytest.mark.parametrize(
    ("poses", "quiet_ms", "seen_ms"),
    [
        *(
            pytest.param(
                sailing(HOURS, half, noise_m),
                (0, HOURS * 1000),
                None,
                id=f"noise of {noise_m} m for ten hours",
            )
            for noise_m in (0.0, 0.05, 0.5)
        ),
        # Its speed grows from 0.5 to 1.2 m/s at once: two seconds of way show it, or one more.
        *(
            pytest.param(
                sailing(
                    30,
                    lambda s: 0.5 * min(s, 20) + 1.2 * max(0, s - 20),
                    own_m_s=lambda s, it=it: it if s > 20 else 0.5,
                ),
                (0, 20_000),
                20_000 + 1000 * within_s,
                id=f"too fast, while it measures {it} m/s itself",
            )
            for it, within_s in ((1.2, 2), (None, 2), (0.5, 3), (0.0, 3))
        ),
        pytest.param(
            sailing(60, lambda s: 1.2 * s, 0.05), (0, -1), 59_000, id="too fast, behind a good receiver"
        ),
        # Two seconds hide 4.4 m, which is 2.2 m/s; five seconds do not.
        pytest.param(
            sailing(600, lambda s: 0.5 * min(s, 590) + 2.0 * max(s - 590, 0), 0.5),
            (60_000, 590_000),
            599_000,
            id="one that runs away at 2 m/s, behind a bad receiver",
        ),
    ],
)
def test_a_vehicle_is_seen_to_be_too_fast_where_it_is_and_only_there(
    poses: Iterator[PoseReported], quiet_ms: tuple[int, int], seen_ms: int | None
) -> None:
    found = too_fast_ms(poses)
    assert not [at_ms for at_ms in found if quiet_ms[0] <= at_ms <= quiet_ms[1]]
    assert seen_ms is None or seen_ms in found


@pytest.mark.parametrize(("measures_its_speed", "most_in_600"), [(False, 6), (True, 0)])
@pytest.mark.parametrize("begins_s", [0, 20])
def test_noise_that_begins_at_once_makes_hardly_any_vehicle_too_fast(
    begins_s: int, measures_its_speed: bool, most_in_600: int
) -> None:
    """At rest for 5 s, and then at 0.5 m/s: noise of 0.5 m on each axis begins, on waves of 0.3 m."""
    own_m_s = (lambda s: 0.5 * (s > 5)) if measures_its_speed else lambda s: None
    found = [
        too_fast_ms(
            sailing(
                60,
                lambda s, seed=seed: (
                    0.5 * max(0, s - 5) + 0.3 * math.sin(math.tau * s / 6 + seed) * (s >= begins_s)
                ),
                0.5,
                own_m_s=own_m_s,
                rough_s=begins_s,
                seed=seed,
            )
        )
        for seed in range(50_000, 50_600)
    ]
    assert len([it for it in found if it]) <= most_in_600


@pytest.mark.parametrize("noise_m", [0.05, 0.5])
def test_a_noisy_receiver_does_not_contradict_the_vehicle_s_own_speed(noise_m: float) -> None:
    """Ten hours under way at 0.5 m/s, as the vehicle itself measures it."""
    poses = sailing(HOURS, half, noise_m, own_m_s=lambda s: 0.5)
    assert faults(PositionWatch(LIMITS), [((40_000.0, 0.0), 0), *poses]) == {}


@pytest.mark.parametrize(("period_ms", "seeds"), [(200, 20), (1_000, 100)])
def test_a_receiver_that_becomes_noisy_under_way_is_no_frozen_one(period_ms: int, seeds: int) -> None:
    """Receivers get noise of 0.5 m on each axis, waves of 0.3 m and gaps of 1.5 s at once, at 0.5 m/s.

    The position is believed for the ten minutes after it, whatever the rate at which somebody looks.
    """
    for seed in range(seeds):
        begin_ms = random.Random(seed).randrange(0, 60_000, 100)
        poses = sailing(
            630,
            lambda s: 0.5 * s + 0.3 * math.sin(math.tau * s / 4) * (s > 30),
            0.5,
            own_m_s=lambda s: 0.5,
            rough_s=30.001,
            seed=seed,
            period_ms=period_ms,
        )
        heard_of = (it for it in poses if (it.at_ms + begin_ms) % 60_000 <= 58_500)
        assert faults(PositionWatch(STRICT), [((400.0, 0.0), 0), *heard_of]) == {}, seed


@pytest.mark.parametrize("period_ms", [200, 1_000])
def test_a_position_that_freezes_is_noticed_whatever_the_rate_of_the_looks(period_ms: int) -> None:
    poses = sailing(26, lambda s: 0.5 * min(s, 20), 0.003, own_m_s=lambda s: 0.5, period_ms=period_ms)
    found = faults(PositionWatch(LIMITS), [((400.0, 0.0), 0), *poses])
    assert min(found) > 20_000 and "while the vehicle measured a way" in found[25_000]


def test_a_second_publisher_is_noticed_though_its_messages_never_come_last() -> None:
    """A tick passes on the newest position alone, which may always be that of one node."""
    readings, gate = Readings((10.5, 16.0)), Gate.without_guards()
    for publishers in (("/position",), ("/second", "/position")):
        for at_ms, publisher in enumerate(publishers, 1_000 * len(publishers)):
            readings.receive(PoseReported(at_ms, 1.0, 1.0, 0.0, at_ms, publisher=publisher))
        readings.take(gate)
    assert "two nodes publish it: /second and /position" in gate.watch.fault(2_001)


@given(st.lists(st.integers(0, 2_000), min_size=5, max_size=40), st.integers(-(10**9), 10**9))
def test_a_delay_changes_neither_the_velocity_nor_the_frozen_time(
    delays_ms: list[int], ahead_ms: int
) -> None:
    """A vehicle makes 0.5 m/s; its positions keep their order, and the newest of each tick counts."""
    watch = PositionWatch(LIMITS)
    watch.note_goal((500.0, 0.0), 0)
    come_ms = 0
    measured: dict[int, int] = {}
    for n, delay_ms in enumerate(delays_ms):
        come_ms = max(come_ms, 1_000 * n + delay_ms)
        measured[-(-come_ms // 1_000) * 1_000] = 1_000 * n
    for at_ms, measured_ms in measured.items():
        watch.take(PoseReported(at_ms, 0.0005 * measured_ms, 0.0, 0.0, measured_ms + ahead_ms))
        assert watch.velocity_m_s == pytest.approx((0.5, 0.0) if len(watch._samples) > 1 else (0.0, 0.0))
        assert watch.least_speed_m_s <= 0.5 and watch.fault(at_ms) == ""


def test_positions_that_waited_for_a_bench_that_slept_are_a_fault_though_the_newest_of_them_is_fresh() -> (
    None
):
    """A laptop wakes after a minute, and hears all positions of it before its guards look."""
    readings, gate = Readings((10.5, 16.0)), Gate([], PositionWatch(PositionLimits(settled_ms=None)))
    stamps_ms, asleep_ms = range(0, 90_000, 100), range(20_000, 80_000)
    for stamp_ms in stamps_ms:
        heard_ms = asleep_ms.stop if stamp_ms in asleep_ms else stamp_ms
        readings.receive(PoseReported(heard_ms, 0.0, 0.0, 0.0, stamp_ms, heard_ms=heard_ms))
        if stamp_ms not in asleep_ms:
            readings.take(gate)
            is_late = asleep_ms.stop <= stamp_ms < asleep_ms.stop + LATE_FAULT_MS
            assert ("came 60.0 s late" in gate.watch.fault(heard_ms)) is is_late


@pytest.mark.parametrize("creep_ppm", [-50, 50])
def test_a_link_that_loses_packets_is_no_growing_delay(creep_ppm: int) -> None:
    """Ten hours at 10 Hz: one packet in 20 is lost, each of its repetitions too, after 0.2, 0.4, 0.8 s, and order is kept.

    The vehicle's clock runs a little faster or slower than ours.
    """
    losses, watch = random.Random(5), PositionWatch(STRICT)
    free_ms, newest, looked_ms = 0, 0, 0
    for sent_ms in range(0, 36_000_000, 100):
        wait_ms, repeat_ms = losses.randint(2, 30), 200
        while losses.random() < 0.05:
            wait_ms, repeat_ms = wait_ms + repeat_ms, 2 * repeat_ms
        free_ms = max(free_ms, sent_ms + wait_ms)
        if free_ms >= looked_ms + 200 and newest:
            watch.take(stamped(looked_ms, newest + newest * creep_ppm // 1_000_000, 1.0))
            assert "delay" not in watch.fault(looked_ms)
        looked_ms = max(looked_ms, free_ms // 200 * 200)
        newest = sent_ms


def lines_of_a_way(
    deviation_m: Callable[[int], float], seed: int = 7, expected_m: float = 0.5
) -> list[tuple[int, PositionErrorReported]]:
    """Twenty minutes between two places, 12 m apart, at 0.5 m/s, with white noise of this deviation on each axis."""
    noise = random.Random(seed)
    gate = Gate([], PositionWatch(replace(LIMITS, error_m=expected_m)))
    told: list[tuple[int, PositionErrorReported]] = []
    for second in range(1200):
        way_m, error_m = 0.5 * (second % 48), deviation_m(second)
        north_m = (way_m if way_m < 12 else 24 - way_m) + noise.gauss(0.0, error_m)
        pose = PoseReported(1000 * second, north_m, noise.gauss(0.0, error_m), 0.0, 1000 * second)
        gate.observe([pose])
        told += [(second, it) for it in gate.events if isinstance(it, PositionErrorReported)]
        gate.events.clear()
    return told


@pytest.mark.parametrize("seed", range(5))
def test_noise_beyond_the_error_of_the_clearance_is_told_once_and_so_is_its_end(seed: int) -> None:
    """Deviations of 0.1, 0.6 and 0.1 m on each axis: 95 % lie within 0.24 and 1.47 m, and the scenario says 0.5 m."""
    began, ended = lines_of_a_way(lambda second: 0.6 if 400 <= second < 800 else 0.1, seed)
    assert began[1].is_above and 400 <= began[0] < 430
    assert not ended[1].is_above and 800 <= ended[0] < 900
    assert "guards.position_error_m is 0.5 m" in began[1].text()


def test_a_good_position_of_a_vehicle_that_turns_is_no_noise() -> None:
    assert lines_of_a_way(lambda second: 0.0, expected_m=0.1) == []
    assert lines_of_a_way(lambda second: 0.15) == []
