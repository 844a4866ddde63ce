"""Checks of the scenario's limits before an aPad moves: its fence, clearance, reserve, and the guards that act by them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.doctor.finding import Finding, cannot_tell, fail, ok, warn
from apad_bridge.scenario.area.fence import Fence
from apad_bridge.scenario.blocks.guard_options import LOOK_MS, GuardOptions


# The clearance that a vehicle needs to come to rest inside its waters, and the speed that a clearance allows.
@dataclass(frozen=True, slots=True)
class StoppingRoom:
    """The lengths, speeds and the time that make up the room of a stop: metres, metres a second, seconds."""

    position_error_m: float
    """The aPad lies within it of the place that it tells, in 95 % of all cases."""
    hull_m: float
    current_m_s: float
    reaction_s: float
    """From the cause of a stop to the vehicle's acceptance."""
    coasting_m: float
    """The way from the acceptance to rest at `coasting_speed_m_s`, not exceeded in 95 % of all stops."""
    coasting_speed_m_s: float

    def clearance_m(self, speed_m_s: float) -> float:
        """The least clearance at this speed:

            position error + hull / 2 + (speed + current) x reaction + coasting(speed)

        Coasting is measured at one speed. Above it the way is taken to grow with the square of the speed, as that of a
        hull does that thrusters of a constant force slow; drag alone makes it grow less. Below it the measured way
        counts: quadratic drag hardly shortens the way of a slower hull. So measure it at the speed of the mission.
        """
        ratio = max(1.0, speed_m_s / self.coasting_speed_m_s)
        return self._standing_m + speed_m_s * self.reaction_s + self.coasting_m * ratio**2

    def fastest_m_s(self, clearance_m: float) -> float:
        """The greatest speed that this clearance allows, the inverse of `clearance_m`; 0 where none does."""
        left_m = clearance_m - self._standing_m
        slow_m_s = (left_m - self.coasting_m) / self.reaction_s
        if slow_m_s <= self.coasting_speed_m_s or not self.coasting_m:
            return max(0.0, slow_m_s)
        square = self.coasting_m / self.coasting_speed_m_s**2
        # The positive root of square x v^2 + reaction x v = left, in the form that does not cancel.
        return 2 * left_m / (self.reaction_s + math.sqrt(self.reaction_s**2 + 4 * square * left_m))

    @property
    def _standing_m(self) -> float:
        return self.position_error_m + self.hull_m / 2 + self.current_m_s * self.reaction_s


def stopping_room(guards: GuardOptions, known_m_s: float = 0.0) -> StoppingRoom | list[str]:
    """The room by the scenario's guards; or the keys that are missing for it.

    `known_m_s` is the fastest drift in the scenario's own current and wind, which counts where it is above `drift_m_s`.
    """
    numbers = {
        "position_error_m": guards.position_error_m,
        "hull_m": guards.hull_m,
        "coasting_m": guards.coasting_m,
        "coasting_speed_m_s": guards.coasting_speed_m_s,
    }
    given = {name: value for name, value in numbers.items() if value is not None}
    if len(given) < len(numbers):
        return [f"guards.{name}" for name in numbers if name not in given]
    return StoppingRoom(current_m_s=max(guards.drift_m_s, known_m_s), reaction_s=guards.reaction_s, **given)


MOST_JUMP_M = 20.0
LEAST_RESERVE = 0.1
LEAST_REACTION_S = 1.0
"""The bench acts once a second, so a stop takes a second to go out."""
MOST_LEG_WAYS = 10
"""A leg may last so many times as long as the longest way takes at the mission's speed."""
REACTION_S = 3.0
"""A bad position has to end in a safe state within so long. The guards look at it five times a second."""
_LOOK_S = LOOK_MS / 1000
_TOO_LATE_S = 10.0


def check_fence(
    place_m: tuple[float, float] | None,
    fence: Fence | None,
    clearance_m: float,
) -> Finding:
    """The aPad lies inside the fence with its clearance."""
    if fence is None:
        return fail("the scenario has none", "area.fence: the corners of your waters")
    if place_m is None:
        return fail("without a position it cannot be checked", "see the line of the position")
    import shapely

    waters, place = fence.waters(), shapely.Point(place_m)
    where = f"({place_m[0]:.1f} m north, {place_m[1]:.1f} m east)"
    if not waters.covers(place):
        return fail(
            f"the aPad at {where} lies {waters.distance(place):.1f} m outside",
            "bring it inside by hand, or see area.fence and area.origin: is it the right water?",
        )
    found = f"the aPad at {where} lies inside, {waters.boundary.distance(place):.1f} m from its edge"
    if not waters.buffer(-clearance_m).covers(place):
        return fail(found, f"bring it farther in by hand: guards.clearance_m is {clearance_m:g} m")
    return ok(found)


