"""Checks of an aPad's positions as they arrived before a mission: their rate, place, quality, stamps and sources."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.doctor.finding import Finding, cannot_tell, fail, ok, warn
from apad_bridge.doctor.origin_check import ReportedPlace

TOO_LATE_S = 1.0
MISSING_SHARE = 0.1
LEAST_HZ = 2.0
SCATTER_M = 1.0
"""Places of an aPad at rest that lie farther apart than this (standard deviation) are no place to dock by."""
VARIANCE_M2 = 4.0
POSITION_OK = 3
"""auv_msgs/NavSts: the constants STATUS_LOCAL_FRAME_OK and STATUS_GLOBAL_FRAME_OK."""
DEVIATIONS_95 = 2.45
"""95 % of the places lie within so many deviations of one coordinate (Rayleigh)."""


@dataclass(frozen=True, slots=True)
class PositionSample:
    """A position of the aPad as it arrived: at `at_s` of this machine's monotonic clock, with its header's number.

    Zeros in `status`, variances, `stamp_s`, and in pairs of degrees (latitude, longitude) say that the vehicle tells none.
    """

    at_s: float
    sequence: int
    north_m: float
    east_m: float
    status: int = 0
    north_variance_m2: float = 0.0
    east_variance_m2: float = 0.0
    yaw_rad: float = 0.0
    stamp_s: float = 0.0
    """The header's stamp, by the vehicle's clock."""
    wall_s: float = 0.0
    """The arrival by this machine's wall clock."""
    origin_deg: tuple[float, float] = (0.0, 0.0)
    global_deg: tuple[float, float] = (0.0, 0.0)

    @property
    def fault(self) -> str | None:
        """The number that is not finite, or beyond every water."""
        return out_of_range(north_m=self.north_m, east_m=self.east_m, yaw_rad=self.yaw_rad)

    @property
    def variances_m2(self) -> tuple[float, float]:
        return self.north_variance_m2, self.east_variance_m2


def reported_places(samples: Sequence[PositionSample]) -> list[ReportedPlace]:
    """The origin and the place in degrees of the newest position, as far as it has them."""
    if not (sound := [it for it in samples if it.fault is None]):
        return []
    last = sound[-1]
    told = []
    if any(last.origin_deg):
        told.append(ReportedPlace("its positions' origin", *last.origin_deg))
    if any(last.global_deg):
        told.append(
            ReportedPlace("its positions' global_position", *last.global_deg, last.north_m, last.east_m)
        )
    return told


def check_loss(samples: Sequence[PositionSample], seconds: float) -> Finding:
    """Checks the position's messages for losses and long pauses."""
    if len(samples) < 2:
        return fail(f"{len(samples)} positions in {seconds:g} s", "see the line of the position")
    numbers = [it.sequence for it in samples]
    pause_s = max(b.at_s - a.at_s for a, b in itertools.pairwise(samples))
    counts = numbers[-1] > numbers[0]
    missing = max(0, numbers[-1] - numbers[0] + 1 - len(numbers)) if counts else 0
    told = f"{missing} of {missing + len(samples)} positions missing" if counts else "they are not numbered"
    found = f"{len(samples)} positions in {seconds:g} s, {told}, the longest pause {pause_s:.2f} s"
    mend = "come nearer with the antenna, or take another channel; a wired tether for the first trials"
    if pause_s > TOO_LATE_S or missing > MISSING_SHARE * (missing + len(samples)):
        return fail(found, mend)
    return warn(found, mend) if missing or pause_s > 0.5 else ok(found)


