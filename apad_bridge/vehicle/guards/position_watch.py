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
from itertools import pairwise

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.guards.guarded_orders import Point
from apad_bridge.vehicle.guards.two_places import TwoPlaces

SAMPLE_MS = 800
"""The least time between two samples."""
VELOCITY_MS = 2_000
"""The velocity is the mean over the newest positions of so long."""
LEAST_SPEED_MS = 5_000
"""The least speed is judged over ways of at most so long: noise hides less of a longer one."""
SETTLED_MS = 10_000
"""A position that has jumped is believed again after so long without another jump."""
PLACE_ERROR_M = 0.1
"""The error of the way between two positions of the last two seconds (a GPS, after the vehicle's filter)."""
ARRIVAL_ERROR_MS = 1_000
"""The error of the time between two positions without stamps: it is the ticks of their arrival."""
LATE_MS = 5_000
"""A position that is later waited for a bench that stood still. The vehicle's watchdog may stop it after twice as long."""
LATE_FAULT_MS = 3_000
"""Such a position is a fault for so long. Newer ones are good again then, and tell if the vehicle obeys its stop."""
CLOCK_SET_MS = 5_000
"""Stamps and arrivals that differ by more tell that the vehicle's clock was set."""
BACK_MS = 100
"""Stamps that go back by more are no times of one clock. Positions keep their order on a connection."""
LEAST_DELAY_MS = 60_000
"""The least delay of a position is that of the last one or two such spans."""
RISE_MS = 30
GROWN_COUNT = 5
GROWN_MS = 500
GROWN_WITHIN_MS = 2_000
"""A delay that rises by `RISE_MS` or more from each of so many positions to the next, and by `GROWN_MS` in all within that
time, is a lag that goes on growing. A poor link makes one position late, or two, and then delivers all of them."""


NEVER_MS = 10**15


THERE_M = 1.0
"""Farther than this from its goal, a vehicle is under way."""
WITNESS_MS = 5_000
"""The vehicle's own speed, and the noise of its position, are compared with its ways of at most so long."""
WITNESS_WAY_M = 1.0
"""The least way that the vehicle's own speed must make, before a position that does not follow contradicts it."""
WITNESS_SHARE = 0.3
"""A position that makes less than this share of that way contradicts it."""
STILL_SHARE = 0.2
"""A position under way whose every step is below this share of those at rest is frozen."""
LEAST_NOISE_M = 0.02
"""Smaller steps at rest than this tell nothing about a position that stands still."""
_NOISE_WEIGHT = 0.05
"""The weight of the newest positions in the mean square of the noise."""
_NEW_NOISES = 4
"""A receiver may become noisy at once: where the mean of so many newest squares is greater, it counts."""
_SPEED_NOISES = 8
"""For the least speed the second greatest of so many newest squares counts: a place that is off makes two or three great
ones, a vehicle that changes its speed one."""
NOISE_SPAN_MS = 4_000
"""Noise is learned from three samples within so long: a vehicle changes its speed in a longer time."""
NOISE_ERRORS = 3.0
"""The error of a way between two positions, in steps of the noise: four deviations along the way."""
ERRORS_95 = 2.45 / 2
"""95 % of the places lie within so many steps of the noise: 2.45 deviations of one coordinate (Rayleigh), of which a step
has two."""
LEAST_REPORTED_M = 0.4
"""A vehicle that starts and turns looks like noise: of 0.3 m (95 %) in a flight of `published-a.yaml`, which has none."""
ERRORS_ABOVE = 1.5
"""Noise is too great from so many times the error that the clearance counts on, and until it falls below that error: some
forty positions tell it, whose mean square differs by a fifth by chance."""


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


