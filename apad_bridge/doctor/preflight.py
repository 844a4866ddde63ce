"""Checks before a real aPad moves: pure functions of what was measured, each with a finding for people.

`key_of` names a finding for `musselbed run --despite KEY`; those in `NEVER_OVERRIDDEN` stop a run whatever is said.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from apad_bridge.beliefs.input_ranges import out_of_range
from apad_bridge.doctor.finding import Finding, Status, fail, ok, warn

if TYPE_CHECKING:
    from apad_bridge.scenario.fence import Fence
    from apad_bridge.scenario.guard_options import GuardOptions

NEVER_OVERRIDDEN = frozenset({"fence", "position", "pilot", "stop"})
_RED_AT_SEA = frozenset({"origin", "docks"})
"""Checks of the doctor whose warning is red for a mission."""

SLOW_S, TOO_SLOW_S = 0.2, 1.0
"""A worse way there and back causes a warning; a far worse one is red, for a stop would be as late."""
MISSING_SHARE = 0.1
LEAST_HZ = 2.0
SCATTER_M = 1.0
"""Places of an aPad at rest that lie farther apart than this (standard deviation) are no place to dock by."""
VARIANCE_M2 = 4.0
REACTION_S = 3.0
"""A bad position has to end in a safe state within so long. The monitor looks once a second."""
_LOOK_S = 1.0
REST_M_S = 0.15
"""Slower than this an aPad is at rest; a good GPS scatters by some centimetres a second."""


def key_of(check: str, apad: str = "") -> str:
    """The key of a check: its name without the aPad's, in small letters; `versions` for the aPad's own line."""
    name = check.removeprefix(apad).strip() if apad else check
    return name.lower().replace(" ", "-") if name else "versions"


def at_sea(finding: Finding, apad: str) -> Finding:
    """The doctor's finding as a mission sees it."""
    if finding.status is Status.WARN and key_of(finding.check, apad) in _RED_AT_SEA:
        return replace(finding, status=Status.FAIL)
    return finding


def red_keys(findings: Iterable[Finding], apads: Sequence[str]) -> dict[str, list[Finding]]:
    """The findings that are red, by key."""
    red: dict[str, list[Finding]] = {}
    for it in findings:
        if it.status is Status.FAIL:
            apad = next((name for name in apads if it.check == name or it.check.startswith(f"{name} ")), "")
            red.setdefault(key_of(it.check, apad), []).append(it)
    return red


@dataclass(frozen=True, slots=True)
class PositionSample:
    """A position of the aPad as it arrived: at `at_s` of this machine's monotonic clock, with its header's number."""

    at_s: float
    sequence: int
    north_m: float
    east_m: float
    status: int = 0
    north_variance_m2: float = 0.0
    east_variance_m2: float = 0.0


def check_delay(round_trips_s: Sequence[float], uri: str) -> Finding:
    """The network's delay, by the time that connections to the master take: one way there and back each."""
    median_s, worst_s = statistics.median(round_trips_s), max(round_trips_s)
    found = f"{uri}: {1000 * median_s:.0f} ms there and back, {1000 * worst_s:.0f} ms at worst of {len(round_trips_s)}"
    mend = "come nearer with the antenna, take another channel, or leave others off this Wi-Fi"
    if worst_s > TOO_SLOW_S:
        return fail("delay", found, mend)
    return warn("delay", found, mend) if worst_s > SLOW_S else ok("delay", found)


def check_loss(apad: str, samples: Sequence[PositionSample], seconds: float) -> Finding:
    """Checks the position's messages for losses and long pauses."""
    check = f"{apad} loss"
    if len(samples) < 2:
        return fail(check, f"{len(samples)} positions in {seconds:g} s", "see the line of the position")
    numbers = [it.sequence for it in samples]
    pause_s = max(b.at_s - a.at_s for a, b in itertools.pairwise(samples))
    counts = numbers[-1] > numbers[0]
    missing = max(0, numbers[-1] - numbers[0] + 1 - len(numbers)) if counts else 0
    told = f"{missing} of {missing + len(samples)} positions missing" if counts else "they are not numbered"
    found = f"{len(samples)} positions in {seconds:g} s, {told}, the longest pause {pause_s:.2f} s"
    mend = "come nearer with the antenna, or take another channel; a wired tether for the first trials"
    if pause_s > TOO_SLOW_S or missing > MISSING_SHARE * (missing + len(samples)):
        return fail(check, found, mend)
    return warn(check, found, mend) if missing or pause_s > 0.5 else ok(check, found)


