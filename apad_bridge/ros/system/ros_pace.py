"""Paces mission time on ROS: by our own /clock, or by somebody else's.

    OwnMasterClock(speed, link, start_ms=0)       # we publish /clock; only ever on a master that we started
    FollowedClock(start_ms=0, link=None)          # we follow /clock; mission time `start_ms` is that of the first `reach`
    StampedByMaster(pace, start_ms=0)             # any pace on somebody else's master

The node is initialised before (`open_gateway`).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

import rospy
from rosgraph_msgs.msg import Clock

from agents.time_scale import MissionMs
from apad_bridge.ros.system.ros_time import follow_master, to_ms, to_ros
from apad_bridge.ros_names.names import CLOCK, CLOCK_REACHED
from apad_bridge.supervisor.clock import (
    POLL_PERIOD_S,
    AsFastAsPossible,
    ClockLost,
    CommonClock,
    FlightSpeed,
    OnTimeReached,
    Pace,
    StopSign,
    WallClock,
)

PATIENCE_S = 60.0
"""Wall seconds that the aPad's node may take for a tick. It takes milliseconds, and on a machine that is busy, or that was
suspended, much longer. The parent notices a node that has died, and we a master that is gone, within a second or two."""
_REPEAT_S = 1.0
"""Wall seconds without its answer after which the time is published again. An answer is lost when it leaves before rospy
has added us to its receivers, which happens after we are informed of the connection."""
SETTLE_S = 1.0
"""Wall seconds for its other topics. A message that misses this is received at a later tick, without more delay."""
STANDSTILL_S = 60.0
"""Wall seconds after which a /clock that stands still is lost; a person may pause a simulation."""
FIRST_S = 10.0
"""Wall seconds for the first /clock."""
TAKEN_S = 3.0
"""Wall seconds for the vehicle's answers while a /clock waits for us: fewer than `paced_clock.PATIENCE_S`."""
_STEPS_MS = (100, 200, 500, 1000)
_STEP_WALL_S = 0.02
"""The shortest wall time between two /clock messages, which are also no finer than the aPad's 10 Hz."""


WhyGone = Callable[[], str | None]
"""Why the master does not answer; None when it does."""


class InStep(Protocol):
    """A vehicle that confirms the end of a tick."""

    @property
    def name(self) -> str: ...

    def wait_until_taken(self, timeout_s: float) -> list[str]: ...

    def wait_until_done(self, now_ms: int, timeout_s: float) -> bool: ...

    def wait_until_heard(self, now_ms: int, timeout_s: float) -> list[str]: ...


class OwnMasterClock:
    """Publishes /clock `speed` times as fast as the wall clock (None: as fast as the aPad's node follows).

    A tick is reached when the aPad's node confirms it: ClockLost, with its name, after `patience_s`. Until then the same
    time is published once a second, and a stopped flight waits no longer than that. When `why_gone` has a reason for the
    master's silence, nobody can confirm anything, and the reason is raised at once. With `in_fine_steps` all this holds for
    every tenth of a second: for a vehicle that acts on the virtual camera.

    /clock is latched, so that a later tool has the time at once. A hundred messages may wait for a slow reader; it then
    loses the oldest, and nobody waits for it.
    """

    def __init__(
        self,
        speed: float | None,
        link: InStep,
        start_ms: int = 0,
        patience_s: float = PATIENCE_S,
        *,
        in_fine_steps: bool = False,
        why_gone: WhyGone = lambda: None,
    ) -> None:
        self._link = link
        self._why_gone = why_gone
        self._patience_s = patience_s
        self._published_ms = start_ms
        self._has_published = False
        self._pace: Pace = AsFastAsPossible() if speed is None else WallClock(speed)
        self._in_fine_steps = in_fine_steps
        self._clock = rospy.Publisher(CLOCK, Clock, queue_size=100, latch=True)

    @property
    def speed(self) -> FlightSpeed | None:
        return self._pace.speed

    @property
    def behind_s(self) -> float:
        return self._pace.behind_s

    @property
    def _step_ms(self) -> int:
        if self._in_fine_steps:
            return _STEPS_MS[0]
        times = 0.0 if self.speed is None else self.speed.times
        return next((it for it in _STEPS_MS if times and it / 1000 / times >= _STEP_WALL_S), 1000)

    def reach(self, now_ms: int, stopped: StopSign, between: OnTimeReached | None = None) -> None:
        self._link.wait_until_taken(SETTLE_S)
        while self._published_ms < now_ms or not self._has_published:
            step_ms = now_ms if stopped.is_set() else min(now_ms, self._published_ms + self._step_ms)
            self._pace.reach(step_ms, stopped, between)
            self._clock.publish(Clock(to_ros(step_ms)))
            self._published_ms, self._has_published = step_ms, True
            if self._in_fine_steps and step_ms < now_ms:
                self._wait_until_done(step_ms, stopped)
            if between is not None and step_ms < now_ms:
                between(MissionMs(step_ms))
        if self._wait_until_done(now_ms, stopped):
            self._link.wait_until_heard(now_ms, SETTLE_S)

    def _wait_until_done(self, now_ms: int, stopped: StopSign) -> bool:
        """False when the flight was stopped before the node confirmed this time."""
        until_s = time.monotonic() + self._patience_s
        while not self._link.wait_until_done(now_ms, min(_REPEAT_S, max(0.0, until_s - time.monotonic()))):
            if stopped.is_set():
                return False
            if (gone := self._why_gone()) is not None:
                raise ClockLost(gone)
            if time.monotonic() >= until_s:
                raise ClockLost(
                    f"the node of /{self._link.name} did not say within {self._patience_s:g} s, by its stateRef, "
                    f"that it has come to {now_ms / 1000:g} s of mission time"
                )
            self._clock.publish(Clock(to_ros(now_ms)))
        return True