class _VehicleClock:
    """The clock of the vehicle's stamps, beside the times of arrival."""

    def __init__(self) -> None:
        self._newest: PoseReported | None = None
        """The newest pose with a stamp."""
        self._since_ms = 0
        self._least_ms: int | None = None
        """The least of the time of arrival less the stamp, since `_since_ms`."""
        self._least_before_ms: int | None = None
        self._rising: deque[tuple[int, int]] = deque()
        """The time of arrival, and what it is after the stamp: of the newest positions, while the second rises."""

    def stands_still(self, pose: PoseReported) -> bool:
        """Its stamp is the one before: such stamps are no times."""
        newest = self._newest
        return newest is not None and pose.stamp_ms is not None and pose.stamp_ms == newest.stamp_ms

    def was_set(self, pose: PoseReported) -> bool:
        newest = self._newest
        if newest is None or pose.stamp_ms is None:
            return False
        span_ms = _span_ms(newest, pose)
        return span_ms < 0 or abs(span_ms - (_heard_ms(pose) - _heard_ms(newest))) > CLOCK_SET_MS

    def step_ms(self, pose: PoseReported) -> int:
        """The step of the stamps beyond what delays explain: ahead above 0, back below 0."""
        newest = self._newest
        if newest is None or pose.stamp_ms is None or newest.stamp_ms is None:
            return 0
        if pose.stamp_ms < newest.stamp_ms - BACK_MS:
            return pose.stamp_ms - newest.stamp_ms
        known = [it for it in (self._least_ms, self._least_before_ms) if it is not None]
        return max(0, min(known) - (_heard_ms(pose) - pose.stamp_ms)) if known else 0

    @property
    def grown_ms(self) -> int:
        """The growth of the delay over the newest positions; 0 where fewer than `GROWN_COUNT` rise."""
        return self._rising[-1][1] - self._rising[0][1] if len(self._rising) >= GROWN_COUNT else 0

    def _look_if_it_grows(self, heard_ms: int, offset_ms: int) -> None:
        if self._rising and offset_ms < self._rising[-1][1] + RISE_MS:
            self._rising.clear()
        self._rising.append((heard_ms, offset_ms))
        while heard_ms - self._rising[0][0] > GROWN_WITHIN_MS:
            self._rising.popleft()

    def take(self, pose: PoseReported) -> None:
        if pose.stamp_ms is None:
            return
        self._newest = pose
        heard_ms = _heard_ms(pose)
        offset_ms = heard_ms - pose.stamp_ms
        self._look_if_it_grows(heard_ms, offset_ms)
        if heard_ms - self._since_ms >= LEAST_DELAY_MS:
            self._since_ms, self._least_before_ms, self._least_ms = heard_ms, self._least_ms, None
        self._least_ms = offset_ms if self._least_ms is None else min(self._least_ms, offset_ms)

    def late_ms(self, pose: PoseReported) -> int:
        """The delay of this position beyond the least delay."""
        known = [it for it in (self._least_ms, self._least_before_ms) if it is not None]
        return 0 if pose.stamp_ms is None or not known else _heard_ms(pose) - pose.stamp_ms - min(known)

    def earliest_ms(self, pose: PoseReported) -> int:
        """The mission time at which this position would have come without more than the least delay."""
        return pose.at_ms - self.late_ms(pose)


