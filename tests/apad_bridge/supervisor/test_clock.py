import threading
from collections.abc import Callable
from itertools import pairwise

import pytest

from apad_bridge.supervisor.clock import POLL_PERIOD_S, WallClock


class Hand:
    """A clock that a test moves, and an event whose waits move it."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.waits: list[float] = []
        self.after: dict[float, Callable[[], None]] = {}
        """Acts, by the seconds after which each is carried out once."""
        self.stopped = threading.Event()
        self.stopped.wait = self._wait  # type: ignore[method-assign]

    def __call__(self) -> float:
        return self.now_s

    def _wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.waits.append(timeout)
        self.now_s += max(timeout, 1e-6)
        for due_s in sorted(it for it in self.after if 100.0 + it <= self.now_s):
            self.after.pop(due_s)()
        return False


@pytest.fixture
def hand() -> Hand:
    return Hand()


@pytest.mark.parametrize(("speed", "each_s"), [(1.0, 1.0), (20.0, 0.05)])
def test_a_tick_comes_at_its_wall_time(hand: Hand, speed: float, each_s: float) -> None:
    pace = WallClock(speed, clock=hand)
    for now_ms in range(0, 4000, 1000):
        pace.reach(now_ms, hand.stopped)
    assert hand.now_s == pytest.approx(100.0 + 3 * each_s)
    assert pace.behind_s == 0.0


def test_a_changed_speed_counts_from_the_time_that_has_come(hand: Hand) -> None:
    pace = WallClock(1.0, clock=hand)
    pace.reach(0, hand.stopped)
    hand.after[0.4] = lambda: pace.speed.change(3.0)
    pace.reach(1000, hand.stopped)
    assert hand.now_s == pytest.approx(100.4 + 0.6 / 3, abs=0.01)
    pace.reach(4000, hand.stopped)
    assert hand.now_s == pytest.approx(100.4 + 3.6 / 3, abs=0.01)


def test_time_that_stands_comes_on_by_steps_of_a_tick_and_loses_nothing(hand: Hand) -> None:
    pace = WallClock(1.0, clock=hand)
    pace.reach(0, hand.stopped)
    pace.speed.change(0.0)
    hand.after |= {50.0: pace.speed.step, 70.0: pace.speed.step, 90.0: lambda: pace.speed.change(2.0)}
    came_s = []
    # A pace that is asked for parts of a tick passes them all by one step.
    for now_ms in (500, 1000, 1500, 2000, 3000):
        pace.reach(now_ms, hand.stopped)
        came_s.append(hand.now_s - 100.0)
    assert came_s == pytest.approx([50.0, 50.0, 70.0, 70.0, 90.5], abs=0.3)
    assert pace.slipped_s == 0.0


def test_held_time_goes_on_at_the_newest_speed_and_takes_no_time_back(hand: Hand) -> None:
    pace = WallClock(2.0, clock=hand)
    pace.reach(0, hand.stopped)
    held = [True]
    pace.speed.is_held = lambda: bool(held)
    assert not pace.speed.stands  # only a person's 0 takes a step
    hand.after |= {30.0: lambda: pace.speed.change(4.0), 50.0: held.clear}
    pace.reach(1000, hand.stopped)
    assert hand.now_s == pytest.approx(150.25, abs=0.3)
    pace.reach(2000, hand.stopped)
    assert hand.now_s == pytest.approx(150.5, abs=0.3)
    assert pace.slipped_s == 0.0


def test_a_flight_that_ends_does_not_wait_for_time_that_stands(hand: Hand) -> None:
    pace = WallClock(1.0, clock=hand)
    pace.reach(0, hand.stopped)
    pace.speed.change(0.0)
    hand.stopped.wait = lambda timeout=None: True  # type: ignore[method-assign]
    pace.reach(1000, hand.stopped)
    assert pace.behind_s == 0.0


def test_missions_that_begin_at_the_same_time_of_the_clock_have_their_ticks_together(hand: Hand) -> None:
    paces = [WallClock(1.0, clock=hand) for _ in range(2)]
    begin_ms = paces[0].clock_ms() + 500
    for pace in paces:
        pace.begin_at(begin_ms)
    paces[0].reach(3000, hand.stopped)
    assert hand.now_s == pytest.approx(103.5)
    paces[1].reach(3000, hand.stopped)  # one that resumes there does not wait again
    assert hand.now_s == pytest.approx(103.5)


def test_a_little_late_it_catches_up(hand: Hand) -> None:
    pace = WallClock(1.0, bound_s=5.0, clock=hand)
    pace.reach(0, hand.stopped)
    hand.now_s += 3.0
    pace.reach(1000, hand.stopped)
    assert pace.behind_s == pytest.approx(2.0)
    pace.reach(2000, hand.stopped)
    pace.reach(4000, hand.stopped)
    assert hand.now_s == pytest.approx(104.0)
    assert pace.slipped_s == 0.0


def test_a_wait_that_ends_late_counts_as_late(hand: Hand) -> None:
    hand.stopped.wait = lambda timeout=None: hand._wait(timeout + 0.25)  # type: ignore[method-assign, operator]
    pace = WallClock(1.0, clock=hand)
    pace.reach(0, hand.stopped)
    pace.reach(1000, hand.stopped)
    assert pace.behind_s == pytest.approx(0.25)


def test_far_behind_it_moves_its_schedule_and_says_by_how_much(hand: Hand) -> None:
    pace = WallClock(1.0, bound_s=5.0, clock=hand)
    pace.reach(0, hand.stopped)
    hand.now_s += 11.0
    pace.reach(1000, hand.stopped)
    assert pace.slipped_s == pytest.approx(10.0)
    pace.reach(2000, hand.stopped)
    assert hand.now_s == pytest.approx(112.0)


@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_on_the_way_to_a_tick_it_tells_the_time_that_has_come(speed: float) -> None:
    hand, between_ms = Hand(), list[int]()
    pace = WallClock(speed, clock=hand)
    pace.reach(0, hand.stopped, between_ms.append)
    pace.reach(1000, hand.stopped, between_ms.append)
    pace.reach(2000, hand.stopped, between_ms.append)
    assert hand.now_s == pytest.approx(100 + 2 / speed)
    assert between_ms == sorted(set(between_ms))
    assert all(
        0 < after - before <= 31 * speed for before, after in pairwise(it for it in between_ms if it < 1000)
    )
    assert 2 * 0.9 / speed / POLL_PERIOD_S < len(between_ms) + 2 < 2 * 1.1 / speed / POLL_PERIOD_S + 3
    assert not {1000, 2000} & set(between_ms)
