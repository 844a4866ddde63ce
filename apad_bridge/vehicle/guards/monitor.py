"""Watches a vehicle between orders, once a tick, and says how to react to each cause that begins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from apad_bridge.events.guard_events import Cause, Reaction
from apad_bridge.vehicle.commands import GoTo
from apad_bridge.vehicle.guards.guarded_orders import Point, VehicleSituation
from apad_bridge.vehicle.guards.waters import Waters

PROGRESS_M = 0.5
"""A go-to that gets nearer by so much makes progress."""
DELAY_S = 1.0
"""An order takes a tick to act."""
LEAST_WAIT_S = 10.0
EXPECTED_WAITS = 5
"""No progress is told after so many times the time that `PROGRESS_M` should take, and never before `LEAST_WAIT_S`."""


@dataclass(frozen=True, slots=True)
class UnderWay:
    """A go-to that the vehicle has not ended, and the time at which it accepted it; None before."""

    command: GoTo
    since_ms: int | None = None
    nearest_m: float = math.inf
    """The distance to the goal at the last progress."""
    progress_ms: int | None = None
    """The time of the last progress."""

    def moved_to(self, place_m: Point, now_ms: int) -> UnderWay:
        """The same go-to, with the vehicle at this place."""
        away_m = math.dist(place_m, (self.command.north_m, self.command.east_m))
        if self.since_ms is None or away_m > self.nearest_m - PROGRESS_M:
            return self
        return replace(self, nearest_m=away_m, progress_ms=now_ms)


@dataclass(frozen=True, slots=True)
class MonitorFinding:
    cause: Cause
    reaction: Reaction
    reason: str


class MonitorCheck(Protocol):
    """One cause. A check keeps nothing: whatever lasts is in the situation or in `under_way`."""

    @property
    def cause(self) -> Cause: ...

    @property
    def reaction(self) -> Reaction:
        return Reaction.HOLD

    @property
    def is_accepted(self) -> bool:
        """A person who continues accepts the cause for as long as it lasts."""
        return False

    def look(self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int) -> str:
        """The reason to react; empty for none."""


@dataclass(frozen=True, slots=True)
class PositionIsGood(MonitorCheck):
    cause: Cause = Cause.POSITION
    reaction: Reaction = Reaction.STOP

    def look(self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int) -> str:
        return "" if situation.place_m is None else situation.position_fault


@dataclass(frozen=True, slots=True)
class IsInWaters(MonitorCheck):
    """Outside the waters the vehicle holds and a pilot is called or, if the scenario says so, it goes back inside."""

    waters: Waters
    reaction: Reaction
    cause: Cause = Cause.OUTSIDE

    def look(self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int) -> str:
        fault = "" if situation.place_m is None else self.waters.fault_of_place(situation.place_m)
        return fault and f"the aPad at {fault}"


@dataclass(frozen=True, slots=True)
class Stopping:
    """A vehicle's way to rest: as measured without thrust, and else by the greatest deceleration of its thrusters."""

    deceleration_m_s2: float
    coasting_m: float | None = None
    """The way from `coasting_speed_m_s` to rest."""
    coasting_speed_m_s: float = 1.0

    def way_m(self, speed_m_s: float) -> float:
        """Coasting grows with the speed, and above the speed of the measurement with its square."""
        if self.coasting_m is None:
            return speed_m_s**2 / (2 * self.deceleration_m_s2)
        ratio = speed_m_s / self.coasting_speed_m_s
        return self.coasting_m * max(ratio, ratio**2)


DEFAULT_STOPPING = Stopping(0.0, 4.2, 0.6)
"""For a vehicle whose coasting the scenario does not give: that of the simulated aPad of generation B, which is long."""


@dataclass(frozen=True, slots=True)
class CanStopInWaters(MonitorCheck):
    """The vehicle comes to rest inside the waters if it is told to stop now."""

    waters: Waters
    stopping: Stopping
    most_m_s: float = math.inf
    """The greatest allowed speed, which the noise of positions alone does not exceed (`_believed_m_s`)."""
    cause: Cause = Cause.AHEAD

    def look(self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int) -> str:
        place_m, speed_m_s = situation.place_m, _believed_m_s(situation, self.most_m_s)
        if place_m is None or speed_m_s == 0.0 or self.waters.fault_of_place(place_m):
            return ""
        there_m = _place_at_rest(place_m, situation, self.stopping, speed_m_s)
        fault = self.waters.fault_of_place(there_m)
        return fault and f"at {speed_m_s:.1f} m/s the aPad comes to rest where it may not be: {fault}"