class FollowedClock:
    """Somebody else's /clock. ClockLost when it stands still, or goes back, for `standstill_s` wall seconds, or when none
    comes at first within `FIRST_S`. The text is that of `why_gone`, if it has one.

    Mission time `start_ms` is the newest /clock at the first `reach`, or the first one after it. Each `reach` publishes on
    /clock_reached the time of its tick, before which everything is handled: our own clock node waits for it. On a clock
    that waits, the answers of the vehicle `link` to the newest orders come first, as mission time costs patience with it.
    """

    speed: FlightSpeed | None = None

    def __init__(
        self,
        start_ms: int = 0,
        link: InStep | None = None,
        standstill_s: float = STANDSTILL_S,
        why_gone: WhyGone = lambda: None,
    ) -> None:
        self.behind_s = 0.0
        self._link = link
        self._start_ms = start_ms
        self._standstill_s = standstill_s
        self._why_gone = why_gone
        self._clock_ms: int | None = None
        """The newest /clock."""
        self._origin_ms: int | None = None
        """The /clock at mission time `start_ms`."""
        self._tick_ms: int | None = None
        """The mission time that the flight waits for, or has come to."""
        self._advanced = threading.Condition()
        self._reached = rospy.Publisher(CLOCK_REACHED, Clock, queue_size=10, latch=True)
        self._subscriber = rospy.Subscriber(CLOCK, Clock, self._take, tcp_nodelay=True)

    def reach(self, now_ms: int, stopped: StopSign, between: OnTimeReached | None = None) -> None:
        if self._link is not None and self._reached.get_num_connections() > 0:
            self._link.wait_until_taken(TAKEN_S)
        with self._advanced:
            self._tick_ms = now_ms
            self._announce()
            last_ms = self._now_ms
        moved_s = time.monotonic()
        while not self._has_come(now_ms) and not stopped.is_set():
            with self._advanced:
                # It wakes now and then to check `stopped`, which nothing announces here, and to call `between`.
                if not self._has_come(now_ms):
                    self._advanced.wait(0.1 if between is None else POLL_PERIOD_S)
                reached_ms, why = self._now_ms, self._why(now_ms)
            if reached_ms > last_ms:
                moved_s, last_ms = time.monotonic(), reached_ms
            elif time.monotonic() - moved_s > self._patience_s:
                raise ClockLost(self._why_gone() or why)
            if between is not None and self._start_ms < reached_ms < now_ms:
                between(MissionMs(reached_ms))
        with self._advanced:
            self.behind_s = max(0.0, (self._now_ms - now_ms) / 1000)

    def clock_ms(self) -> int:
        """The newest /clock, or the first one. ClockLost when none comes in time."""
        with self._advanced:
            if self._advanced.wait_for(lambda: self._clock_ms is not None, self._patience_s):
                assert self._clock_ms is not None
                return self._clock_ms
            why = self._why(0)
        raise ClockLost(self._why_gone() or why)

    def begin_at(self, clock_ms: int) -> None:
        """Mission time 0 is at this /clock."""
        with self._advanced:
            self._start_ms, self._origin_ms = 0, clock_ms

    def close(self) -> None:
        self._subscriber.unregister()
        self._reached.unregister()

    @property
    def _patience_s(self) -> float:
        return min(FIRST_S, self._standstill_s) if self._origin_ms is None else self._standstill_s

    @property
    def _now_ms(self) -> int:
        if self._origin_ms is None or self._clock_ms is None:
            return self._start_ms
        return self._start_ms + self._clock_ms - self._origin_ms

    def _has_come(self, now_ms: int) -> bool:
        return self._origin_ms is not None and self._now_ms >= now_ms

    def _take(self, message: Any) -> None:
        with self._advanced:
            is_first = self._origin_ms is None
            self._clock_ms = to_ms(message.clock)
            if is_first:
                self._announce()
            self._advanced.notify_all()

    def _announce(self) -> None:
        """Publishes the time of the tick, from the first /clock and the first `reach` on. Its caller has the lock."""
        if self._clock_ms is None or self._tick_ms is None:
            return
        if self._origin_ms is None:
            self._origin_ms = self._clock_ms
        self._reached.publish(Clock(to_ros(self._origin_ms + self._tick_ms - self._start_ms)))

    def _why(self, now_ms: int) -> str:
        if self._origin_ms is None:
            return f"no /clock came within {self._patience_s:g} s: does its publisher run on this master?"
        return (
            f"/clock has not come nearer to {now_ms / 1000:g} s of mission time for {self._standstill_s:g} s: "
            f"is its publisher paused, gone or started anew?"
        )


class StampedByMaster:
    """A pace on somebody else's master: at each tick the stamps of our messages are set to that master's time."""

    speed: FlightSpeed | None = None

    def __init__(self, pace: CommonClock, start_ms: int = 0) -> None:
        self._pace = pace
        follow_master(start_ms)

    @property
    def behind_s(self) -> float:
        return self._pace.behind_s

    def clock_ms(self) -> int:
        return self._pace.clock_ms()

    def begin_at(self, clock_ms: int) -> None:
        self._pace.begin_at(clock_ms)

    def reach(self, now_ms: int, stopped: StopSign, between: OnTimeReached | None = None) -> None:
        self._pace.reach(now_ms, stopped, between)
        follow_master(now_ms)
