import threading
from itertools import pairwise

import pytest

from apad_bridge.supervisor.clock import POLL_PERIOD_S, WallClock


class Hand:
    """A clock that a test moves, and an event whose waits move it."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.waits: list[float] = []
        self.stopped = threading.Event()
        self.stopped.wait = self._wait  # type: ignore[method-assign]

    def __call__(self) -> float:
        return self.now_s

    def _wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.waits.append(timeout)
        self.now_s += timeout
        return False


@pytest.mark.parametrize(("speed", "each_s"), [(1.0, 1.0), (20.0, 0.05)])
def test_a_tick_comes_at_its_wall_time(speed: float, each_s: float) -> None:
    hand = Hand()
    pace = WallClock(speed, clock=hand)
    for now_ms in range(0, 4000, 1000):
        pace.reach(now_ms, hand.stopped)
    assert hand.waits == pytest.approx([each_s] * 3)
    assert pace.behind_s == 0.0


def test_missions_that_begin_at_the_same_time_of_the_clock_have_their_ticks_together() -> None:
    hand = Hand()
    paces = [WallClock(1.0, clock=hand) for _ in range(2)]
    begin_ms = paces[0].clock_ms() + 500
    for pace in paces:
        pace.begin_at(begin_ms)
    paces[0].reach(3000, hand.stopped)
    assert hand.now_s == pytest.approx(103.5)
    paces[1].reach(3000, hand.stopped)  # one that resumes there does not wait again
    assert hand.now_s == pytest.approx(103.5)


def test_a_little_late_it_catches_up() -> None:
    hand = Hand()
    pace = WallClock(1.0, bound_s=5.0, clock=hand)
    pace.reach(0, hand.stopped)
    hand.now_s += 3.0
    pace.reach(1000, hand.stopped)
    assert pace.behind_s == pytest.approx(2.0)
    pace.reach(2000, hand.stopped)
    pace.reach(4000, hand.stopped)
    assert hand.now_s == pytest.approx(104.0)
    assert pace.slipped_s == 0.0


def test_a_wait_that_ends_late_counts_as_late() -> None:
    hand = Hand()
    hand.stopped.wait = lambda timeout=None: hand._wait(timeout + 0.25)  # type: ignore[method-assign, operator]
    pace = WallClock(1.0, clock=hand)
    pace.reach(0, hand.stopped)
    pace.reach(1000, hand.stopped)
    assert pace.behind_s == pytest.approx(0.25)


def test_far_behind_it_moves_its_schedule_and_says_by_how_much() -> None:
    hand = Hand()
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