def check_position(
    apad: str, samples: Sequence[PositionSample], seconds: float, jump_m: float, speed_m_s: float
) -> Finding:
    """The aPad's position comes often enough, is finite and does not jump. `speed_m_s` is the fastest that it goes."""
    check = f"{apad} position"
    if not samples:
        return fail(
            check, f"none within {seconds:g} s", "start what publishes it: GPS, filter, the vehicle's node"
        )
    bad = [it for it in samples if out_of_range(north_m=it.north_m, east_m=it.east_m) is not None]
    if bad:
        return fail(
            check,
            f"{len(bad)} of {len(samples)} are not finite or beyond every water",
            "start the vehicle's filter again, and see its origin",
        )
    if len(samples) < LEAST_HZ * seconds:
        return fail(
            check,
            f"{len(samples)} in {seconds:g} s: {LEAST_HZ:g} a second are needed",
            "raise the rate of what publishes it, or mend the network first",
        )
    for before, after in itertools.pairwise(samples):
        way_m = _way_m(before, after)
        if way_m > jump_m + speed_m_s * (after.at_s - before.at_s):
            return fail(
                check, f"it jumped by {way_m:.1f} m", "wait for a steady GPS, and see the vehicle's filter"
            )
    last = samples[-1]
    return ok(
        check,
        f"({last.north_m:.1f} m north, {last.east_m:.1f} m east), {len(samples) / seconds:.1f} a second",
    )


def check_gps(apad: str, samples: Sequence[PositionSample]) -> Finding:
    """The quality that NavSts tells (status, variances), and how the places of an aPad at rest scatter."""
    check = f"{apad} GPS"
    sound = [it for it in samples if out_of_range(north_m=it.north_m, east_m=it.east_m) is None]
    if len(sound) < 2:
        return fail(check, "there are not two positions to judge it by", "see the line of the position")
    last = sound[-1]
    scatter_m = math.hypot(
        statistics.pstdev(it.north_m for it in sound), statistics.pstdev(it.east_m for it in sound)
    )
    variances = (last.north_variance_m2, last.east_variance_m2)
    found = f"it scatters by {scatter_m:.2f} m"
    mend = "wait for more satellites, keep the antenna clear, or let it lie still and try again"
    if scatter_m > SCATTER_M:
        return fail(check, found, mend)
    if not last.status and not any(variances):
        return warn(
            check,
            f"{found}; the aPad tells neither status nor variance",
            "see its GPS receiver by hand: fix, satellites, HDOP",
        )
    found += f", variances {variances[0]:.2f} and {variances[1]:.2f} m2, status {last.status}"
    if (
        not last.status & POSITION_OK
        or max(variances) > VARIANCE_M2
        or not all(map(math.isfinite, variances))
    ):
        return fail(check, found, mend)
    return ok(check, found)


POSITION_OK = 3
"""auv_msgs/NavSts: the constants STATUS_LOCAL_FRAME_OK and STATUS_GLOBAL_FRAME_OK."""


def check_fence(
    apad: str,
    place_m: tuple[float, float] | None,
    fence: Fence | None,
    clearance_m: float,
    starts_m: Iterable[tuple[float, float]],
) -> list[Finding]:
    """The aPad lies inside the fence with its clearance; and so do the aMussels' starts, or they are never served."""
    check = f"{apad} fence"
    if fence is None:
        return [fail(check, "the scenario has none", "area.fence: the corners of your waters")]
    if place_m is None:
        return [fail(check, "without a position it cannot be checked", "see the line of the position")]
    import shapely

    waters = fence.waters()
    clear = waters.buffer(-clearance_m)
    place = shapely.Point(place_m)
    where = f"({place_m[0]:.1f} m north, {place_m[1]:.1f} m east)"
    if not waters.covers(place):
        return [
            fail(
                check,
                f"the aPad at {where} lies {waters.distance(place):.1f} m outside",
                "bring it inside by hand, or see area.fence and area.origin: is it the right water?",
            )
        ]
    edge_m = waters.boundary.distance(place)
    found = f"the aPad at {where} lies inside, {edge_m:.1f} m from its edge"
    findings = [ok(check, found)]
    if not clear.covers(place):
        mend = f"bring it farther in by hand: guards.clearance_m is {clearance_m:g} m"
        findings = [fail(check, found, mend)]
    outside = sum(not clear.covers(shapely.Point(it)) for it in starts_m)
    if outside:
        mend = "move them by fleet.start, or widen the fence: they are neither called up nor fetched"
        findings.append(
            warn(f"{apad} starts", f"{outside} aMussels lie outside the fence or too near to it", mend)
        )
    return findings