@dataclass(frozen=True, slots=True)
class KeepsClearOfAPads(MonitorCheck):
    """The vehicle does not come nearer to another aPad than `least_m` if it is told to stop now. Both look."""

    least_m: float
    stopping: Stopping
    most_m_s: float = math.inf
    """The greatest allowed speed, as for the fence ahead."""
    cause: Cause = Cause.ANOTHER_APAD

    def look(self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int) -> str:
        speed_m_s = _believed_m_s(situation, self.most_m_s)
        if situation.place_m is None or speed_m_s == 0.0:
            return ""
        there_m = _place_at_rest(situation.place_m, situation, self.stopping, speed_m_s)
        for body in situation.bodies:
            near_m = math.dist(there_m, body.place_m)
            if body.agent_id is None and near_m < min(
                self.least_m, math.dist(situation.place_m, body.place_m)
            ):
                return (
                    f"the aPad comes to rest {near_m:.1f} m from {body.name}, the least is {self.least_m:g} m"
                )
        return ""


def _believed_m_s(situation: VehicleSituation, most_m_s: float) -> float:
    """The measured speed up to the allowed one, for which the clearance has room; more only as far as it is sure.

    At 0.5 m/s, positions with a noise of 0.5 m measure up to 1.5 m/s.
    """
    return min(situation.speed_m_s, max(most_m_s, situation.least_speed_m_s))


def _place_at_rest(
    place_m: Point, situation: VehicleSituation, stopping: Stopping, speed_m_s: float
) -> Point:
    """The place at which a vehicle of this speed comes to rest if it is told to stop now."""
    way_m = speed_m_s * DELAY_S + stopping.way_m(speed_m_s)
    north, east = (it / situation.speed_m_s for it in situation.velocity_m_s)
    return place_m[0] + north * way_m, place_m[1] + east * way_m


@dataclass(frozen=True, slots=True)
class SpeedIsAllowed(MonitorCheck):
    """The measured speed, less its error: a vehicle of generation A obeys no ordered one."""

    most_m_s: float
    cause: Cause = Cause.SPEED

    def look(self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int) -> str:
        if situation.least_speed_m_s <= self.most_m_s:
            return ""
        made = f"{situation.speed_m_s:.2f} m/s, {situation.least_speed_m_s:.2f} at least"
        return f"the aPad makes {made}; the greatest is {self.most_m_s:g} m/s"


@dataclass(frozen=True, slots=True)
class EndsInTime(MonitorCheck):
    """A go-to that lasts longer than a leg may, from the vehicle's acceptance on."""

    duration_s: float = math.inf
    cause: Cause = Cause.LATE

    def look(self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int) -> str:
        since_ms = None if under_way is None else under_way.since_ms
        if since_ms is None or now_ms - since_ms <= self.duration_s * 1000:
            return ""
        return f"the go-to did not end within {self.duration_s:g} s"


@dataclass(frozen=True, slots=True)
class MakesProgress(MonitorCheck):
    """A go-to that gets no nearer, under a good position: a tether, weed, a current. The vehicle holds, and a person looks.

    Within two victory radii of its goal a vehicle may turn and settle.
    """

    cause: Cause = Cause.NO_PROGRESS

    def look(self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int) -> str:
        if under_way is None or under_way.progress_ms is None or situation.place_m is None:
            return ""
        order = under_way.command
        away_m = math.dist(situation.place_m, (order.north_m, order.east_m))
        wait_s = max(LEAST_WAIT_S, EXPECTED_WAITS * PROGRESS_M / order.speed_m_s)
        if away_m <= 2 * order.victory_radius_m or now_ms - under_way.progress_ms < wait_s * 1000:
            return ""
        return (
            f"the aPad came no {PROGRESS_M:g} m nearer to its goal within {wait_s:g} s, {away_m:.1f} m to go"
        )


@dataclass(frozen=True, slots=True)
class IsWatched(MonitorCheck):
    """The vehicle's own watchdog watches. Without it an aPad on its way goes on when the link or the bench dies."""

    cause: Cause = Cause.WATCHDOG
    is_accepted: bool = True

    def look(self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int) -> str:
        return situation.watchdog_fault


class Monitor:
    """Looks at every tick. A bad position hides all other causes."""

    def __init__(self, checks: Sequence[MonitorCheck]) -> None:
        self.checks = tuple(checks)
        self._present: set[Cause] = set()
        self._due_again: set[Cause] = set()
        """The present causes to which nobody has reacted since a person let the vehicle move again."""

    def begin_anew(self) -> None:
        """A person lets the vehicle move again: a cause that lasts begins anew, unless the person accepts it."""
        self._due_again = self._present - {it.cause for it in self.checks if it.is_accepted}

    def look(
        self, situation: VehicleSituation, under_way: UnderWay | None, now_ms: int
    ) -> list[MonitorFinding | Cause]:
        """The findings that begin, and the causes that are over."""
        changes: list[MonitorFinding | Cause] = []
        for check in self.checks:
            if situation.position_fault and check.cause is not Cause.POSITION:
                continue  # what is wrong with the vehicle's place cannot be judged
            reason = check.look(situation, under_way, now_ms)
            if bool(reason) is (check.cause in self._present) and not (
                reason and check.cause in self._due_again
            ):
                continue
            self._due_again.discard(check.cause)
            (self._present.add if reason else self._present.discard)(check.cause)
            changes.append(MonitorFinding(check.cause, check.reaction, reason) if reason else check.cause)
        return changes
