import threading
from collections.abc import Callable
from itertools import pairwise

import pytest
from flying import play

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


class Paced(Hand):
    """A wall clock of a story: each line's answer is the time that has come, in seconds."""

    def __init__(self, speed: float = 1.0) -> None:
        super().__init__()
        self.pace = WallClock(speed, bound_s=5.0, clock=self)
        self.begin_ms = self.pace.clock_ms()

    def answer(self, move: str) -> str:
        name, *words = move.split()
        numbers = [float(it) for it in words if it.replace(".", "").isdigit()]
        match name:
            case "reach":
                self.pace.reach(int(numbers[0]), self.stopped)
            case "after":
                act = {"step": self.pace.speed.step, "freed": lambda: self.hold(False)}.get(words[1])
                self.after[numbers[0]] = act or (lambda: self.pace.speed.change(numbers[1]))
                return ""
            case "speed":
                self.pace.speed.change(numbers[0])
                return ""
            case "hold":
                self.hold(True)
                return f"stands {self.pace.speed.stands}"  # only a person's 0 takes a step
            case "begin":
                self.pace.begin_at(self.begin_ms + int(numbers[0]))
                return ""
            case "late":
                self.now_s += numbers[0]
                return ""
            case "ends":
                self.stopped.wait = lambda timeout=None: True  # type: ignore[method-assign]
                return ""
        told = {"behind": self.pace.behind_s, "slipped": self.pace.slipped_s}
        return ", ".join(
            [f"{self.now_s - 100:.1f}", *(f"{it} {s:.1f}" for it, s in told.items() if s > 0.05)]
        )

    def hold(self, is_held: bool) -> None:
        self.pace.speed.is_held = lambda: is_held


STORIES = {
    "a tick comes at its wall time": (
        1.0,
        """
        reach 0    | 0.0
        reach 1000 | 1.0
        reach 2000 | 2.0
        reach 3000 | 3.0
        """,
    ),
    "by another speed, too": (
        20.0,
        """
        reach 0     | 0.0
        reach 10000 | 0.5
        reach 20000 | 1.0
        """,
    ),
    "a changed speed counts from the time that has come": (
        1.0,
        """
        reach 0       | 0.0
        after 0.4 3.0 |
        reach 1000    | 0.6
        reach 4000    | 1.6
        """,
    ),
    # A pace that is asked for parts of a tick passes them all by one step.
    "time that stands comes on by steps of a tick and loses nothing": (
        1.0,
        """
        reach 0       | 0.0
        speed 0       |
        after 50 step |
        after 70 step |
        after 90 2.0  |
        reach 500     | 50.2
        reach 1000    | 50.2
        reach 1500    | 70.2
        reach 2000    | 70.2
        reach 3000    | 90.7
        """,
    ),
    "held time goes on at the newest speed and takes no time back": (
        2.0,
        """
        reach 0        | 0.0
        hold           | stands False
        after 30 4.0   |
        after 50 freed |
        reach 1000     | 50.4
        reach 2000     | 50.7
        reach 3000     | 50.9
        """,
    ),
    "a flight that ends does not wait for time that stands": (
        1.0,
        """
        reach 0    | 0.0
        speed 0    |
        ends       |
        reach 1000 | 0.0
        """,
    ),
    # One that resumes there does not wait again.
    "missions that begin at the same time of the clock have their ticks together": (
        1.0,
        """
        begin 500  |
        reach 3000 | 3.5
        begin 500  |
        reach 3000 | 3.5
        """,
    ),
    "a little late it catches up": (
        1.0,
        """
        reach 0    | 0.0
        late 3     |
        reach 1000 | 3.0, behind 2.0
        reach 2000 | 3.0, behind 1.0
        reach 4000 | 4.0
        """,
    ),
    "far behind it moves its schedule and says by how much": (
        1.0,
        """
        reach 0    | 0.0
        late 11    |
        reach 1000 | 11.0, behind 10.0, slipped 10.0
        reach 2000 | 12.0, slipped 10.0
        """,
    ),
}


@pytest.mark.parametrize(("speed", "story"), STORIES.values(), ids=STORIES)
def test_story(speed: float, story: str) -> None:
    play(story, Paced(speed).answer)


def test_a_wait_that_ends_late_counts_as_late() -> None:
    hand = Hand()
    hand.stopped.wait = lambda timeout=None: hand._wait(timeout + 0.25)  # type: ignore[method-assign, operator]
    pace = WallClock(1.0, clock=hand)
    pace.reach(0, hand.stopped)
    pace.reach(1000, hand.stopped)
    assert pace.behind_s == pytest.approx(0.25)


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
