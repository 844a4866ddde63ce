"""Judges a vehicle's position: known, fresh, plausible, from one node, and moving when the vehicle is under way.

A poor link delays positions, and delivers several at once. So ways are measured by the positions' own stamps, the
vehicle's clock. The age is the delay beyond the least delay of the last minutes, so that a lag that grows shows, and a
clock that is off by a constant does not. A position without a stamp has its arrival alone.

A doubt is a reason to believe no position any more: a jump, two places, stamps that step, a delay that grows, a second
publisher, a frozen position. It ends after `settled_ms`, or with a person's word (`believe`).

Each position counts for its age, its stamps, its publisher and its place. Motion and noise are learned from samples at
least `SAMPLE_MS` apart, so that they do not depend on the rate at which somebody looks.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.guards.frozen_position import NEVER_MS, SAMPLE_MS, FrozenPosition
from apad_bridge.vehicle.guards.guarded_orders import Point
from apad_bridge.vehicle.guards.position_noise import PositionNoise
from apad_bridge.vehicle.guards.two_places import TwoPlaces
from apad_bridge.vehicle.guards.vehicle_clock import GROWN_MS, VehicleClock, heard_ms, span_ms

VELOCITY_MS = 2_000
"""The velocity is the mean over the newest positions of so long."""
LEAST_SPEED_MS = 5_000
"""The least speed is judged over ways of at most so long: noise hides less of a longer one."""
SETTLED_MS = 10_000
"""A position that has jumped is believed again after so long without another jump."""
ARRIVAL_ERROR_MS = 1_000
"""The error of the time between two positions without stamps: it is the ticks of their arrival."""
LATE_MS = 5_000
"""A position that is later waited for a bench that stood still. The vehicle's watchdog may stop it after twice as long."""
LATE_FAULT_MS = 3_000
"""Such a position is a fault for so long. Newer ones are good again then, and tell if the vehicle obeys its stop."""


@dataclass(frozen=True, slots=True)
class PositionLimits:
    age_ms: int = 2_000
    """The greatest age of a usable position."""
    jump_m: float = 10.0
    """A position farther than this from where the vehicle can have come has jumped."""
    speed_m_s: float = 2.0
    """The speed that the vehicle can reach, for what it can have come."""
    frozen_ms: int = 2_000
    """A position that stays the same to the last bit for so long, while the vehicle is under way, is frozen."""
    clock_step_ms: int = NEVER_MS
    """Stamps that step ahead by more, or go back, belong to no clock. `NEVER_MS`: a clock that is set changes nothing."""
    settled_ms: int | None = SETTLED_MS
    """A doubt ends after so long. None: it ends with a person's word alone."""
    error_m: float = math.inf
    """The clearance of the fence counts on positions within it, in 95 % of all cases."""