def check_reaction(guards: GuardOptions) -> Finding:
    """The scenario's limits bring the aPad to a safe state within `REACTION_S` of a bad position."""
    if guards.jump_m > MOST_JUMP_M:
        return fail(
            f"guards.jump_m is {guards.jump_m:g} m: a position that jumps by less is believed",
            f"{MOST_JUMP_M:g} m at most: twice what a GPS without correction errs",
        )
    limits = {"position_age_s": guards.position_age_s, "frozen_s": guards.frozen_s}
    if late := {name: it for name, it in limits.items() if it + _LOOK_S > REACTION_S}:
        told = ", ".join(f"guards.{name} is {it:g} s" for name, it in late.items())
        mend = f"{REACTION_S - _LOOK_S:g} s each, where the GPS gives a fix more often than that"
        found = f"{told}: a bad position is noticed later than after {REACTION_S:g} s"
        return (fail if max(late.values()) > _TOO_LATE_S else warn)(found, mend)
    return ok(f"a bad position is noticed within {max(limits.values()) + _LOOK_S:g} s")


def check_reserve(guards: GuardOptions) -> Finding:
    """The charge that must remain at the end of the way home."""
    reserve = guards.battery_reserve or 0.0
    found = f"guards.battery_reserve is {reserve:g}"
    if reserve < LEAST_RESERVE:
        mend = f"{LEAST_RESERVE:g} or more: a current against the way home, and a gauge that errs, take it"
        return fail(found, mend)
    return ok(found)


def check_limits(
    guards: GuardOptions,
    *,
    greatest_m_s: float,
    deceleration_m_s2: float,
    longest_m: float,
    speed_m_s: float,
) -> list[Finding]:
    """The limits can act, and say nothing that no vehicle does.

    The aPad's greatest speed and deceleration are the scenario's, as are the longest way inside the fence and the
    mission's speed.
    """
    found = []
    if guards.reaction_s < LEAST_REACTION_S:
        told = f"guards.reaction_s is {guards.reaction_s:g} s: the bench orders once a second"
        found.append(fail(told, f"{LEAST_REACTION_S:g} or more; 3 as in real-apad.yaml"))
    if guards.coasting_m is not None and guards.coasting_speed_m_s is not None:
        least_m = guards.coasting_speed_m_s**2 / (2 * deceleration_m_s2)
        if guards.coasting_m < least_m:
            told = (
                f"guards.coasting_m is {guards.coasting_m:g} m: from {guards.coasting_speed_m_s:g} m/s even "
                f"apad.max_acceleration_m_s2 takes {least_m:.2f} m"
            )
            mend = "measure it on a tether: docs/guards.md#clearance"
            found.append(fail(told, mend))
    if guards.speed_limit_m_s is not None and guards.speed_limit_m_s > greatest_m_s:
        told = (
            f"guards.speed_limit_m_s is {guards.speed_limit_m_s:g} m/s, and the aPad makes {greatest_m_s:g} "
            "(apad.max_speed_m_s): the guard would never act"
        )
        found.append(fail(told, f"{greatest_m_s:g} at most; or measure apad.max_speed_m_s"))
    way_m = min(longest_m, guards.leg_m or math.inf)
    most_s = MOST_LEG_WAYS * way_m / speed_m_s
    if guards.leg_s is not None and guards.leg_s > most_s:
        told = (
            f"guards.leg_s is {guards.leg_s:g} s: the longest way, {way_m:.0f} m, takes {way_m / speed_m_s:.0f} s "
            f"at {speed_m_s:g} m/s"
        )
        found.append(fail(told, f"{math.floor(most_s)} at most, {MOST_LEG_WAYS} times that"))
    return found or [ok("each can act: reaction, coasting, speed and leg")]


def check_clearance(
    guards: GuardOptions, speed_m_s: float, what: str, known_drift_m_s: float = 0.0
) -> Finding:
    """The fence's clearance holds the room of a stop (`StoppingRoom`) at this speed, which `what` names."""
    room = stopping_room(guards, known_drift_m_s)
    if isinstance(room, list):
        return cannot_tell(
            f"{', '.join(room)} not given: the room of a stop is not known",
            "measure them (docs/guards.md#clearance), or take those of launch_scripts/scenarios/real-apad.yaml",
        )
    needed_m, fastest_m_s = room.clearance_m(speed_m_s), room.fastest_m_s(guards.clearance_m)
    fits = f"at most {fastest_m_s:.2f} m/s fit" if fastest_m_s else "no speed fits"
    found = (
        f"a stop at {speed_m_s:g} m/s ({what}) needs {needed_m:.1f} m; guards.clearance_m is "
        f"{guards.clearance_m:g} m: {fits}"
    )
    if needed_m <= guards.clearance_m:
        return ok(found)
    slower = f", or lower {what} to {math.floor(100 * fastest_m_s) / 100:g}" if fastest_m_s else ""
    return fail(found, f"raise guards.clearance_m to {math.ceil(10 * needed_m) / 10:g}{slower}")