def check_position(
    samples: Sequence[PositionSample],
    seconds: float,
    jump_m: float,
    speed_m_s: float,
    publishers: Sequence[str] = (),
) -> Finding:
    """The aPad's position has one source, comes often enough, is finite and does not jump.

    `speed_m_s` is the fastest that it goes, `publishers` the nodes that publish the topic.
    """
    if len(publishers) > 1:
        return fail(
            f"{len(publishers)} nodes publish it, {', '.join(publishers)}: the bench would take places of both in turn",
            "end all of these nodes but the vehicle's own; or --remap the topic to the one that is right",
        )
    if not samples:
        return fail(f"none within {seconds:g} s", "start what publishes it: GPS, filter, the vehicle's node")
    if bad := [fault for it in samples if (fault := it.fault) is not None]:
        return fail(
            f"{len(bad)} of {len(samples)} are not finite or beyond every water: {bad[-1]}",
            "start the vehicle's filter again, and see its origin and its compass",
        )
    if len(samples) < LEAST_HZ * seconds:
        return fail(
            f"{len(samples)} in {seconds:g} s: {LEAST_HZ:g} a second are needed",
            "raise the rate of what publishes it, or mend the network first",
        )
    for before, after in itertools.pairwise(samples):
        way_m = math.dist((before.north_m, before.east_m), (after.north_m, after.east_m))
        if way_m > jump_m + speed_m_s * (after.at_s - before.at_s):
            return fail(f"it jumped by {way_m:.1f} m", "wait for a steady GPS, and see the vehicle's filter")
        if before.stamp_s and after.stamp_s < before.stamp_s:
            return fail(
                f"its stamps went back by {before.stamp_s - after.stamp_s:.2f} s",
                "see who sets the vehicle's clock, and whether its filter puts old positions out",
            )
    last = samples[-1]
    return ok(
        f"({last.north_m:.1f} m north, {last.east_m:.1f} m east), {len(samples) / seconds:.1f} a second",
    )


def check_gps(samples: Sequence[PositionSample], expected_m: float | None = None) -> Finding:
    """The quality that NavSts tells (status, variances), and how the places of an aPad at rest scatter.

    `expected_m` is the scenario's error of a position (95 %); a larger one than it is red.
    """
    sound = [it for it in samples if it.fault is None]
    if len(sound) < 2:
        return fail("there are not two positions to judge it by", "see the line of the position")
    last = sound[-1]
    scatter_m = math.hypot(
        statistics.pstdev(it.north_m for it in sound), statistics.pstdev(it.east_m for it in sound)
    )
    found = f"it scatters by {scatter_m:.2f} m"
    mend = "wait for more satellites, keep the antenna clear, or let it lie still and try again"
    if scatter_m > SCATTER_M:
        return fail(found, mend)
    if not last.status and not any(last.variances_m2):
        return cannot_tell(
            f"{found}; the aPad tells neither status nor variance",
            "see its GPS receiver by hand: fix, satellites, HDOP",
        )
    found += f", variances {last.variances_m2[0]:.2f} and {last.variances_m2[1]:.2f} m2, status {last.status}"
    if (
        not last.status & POSITION_OK
        or max(last.variances_m2) > VARIANCE_M2
        or not all(map(math.isfinite, last.variances_m2))
    ):
        return fail(found, mend)
    error_m = DEVIATIONS_95 * math.sqrt(max(0.0, *last.variances_m2, scatter_m**2 / 2))
    if expected_m is not None and error_m > expected_m:
        return fail(
            f"{found}: an error of {error_m:.2f} m (95 %), and guards.position_error_m is {expected_m:g} m",
            f"wait for a better fix, or set guards.position_error_m to {math.ceil(10 * error_m) / 10:g} with the "
            "clearance that it needs",
        )
    return ok(found)


def check_lag(samples: Sequence[PositionSample], clock_s: float | None) -> Finding:
    """The age of the positions when they arrive, and the vehicle's clock; a clock that is off is measured, not refused.

    `clock_s` is the offset of the vehicle's clock from this machine's by the stamps of another topic of the vehicle, which
    no filter delays; None where there is none. Then a constant age cannot be told from a clock that is off.
    """
    if not (offsets_s := [it.stamp_s - it.wall_s for it in samples if it.stamp_s]):
        return cannot_tell(
            "its positions are not stamped: an old one looks like a new one",
            "have what publishes them stamp them",
        )
    offset_s = statistics.median(offsets_s)
    if clock_s is None:
        found = (
            f"stamps of its positions are {offset_s:+.2f} s from this machine's clock: the clock's offset and the "
            "positions' own lag together"
        )
        if abs(offset_s) <= TOO_LATE_S:
            return ok(found)
        return warn(
            f"{found}, which nothing else tells apart",
            "compare the vehicle's clock by hand (date), or set both alike (chrony): what is left over is the lag",
        )
    lag_s = clock_s - offset_s
    found = (
        f"the vehicle's clock is {clock_s:+.2f} s from this machine's; its positions arrive {lag_s:.2f} s old"
    )
    if abs(lag_s) <= TOO_LATE_S:
        return ok(found)
    return cannot_tell(
        f"{found}: they are late, or stamped by another clock",
        "see the vehicle's filter, and the clock of what stamps its positions: push it by hand and watch the place",
    )
