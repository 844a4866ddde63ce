"""The pace of mission time: as fast as the machine goes, or not before its wall-clock time; and a sign to stop it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Protocol

from agents.time_scale import TICK_MS, MissionMs

POLL_PERIOD_S = 0.03
"""Wall seconds between two such calls: a device on a serial line does not wait for a tick."""
_CHANGED_S = 0.2
"""Wall seconds after which a waiting clock looks at its speed again."""


class StopSign:
    """A stop sign that a signal handler may set.

    A handler may not set a threading.Event: it runs in the middle of its own thread's work, and when that is the first
    step of a wait, the handler waits for a lock that only its own thread could release. This sign's lock is re-entrant.
    A sign that is set in that very moment is seen when the wait's timeout is over, not before: so every wait has one.
    """

    def __init__(self) -> None:
        self._wake = threading.Condition(threading.RLock())
        self._is_set = False

    def set(self) -> None:
        self._is_set = True
        with self._wake:
            self._wake.notify_all()

    def is_set(self) -> bool:
        return self._is_set

    def wait(self, timeout_s: float, /) -> bool:
        with self._wake:
            if not self._is_set:
                self._wake.wait(timeout_s)
        return self._is_set


class ClockLost(TimeoutError):
    """Mission time comes no further: a participant does not confirm it, or nobody publishes it. The text names who."""


class FlightSpeed:
    """The speed of a flight whose time is its own, in mission seconds a wall second. 0: mission time stands still.

    Any thread may change it.
    """

    def __init__(self, times: float) -> None:
        self._lock = threading.Lock()
        self._steps = 0
        self.times = times
        self.is_held: Callable[[], bool] = lambda: False
        """True while mission time stands still at any speed; the flight's thread asks."""

    @property
    def stands(self) -> bool:
        """A person has let mission time stand still."""
        return self.times == 0

    @property
    def present(self) -> float:
        return 0.0 if self.is_held() else self.times

    def change(self, times: float) -> None:
        with self._lock:
            self.times, self._steps = times, 0

    def step(self) -> None:
        """Lets one more tick come while mission time stands still."""
        with self._lock:
            self._steps += 1

    def lets_pass(self, now_ms: int) -> bool:
        """True if a step lets this time come, a tick or a part of one; a tick uses the step up."""
        with self._lock:
            passes = self._steps > 0
            if passes and now_ms % TICK_MS == 0:
                self._steps -= 1
            return passes


OnTimeReached = Callable[[MissionMs], None]
"""Called with a mission time that has come, between two ticks."""


class Pace(Protocol):
    def reach(self, now_ms: int, stopped: StopSign, between: OnTimeReached | None = None) -> None:
        """Returns when mission time `now_ms` has come for all participants, or at once when `stopped` is set.

        Calls `between` about every `POLL_PERIOD_S`, with times before `now_ms` that have come; a pace without a wall clock
        does not call it.

        ClockLost, with the name, when a participant's confirmation does not come in the stated time.
        """

    @property
    def speed(self) -> FlightSpeed | None:
        """The speed, if a person may change it: not where the vehicle, or another clock, has a time of its own."""

    @property
    def behind_s(self) -> float:
        """The wall seconds that the flight is behind its time; 0 when it keeps up."""


class CommonClock(Pace, Protocol):
    """A pace by a clock that other flights have, too, so that several missions can begin at the same time."""

    def clock_ms(self) -> int:
        """The clock now. ClockLost when there is none."""

    def begin_at(self, clock_ms: int) -> None:
        """Mission time 0 is at this time of the clock. Call it before the first `reach`."""


class AsFastAsPossible:
    speed: FlightSpeed | None = None
    behind_s = 0.0

    def reach(self, now_ms: int, stopped: StopSign, between: OnTimeReached | None = None) -> None:
        pass


class WallClock:
    """Mission time runs `speed` times as fast as the wall clock, from its value at the first call or the newest change.

    A flight that falls more than `bound_s` behind does not catch up: the schedule moves, and `slipped_s` is the sum of
    these moves.
    """

    def __init__(
        self, speed: float, bound_s: float = 5.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.speed = FlightSpeed(speed)
        self._times = speed
        """The speed since `_origin`."""
        self._bound_s = bound_s
        self._clock = clock
        self._origin: tuple[int, float] | None = None
        self.behind_s = 0.0
        self.slipped_s = 0.0

    def clock_ms(self) -> int:
        """The wall clock, which all processes of this machine have in common."""
        return round(1000 * self._clock())

    def begin_at(self, clock_ms: int) -> None:
        """Mission time 0 is at this time of the wall clock."""
        self._origin = (0, clock_ms / 1000)

    def reach(self, now_ms: int, stopped: StopSign, between: OnTimeReached | None = None) -> None:
        now_s = self._clock()
        if self._origin is None:
            self._origin = (now_ms, now_s)
        due_s = self._due_s(now_ms, now_s)
        is_late = due_s <= now_s
        while due_s > now_s:
            # A change of the speed wakes nobody.
            if stopped.wait(min(due_s - now_s, POLL_PERIOD_S if between else _CHANGED_S)):
                break
            now_s = self._clock()
            start_ms, start_s = self._origin
            reached_ms = MissionMs(start_ms + int((now_s - start_s) * 1000 * self._times))
            if between is not None and reached_ms < now_ms:
                between(reached_ms)
                now_s = self._clock()
            due_s = self._due_s(now_ms, now_s)
        # A busy machine wakes a process late.
        self.behind_s = max(0.0, self._clock() - due_s)
        if is_late and self.behind_s > self._bound_s:
            self.slipped_s += self.behind_s
            start_ms, start_s = self._origin
            self._origin = (start_ms, start_s + self.behind_s)

    def _due_s(self, now_ms: int, now_s: float) -> float:
        """The wall time of a mission time, by the present speed; never, while mission time stands still."""
        assert self._origin is not None
        start_ms, start_s = self._origin
        if (times := self.speed.present) != self._times:
            reached_ms = min(now_ms, start_ms + int((now_s - start_s) * 1000 * self._times))
            self._origin, self._times = (reached_ms, now_s), times
            start_ms, start_s = self._origin
        if times > 0:
            return start_s + (now_ms - start_ms) / 1000 / times
        if not self.speed.lets_pass(now_ms):
            return math.inf
        self._origin = (now_ms, now_s)
        return now_s