class PositionWatch:
    """Takes each reported pose; `fault` is the reason not to use the newest, empty for a good one."""

    def __init__(self, limits: PositionLimits) -> None:
        self.limits = limits
        self._newest: PoseReported | None = None
        self._samples: deque[PoseReported] = deque()
        """The samples of the last `LEAST_SPEED_MS`, the newest last."""
        self._least_speeds: deque[tuple[PoseReported, float]] = deque(maxlen=2)
        """The least speed at each of the two newest samples, with what was known of the noise then."""
        self._clock = VehicleClock()
        self._doubt = ""
        self._doubted_ms = 0
        self._late: tuple[int, int] | None = None
        """The newest arrival of a position that came late, and the greatest lateness since a person believed it; in ms."""
        self._invalid: tuple[int, str] | None = None
        """Time and reason of a newest position that is no place at all."""
        self.noise = PositionNoise(limits.error_m)
        self._frozen = FrozenPosition(limits.frozen_ms, self.noise)
        self._two_places = TwoPlaces()

    @property
    def place_m(self) -> Point | None:
        """The newest place, good or bad."""
        return None if self._newest is None else self._newest.place_m

    @property
    def velocity_m_s(self) -> Point:
        last = self._newest
        earlier = [it for it in reversed(self._samples) if it is not last]
        if last is None or not earlier:
            return (0.0, 0.0)
        first = next((it for it in earlier if span_ms(it, last) >= VELOCITY_MS), earlier[-1])
        seconds = span_ms(first, last) / 1000
        if seconds <= 0.0:
            return (0.0, 0.0)
        return (last.north_m - first.north_m) / seconds, (last.east_m - first.east_m) / seconds

    @property
    def least_speed_m_s(self) -> float:
        """The speed that the vehicle makes at least, by the errors of places and times; 0 where it turns.

        It is 0 also before anything is known of the noise of stamped positions, which takes three samples. A position
        that noise has moved is not known as noisy before the next one. So a speed beyond the vehicle's own measurement
        needs two samples.
        """
        if (last := self._newest) is None:
            return 0.0
        least_m_s = self._least_speed_m_s(last)
        if last.speed_m_s is None:
            return least_m_s
        older = (it for pose, it in reversed(self._least_speeds) if span_ms(pose, last) >= SAMPLE_MS)
        return min(least_m_s, max(last.speed_m_s, next(older, 0.0)))

    def _least_speed_m_s(self, last: PoseReported) -> float:
        """The least speed by the positions alone."""
        samples = self._samples
        if last.stamp_ms is not None and not self.noise.is_known:
            return 0.0
        error_m, least_m_s = self.noise.way_error_m, 0.0
        for before in samples:
            passed_ms = span_ms(before, last)
            seconds = (passed_ms + _error_ms(before, last)) / 1000
            if passed_ms >= VELOCITY_MS or (before is samples[0] and passed_ms > 0):
                way_m = math.dist(before.place_m, last.place_m)
                least_m_s = max(least_m_s, (way_m - error_m) / seconds)
        return least_m_s

    def take(self, pose: PoseReported) -> None:
        """Takes a pose; one that is older than the newest, or the same again, changes nothing."""
        if (reason := out_of_range(north_m=pose.north_m, east_m=pose.east_m)) is not None:
            self.take_invalid(pose.at_ms, reason)
            return
        newest = self._newest
        if newest is not None and pose.at_ms <= newest.at_ms:
            return
        self._invalid = None
        before = "" if newest is None else newest.publisher
        other = next((it for it in (pose.also_from, before) if it and it != pose.publisher), "")
        if other and pose.publisher:
            self._doubt_it(f"two nodes publish it: {other} and {pose.publisher}", pose.at_ms)
        if self._clock.stands_still(pose):
            pose = replace(pose, stamp_ms=None)
        elif self.limits.clock_step_ms == NEVER_MS:
            if self._clock.was_set(pose):
                newest = self._begin_anew(newest)
        elif (step_ms := self._clock.step_ms(pose)) < 0 or step_ms > self.limits.clock_step_ms:
            how = "ahead" if step_ms > 0 else "back"
            self._doubt_it(f"its stamps went {how} by {abs(step_ms) / 1000:.1f} s", pose.at_ms)
            newest = self._begin_anew(newest)
        self._clock.take(pose)
        if self.limits.clock_step_ms != NEVER_MS and self._clock.grown_ms >= GROWN_MS:
            self._doubt_it(f"its delay grows, by {self._clock.grown_ms / 1000:.1f} s so far", pose.at_ms)
        self._frozen.take(newest, pose, self._clock)
        if self.limits.settled_ms is None and self._frozen.never_changes:
            self._doubt_it(f"it {self._frozen.text}", pose.at_ms)
        if newest is not None and self._is_jump(newest, pose):
            way_m = math.dist(newest.place_m, pose.place_m)
            self._doubt_it(f"it has jumped by {way_m:.0f} m", pose.at_ms)
            self._forget_the_way()  # no velocity across a jump
        self._newest = pose
        if not self._samples or span_ms(self._samples[-1], pose) >= SAMPLE_MS:
            self._take_sample(pose)

    def _take_sample(self, pose: PoseReported) -> None:
        before = self._samples[-1] if self._samples else None
        if len(self._samples) >= 2:
            self.noise.learn(self._samples[-2], self._samples[-1], pose)
        if reason := self._frozen.take_sample(before, pose, self._clock):
            self._doubt_it(reason, pose.at_ms)
        self._least_speeds.append((pose, self._least_speed_m_s(pose)))
        self._samples.append(pose)
        while len(self._samples) > 2 and span_ms(self._samples[1], pose) >= LEAST_SPEED_MS:
            self._samples.popleft()

    def look_at(self, pose: PoseReported) -> None:
        """Looks if a position came late, or alternates between two places. It sees each that a newer one replaces.

        A bench that wakes may hear all positions of its sleep before it looks: the newest is fresh then, and somebody may
        have stopped the vehicle meanwhile. A vehicle that a person gives back can wait for a person; of others, noise of
        the link looks alike.
        """
        if self.limits.settled_ms is not None:
            return
        if self._clock.step_ms(pose) >= 0 and (late_ms := self._clock.late_ms(pose)) > LATE_MS:
            before_ms = 0 if self._late is None else self._late[1]
            self._late = pose.at_ms, max(late_ms, before_ms)
        at_ms = heard_ms(pose) if pose.stamp_ms is None else pose.stamp_ms
        if (apart_m := self._two_places.take(at_ms, pose.place_m)) > 0:
            self._doubt_it(f"it alternates between two places {apart_m:.1f} m apart", pose.at_ms)
            self._two_places.forget()

    def take_invalid(self, at_ms: int, reason: str) -> None:
        """Takes a newest position that is no place: not a number, or beyond all waters."""
        self._invalid = at_ms, reason

    def believe(self) -> None:
        """A person has looked at the position, and believes it: every doubt ends."""
        self._doubt, self._late = "", None
        self._frozen.forget()
        self._two_places.forget()
        self._clock = VehicleClock()

    def note_goal(self, goal_m: Point | None, at_ms: int = 0) -> None:
        """The place to which the vehicle goes, or where it stays, by an order accepted at `at_ms`; None for none."""
        self._frozen.note_goal(goal_m, at_ms, self._newest)

    def fault(self, now_ms: int) -> str:
        limits = self.limits
        if self._newest is None:
            return "the aPad's position is not known"
        if fault := self.fault_now(now_ms):
            return fault
        if self._doubt and (limits.settled_ms is None or now_ms - self._doubted_ms < limits.settled_ms):
            since = "" if limits.settled_ms is None else f" within the last {limits.settled_ms / 1000:g} s"
            return f"the aPad's position is not believed{since}: {self._doubt}"
        if self._late is not None and now_ms - self._late[0] < LATE_FAULT_MS:
            return f"one of the aPad's positions came {self._late[1] / 1000:.1f} s late"
        if self._frozen.never_changes:
            return f"the aPad's position {self._frozen.text}"
        return ""

    def fault_now(self, now_ms: int) -> str:
        """The reason that not even a person's word overrides: there is no place, or an old one."""
        if self._invalid is not None:
            return f"the aPad's position is no place: {self._invalid[1]}"
        if self._newest is None:
            return "the aPad's position is not known"
        if now_ms - self._clock.earliest_ms(self._newest) > self.limits.age_ms:
            return f"the aPad's position is older than {self.limits.age_ms / 1000:g} s"
        return ""

    def _begin_anew(self, newest: PoseReported | None) -> PoseReported | None:
        """Forgets the vehicle's clock, which was set: no velocity goes across two clocks."""
        self._clock = VehicleClock()
        self._forget_the_way()
        return None if newest is None else replace(newest, stamp_ms=None)

    def _forget_the_way(self) -> None:
        self._samples.clear()
        self._least_speeds.clear()
        self._frozen.forget_the_way()

    def _doubt_it(self, reason: str, at_ms: int) -> None:
        """The newest doubt begins the time to settle anew. The first reason stays where a person must look."""
        if not self._doubt or self.limits.settled_ms is not None:
            self._doubt = reason
        self._doubted_ms = at_ms

    def _is_jump(self, before: PoseReported, after: PoseReported) -> bool:
        seconds = (span_ms(before, after) + _error_ms(before, after)) / 1000
        way_m = math.dist(before.place_m, after.place_m)
        return way_m > self.limits.jump_m + self.limits.speed_m_s * seconds


def _error_ms(before: PoseReported, after: PoseReported) -> int:
    return ARRIVAL_ERROR_MS if before.stamp_ms is None or after.stamp_ms is None else 0