class PositionWatch:
    """Takes each reported pose; `fault` is the reason not to use the newest, empty for a good one."""

    def __init__(self, limits: PositionLimits) -> None:
        self.limits = limits
        self._newest: PoseReported | None = None
        self._samples: deque[PoseReported] = deque()
        """The samples of the last `LEAST_SPEED_MS`, the newest last."""
        self._least_speeds: deque[tuple[PoseReported, float]] = deque(maxlen=2)
        """The least speed at each of the two newest samples, with what was known of the noise then."""
        self._witnesses: deque[PoseReported] = deque()
        """The samples of the last `WITNESS_MS` since the vehicle is under way, the newest last."""
        self._clock = _VehicleClock()
        self._doubt = ""
        self._doubted_ms = 0
        self._late: tuple[int, int] | None = None
        """The newest arrival of a position that came late, and the greatest lateness since a person believed it; in ms."""
        self._invalid: tuple[int, str] | None = None
        """Time and reason of a newest position that is no place at all."""
        self._frozen_ms = 0
        """Time under way with a position that stayed the same to the last bit."""
        self._noise_m2: float | None = None
        """The mean square of the step that noise alone makes between two positions."""
        self._new_noises_m2: deque[float] = deque(maxlen=_SPEED_NOISES)
        """The newest squares of it."""
        self._rest_m2: float | None = None
        """The mean square of the steps at rest."""
        self.is_too_noisy = False
        """The noise alone is more than the error that the clearance counts on."""
        self._two_places = TwoPlaces()
        self._goal_m: Point | None = None
        self._under_way_ms = 0
        """The time at which the vehicle accepted the order by which it is under way."""

    @property
    def place_m(self) -> Point | None:
        """The newest place, good or bad."""
        return None if self._newest is None else _place(self._newest)

    @property
    def velocity_m_s(self) -> Point:
        last = self._newest
        earlier = [it for it in reversed(self._samples) if it is not last]
        if last is None or not earlier:
            return (0.0, 0.0)
        first = next((it for it in earlier if _span_ms(it, last) >= VELOCITY_MS), earlier[-1])
        seconds = _span_ms(first, last) / 1000
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
        older = (it for pose, it in reversed(self._least_speeds) if _span_ms(pose, last) >= SAMPLE_MS)
        return min(least_m_s, max(last.speed_m_s, next(older, 0.0)))

    def _least_speed_m_s(self, last: PoseReported) -> float:
        """The least speed by the positions alone."""
        samples = self._samples
        if last.stamp_ms is not None and self._noise_m2 is None:
            return 0.0
        error_m, least_m_s = self.way_error_m, 0.0
        for before in samples:
            span_ms = _span_ms(before, last)
            seconds = (span_ms + _error_ms(before, last)) / 1000
            if span_ms >= VELOCITY_MS or (before is samples[0] and span_ms > 0):
                way_m = math.dist(_place(before), _place(last))
                least_m_s = max(least_m_s, (way_m - error_m) / seconds)
        return least_m_s

    @property
    def way_error_m(self) -> float:
        """The error of the way between two positions, by the noise that is known."""
        second_m2 = max(sorted(self._new_noises_m2)[:-1], default=0.0)
        return max(PLACE_ERROR_M, NOISE_ERRORS * max(self._noise_m, math.sqrt(second_m2)))

    @property
    def _noise_m(self) -> float:
        """The root mean square of the step that noise alone makes, both directions together."""
        if self._noise_m2 is None:
            return 0.0
        newest = list(self._new_noises_m2)[-_NEW_NOISES:]
        newest_m2 = math.fsum(newest) / len(newest) if len(newest) == _NEW_NOISES else 0.0
        return math.sqrt(max(self._noise_m2, newest_m2))

    @property
    def noise_error_m(self) -> float:
        """The error of a place by its noise alone, in 95 % of all cases."""
        return 0.0 if self._noise_m2 is None else ERRORS_95 * math.sqrt(self._noise_m2)

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
        self._count_frozen(newest, pose)
        if newest is not None and self._is_jump(newest, pose):
            way_m = math.dist(_place(newest), _place(pose))
            self._doubt_it(f"it has jumped by {way_m:.0f} m", pose.at_ms)
            self._forget_the_way()  # no velocity across a jump
        self._newest = pose
        if not self._samples or _span_ms(self._samples[-1], pose) >= SAMPLE_MS:
            self._take_sample(pose)

    def _take_sample(self, pose: PoseReported) -> None:
        before = self._samples[-1] if self._samples else None
        if len(self._samples) >= 2:
            self._learn_noise(self._samples[-2], self._samples[-1], pose)
        self._look_for_witnesses(before, pose)
        self._least_speeds.append((pose, self._least_speed_m_s(pose)))
        self._samples.append(pose)
        while len(self._samples) > 2 and _span_ms(self._samples[1], pose) >= LEAST_SPEED_MS:
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
        at_ms = _heard_ms(pose) if pose.stamp_ms is None else pose.stamp_ms
        if (apart_m := self._two_places.take(at_ms, _place(pose))) > 0:
            self._doubt_it(f"it alternates between two places {apart_m:.1f} m apart", pose.at_ms)
            self._two_places.forget()

    def take_invalid(self, at_ms: int, reason: str) -> None:
        """Takes a newest position that is no place: not a number, or beyond all waters."""
        self._invalid = at_ms, reason

    def believe(self) -> None:
        """A person has looked at the position, and believes it: every doubt ends."""
        self._doubt, self._frozen_ms, self._late = "", 0, None
        self._witnesses.clear()
        self._two_places.forget()
        self._clock = _VehicleClock()

    def note_goal(self, goal_m: Point | None, at_ms: int = 0) -> None:
        """The place to which the vehicle goes, or where it stays, by an order accepted at `at_ms`; None for none."""
        if self._newest is None or not self._is_under_way(self._newest):
            self._under_way_ms = at_ms
        self._goal_m = goal_m

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
        if self._frozen_ms >= limits.frozen_ms:
            return f"the aPad's position has not changed at all for {limits.frozen_ms / 1000:g} s under way"
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
        self._clock = _VehicleClock()
        self._forget_the_way()
        return None if newest is None else replace(newest, stamp_ms=None)

    def _forget_the_way(self) -> None:
        self._samples.clear()
        self._least_speeds.clear()
        self._witnesses.clear()

    def _doubt_it(self, reason: str, at_ms: int) -> None:
        """The newest doubt begins the time to settle anew. The first reason stays where a person must look."""
        if not self._doubt or self.limits.settled_ms is not None:
            self._doubt = reason
        self._doubted_ms = at_ms

    def _count_frozen(self, newest: PoseReported | None, pose: PoseReported) -> None:
        """The first witness of a frozen position: it does not change at all, to the last bit."""
        latches = self.limits.settled_ms is None
        if newest is None or _bits(newest) != _bits(pose):
            self._frozen_ms = 0
        elif self._is_under_way(pose) and self._clock.earliest_ms(newest) >= self._under_way_ms:
            # It adds up over orders, and stays when the vehicle is told to stop: only a motion ends it.
            self._frozen_ms += _span_ms(newest, pose)
            if latches and self._frozen_ms >= self.limits.frozen_ms:
                seconds = self.limits.frozen_ms / 1000
                self._doubt_it(f"it has not changed at all for {seconds:g} s under way", pose.at_ms)

    def _look_for_witnesses(self, before: PoseReported | None, pose: PoseReported) -> None:
        """The other witnesses of a frozen position: a speed or a noise that it contradicts."""
        if self.limits.frozen_ms == NEVER_MS:
            return
        if not self._is_under_way(pose) or self._clock.earliest_ms(pose) < self._under_way_ms:
            self._learn_rest(before, pose)
            self._witnesses.clear()
            return
        self._witnesses.append(pose)
        while len(self._witnesses) > 2 and _span_ms(self._witnesses[1], pose) >= WITNESS_MS:
            self._witnesses.popleft()
        if reason := self._contradiction():
            self._doubt_it(reason, pose.at_ms)

    def _learn_rest(self, before: PoseReported | None, pose: PoseReported) -> None:
        if before is None or self._goal_m is None or not SAMPLE_MS <= _span_ms(before, pose) <= WITNESS_MS:
            return
        self._rest_m2 = _learned(self._rest_m2, math.dist(_place(before), _place(pose)) ** 2)

    def _learn_noise(self, one: PoseReported, middle: PoseReported, pose: PoseReported) -> None:
        """Learns from the middle one's distance to the line between its neighbours, which a steady motion leaves out.

        With weights a and b of the neighbours (a + b = 1), the mean square of that distance is 1 + a^2 + b^2 times the
        noise's own, and the mean square of a step is 2 times it.
        """
        if None in (one.stamp_ms, middle.stamp_ms, pose.stamp_ms):
            return  # times of arrival have an error of their own
        span_ms = _span_ms(one, pose)
        if not 0 < span_ms <= NOISE_SPAN_MS:
            return
        later = _span_ms(one, middle) / span_ms
        north_m = middle.north_m - (1 - later) * one.north_m - later * pose.north_m
        east_m = middle.east_m - (1 - later) * one.east_m - later * pose.east_m
        step_m2 = 2 * (north_m**2 + east_m**2) / (1 + later**2 + (1 - later) ** 2)
        self._noise_m2 = _learned(self._noise_m2, step_m2)
        self._new_noises_m2.append(step_m2)
        expected_m = max(self.limits.error_m, LEAST_REPORTED_M)
        least_m = expected_m * (1.0 if self.is_too_noisy else ERRORS_ABOVE)
        self.is_too_noisy = self.noise_error_m > least_m and len(self._new_noises_m2) == _SPEED_NOISES

    def _contradiction(self) -> str:
        """The reason why the positions under way contradict the vehicle's own speed, or their own noise.

        All positions of the time must lie in one spot. Noise brings two of a moving vehicle together now and then.
        """
        poses = list(self._witnesses)
        told_m = spread_m = 0.0
        for n in range(len(poses) - 1, 0, -1):
            before, after = poses[n - 1], poses[n]
            if before.speed_m_s is None or after.speed_m_s is None:
                break
            told_m += (before.speed_m_s + after.speed_m_s) / 2 * _span_ms(before, after) / 1000
            spread_m = max(spread_m, *(math.dist(_place(before), _place(it)) for it in poses[n:]))
            least_m = max(WITNESS_WAY_M, NOISE_ERRORS * self._noise_m / (1 - WITNESS_SHARE))
            if told_m >= least_m and spread_m < WITNESS_SHARE * told_m:
                return f"it moved by {spread_m:.1f} m while the vehicle measured a way of {told_m:.1f} m"
        if len(poses) < 2 or _span_ms(poses[0], poses[-1]) < WITNESS_MS:
            return ""
        noise_m = 0.0 if self._rest_m2 is None else math.sqrt(self._rest_m2)
        steps_m = [math.dist(_place(one), _place(next_one)) for one, next_one in pairwise(poses)]
        if noise_m >= LEAST_NOISE_M and max(steps_m) < STILL_SHARE * noise_m:
            return f"it moves by {max(steps_m):.3f} m a second under way, and by {noise_m:.2f} m at rest"
        return ""

    def _is_under_way(self, pose: PoseReported) -> bool:
        return self._goal_m is not None and math.dist(self._goal_m, _place(pose)) > THERE_M

    def _is_jump(self, before: PoseReported, after: PoseReported) -> bool:
        seconds = (_span_ms(before, after) + _error_ms(before, after)) / 1000
        way_m = math.dist(_place(before), _place(after))
        return way_m > self.limits.jump_m + self.limits.speed_m_s * seconds


def _learned(known: float | None, newest: float) -> float:
    before = newest if known is None else known
    return before + _NOISE_WEIGHT * (newest - before)


def _span_ms(before: PoseReported, after: PoseReported) -> int:
    if before.stamp_ms is None or after.stamp_ms is None:
        return _heard_ms(after) - _heard_ms(before)
    return after.stamp_ms - before.stamp_ms


def _heard_ms(pose: PoseReported) -> int:
    """The time of arrival. A tick that is late takes positions that are newer than its own time."""
    return pose.at_ms if pose.heard_ms is None else pose.heard_ms


def _error_ms(before: PoseReported, after: PoseReported) -> int:
    return ARRIVAL_ERROR_MS if before.stamp_ms is None or after.stamp_ms is None else 0


def _place(pose: PoseReported) -> Point:
    return pose.north_m, pose.east_m


def _bits(pose: PoseReported) -> tuple[float, float, float]:
    return pose.north_m, pose.east_m, pose.heading_rad