def check_reaction(guards: GuardOptions, apad: str) -> Finding:
    """The scenario's limits bring the aPad to a safe state within `REACTION_S` of a bad position."""
    limits = {"position_age_s": guards.position_age_s, "frozen_s": guards.frozen_s}
    late = {name: it for name, it in limits.items() if it + _LOOK_S > REACTION_S}
    if late:
        told = ", ".join(f"guards.{name} is {it:g} s" for name, it in late.items())
        mend = f"{REACTION_S - _LOOK_S:g} s each, where the GPS gives a fix more often than that"
        return warn(
            f"{apad} reaction", f"{told}: a bad position is noticed later than after {REACTION_S:g} s", mend
        )
    return ok(f"{apad} reaction", f"a bad position is noticed within {max(limits.values()) + _LOOK_S:g} s")


def check_pilot(apad: str, *, hears_pilot: bool, steers: bool | None) -> Finding:
    """Nobody steers the aPad. `hears_pilot`: its generation tells by `manual`; `steers`: the word there, None for none."""
    check = f"{apad} pilot"
    if steers:
        return fail(
            check, "a pilot steers (manual is true)", "let the pilot put the joystick down, then try again"
        )
    if not hears_pilot:
        return ok(check, "this generation does not tell of one: agree by voice who has the aPad")
    if steers is None:
        return warn(
            check,
            "no node publishes manual: the bench cannot notice a pilot who takes the aPad over",
            "start the joystick's node; or remap manual to what tells of your pilot",
        )
    return ok(check, "nobody steers (manual is false)")


def check_watchdog(apad: str, *, drifts: bool, word: str | None) -> Finding:
    """`word` is what the vehicle's watchdog said last, None for none. `drifts`: controllers go off between primitives."""
    check = f"{apad} watchdog"
    mend = "start launch_scripts/vehicle_watchdog on the vehicle's own computer: docs/apads.md"
    if word is not None:
        return ok(check, f"it runs, and says {word}")
    if drifts:
        return fail(check, "none: on a lost link this aPad drifts as soon as a primitive ends", mend)
    return warn(check, "none: on a lost link this aPad continues to its last goal", mend)


@dataclass(frozen=True, slots=True)
class EnergyNeed:
    """Parts of a full battery."""

    at_rest: float
    """For the mission's time without any motion."""
    under_way: float
    """For the mission's time at the mission's speed."""
    way_home: float
    reserve: float


def check_energy(apad: str, charge: float | None, need: EnergyNeed) -> Finding:
    """The charge against the least and the most that the mission can take."""
    check = f"{apad} energy"
    if charge is None:
        return fail(check, "its charge is not known", "see the line of the battery")
    least = need.at_rest + need.way_home + need.reserve
    most = need.under_way + need.way_home + need.reserve
    found = (
        f"{100 * charge:.0f} %; the mission takes {100 * least:.0f} to {100 * most:.0f} %, with {100 * need.reserve:.0f} % "
        f"kept and {100 * need.way_home:.1f} % for the way home"
    )
    if charge < least:
        return fail(check, found, "charge it, or lower duration_s")
    if charge < most:
        return warn(
            check, found, "it may have to end early: charge it, or lower duration_s or mission.speed_m_s"
        )
    return ok(check, found)


def check_lookout(name: str) -> Finding:
    if name:
        return ok("lookout", f"{name}, with the vehicle's own switch in the hand")
    return warn(
        "lookout",
        "no lookout is named: there is no collision avoidance, and no order of ours is an emergency stop",
        "--lookout NAME: who looks out and holds the vehicle's hardware switch",
    )


def check_stop(apad: str, failure: str | None, told: str = "") -> Finding:
    """The proof of a stop: `failure` is why it failed, None for one that went well with what it `told`."""
    check = f"{apad} stop"
    if failure is None:
        return ok(check, told)
    return fail(check, failure, "fly nothing before this is mended: prove it again on a tether")


def not_proven(apad: str, what: str, option: str) -> Finding:
    return warn(
        f"{apad} {what}",
        "not proven since this scenario's last preflight on this master",
        f"musselbed preflight ... {option}",
    )


def _way_m(before: PositionSample, after: PositionSample) -> float:
    return math.dist((before.north_m, before.east_m), (after.north_m, after.east_m))
