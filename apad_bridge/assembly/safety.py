"""Builds the guards and the monitor of a flight's vehicle from its scenario.

A guard whose limit the scenario leaves out is absent. Without a block `guards` and without a fence, only numbers are
guarded, and that the position is known; nothing is watched between orders. By the same waters it names the aMussels that
cannot be served from where they start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from apad_bridge.assembly.stacks import adrift_ms, stacks
from apad_bridge.events.guard_events import Reaction
from apad_bridge.scenario.area.fence import fence_of
from apad_bridge.scenario.blocks.guard_options import GuardOptions, WhenOutside, WhenUnwatched
from apad_bridge.scenario.blocks.mission_options import DockingProfile
from apad_bridge.scenario.hull_in_flow import (
    LegForecast,
    fastest_drift_m_s,
    free_drift_m_s,
    surface_of,
)
from apad_bridge.scenario.schema import APad, Scenario
from apad_bridge.scenario.starts_table import Start
from apad_bridge.vehicle.guards.frozen_position import NEVER_MS
from apad_bridge.vehicle.guards.gate import Gate, Safety, plain_safety
from apad_bridge.vehicle.guards.guarded_orders import Point
from apad_bridge.vehicle.guards.guards import (
    BatteryForHome,
    ClearOfBodies,
    Guard,
    InWaters,
    LegLimits,
    RoomToDock,
    unlimited_guards,
)
from apad_bridge.vehicle.guards.monitor import (
    DEFAULT_STOPPING,
    CanStopInWaters,
    EndsInTime,
    IsInWaters,
    IsWatched,
    KeepsClearOfAPads,
    MakesProgress,
    Monitor,
    MonitorCheck,
    PositionIsGood,
    SpeedIsAllowed,
    Stopping,
)
from apad_bridge.vehicle.guards.position_watch import SETTLED_MS, PositionLimits, PositionWatch
from apad_bridge.vehicle.guards.watchdog_watch import WatchdogWatch
from apad_bridge.vehicle.guards.waters import OpenWaters, Waters
from apad_bridge.world.apad.thrusters import allocate, electrical_w

_S_PER_HOUR = 3600
CLOCK_STEP_MS = 1_000
"""Stamps of a real vehicle that jump ahead by more belong to a clock that was set."""


def safety_of(scenario: Scenario, *, needs_person: bool = False) -> Safety:
    """Builds the parts that keep the scenario's aPad safe. One that `needs_person` waits for one after it was stopped."""
    if scenario.guards is None and scenario.area.fence is None:
        return plain_safety()
    options = scenario.guards or GuardOptions()
    waters = _waters(scenario, options)
    watch = PositionWatch(
        PositionLimits(
            age_ms=round(options.position_age_s * 1000),
            jump_m=options.jump_m,
            speed_m_s=2 * scenario.apad.max_speed_m_s,
            frozen_ms=round(options.frozen_s * 1000),
            clock_step_ms=CLOCK_STEP_MS if needs_person else NEVER_MS,
            settled_ms=None if needs_person else SETTLED_MS,
            error_m=options.position_error_m or math.inf,
        )
    )
    return Safety(
        Gate(
            _guards(scenario, options, waters),
            watch,
            waters,
            WatchdogWatch(is_demanded=needs_person and options.watchdog is not None),
        ),
        Monitor(_checks(scenario, options, waters)),
        waters,
        scenario.mission.speed_m_s,
        needs_person=needs_person,
        drift_m_s=_drift_of(scenario),
        stopping=_coasting(options),
    )


def unreachable_starts(
    scenario: Scenario, starts: Sequence[Start], apads_m: Sequence[tuple[float, float]] = ()
) -> list[tuple[str, str]]:
    """The fence and the zones between the aPad and aMussels at the start, round which it does not go, with a mend each.

    `apads_m` are the aPads' places; by default those of the scenario.
    """
    waters, found = _waters(scenario, scenario.guards or GuardOptions()), []
    apads_m = apads_m or [scenario.apad.start_m, *(it.start_m for it in scenario.apads)]
    for it in starts:
        place_m = it.north_m, it.east_m
        if fault := waters.fault_of_place(place_m):
            found.append((f"aMussel {it.agent_id} cannot be served: {fault}", "move it, or the fence"))
        elif all(faults := [waters.fault_of_way(from_m, place_m) for from_m in apads_m]):
            mend = "move one of them, or serve it by a script with places on the way"
            found.append(
                (f"aMussel {it.agent_id} is out of the aPad's reach from its start: {faults[0]}", mend)
            )
    return found


def _coasting(options: GuardOptions) -> Stopping:
    """The way to rest without thrust, where the scenario gives it."""
    if options.coasting_m is None:
        return DEFAULT_STOPPING
    return Stopping(0.0, options.coasting_m, options.coasting_speed_m_s or 1.0)


def _drift_of(scenario: Scenario) -> Callable[[Point, int], Point]:
    apad, surface = scenario.apad, surface_of(scenario)
    if surface is None:
        return lambda place_m, now_ms: apad.drift_m_s
    return lambda place_m, now_ms: free_drift_m_s(apad, surface.flow(place_m, now_ms))


def _waters(scenario: Scenario, options: GuardOptions) -> Waters:
    """Only a scenario with a fence imports shapely."""
    if (fence := fence_of(scenario.area)) is None:
        return OpenWaters()
    from apad_bridge.vehicle.guards.fenced_waters import FencedWaters

    return FencedWaters(fence, options.clearance_m)


def _guards(scenario: Scenario, options: GuardOptions, waters: Waters) -> list[Guard]:
    docking, area = scenario.mission.docking, scenario.area
    adrift_s = adrift_ms() / 1000 if options.adrift_s is None else options.adrift_s
    # Room for a docking is asked for before it is known which stack flies it.
    pulled_back_m = max(it.pulls_back_m for it in stacks())
    guards: list[Guard] = [
        *unlimited_guards(),
        InWaters(waters, returns=options.outside is WhenOutside.RETURN),
        RoomToDock(
            waters,
            max(options.drift_m_s, fastest_drift_m_s(scenario)) * adrift_s + options.search_m + pulled_back_m,
            lambda agent_id: docking.profile_of(agent_id) is not DockingProfile.VIRTUAL,
        ),
        LegLimits(options.leg_m or math.inf, options.speed_limit_m_s or math.inf, options.leg_s or math.inf),
        ClearOfBodies(options.bodies_m),
    ]
    if options.battery_reserve is not None:
        home_m = scenario.apad.start_m if area.home_m is None else area.home_m
        guards.append(BatteryForHome(home_m, options.battery_reserve, LegEnergy.of(scenario).fraction))
    return guards


def _checks(scenario: Scenario, options: GuardOptions, waters: Waters) -> list[MonitorCheck]:
    stopping = Stopping(
        scenario.apad.max_acceleration_m_s2, options.coasting_m, options.coasting_speed_m_s or 1.0
    )
    most_m_s = options.speed_limit_m_s or math.inf
    outside = Reaction.RETURN if options.outside is WhenOutside.RETURN else Reaction.HOLD
    checks: list[MonitorCheck] = [
        PositionIsGood(),
        IsInWaters(waters, outside),
        CanStopInWaters(waters, stopping, most_m_s),
        EndsInTime(options.leg_s or math.inf),
        MakesProgress(),
        KeepsClearOfAPads(options.bodies_m, stopping, most_m_s),
    ]
    if options.speed_limit_m_s is not None:
        checks.append(SpeedIsAllowed(options.speed_limit_m_s))
    if options.watchdog is WhenUnwatched.HOLD:
        checks.append(IsWatched())
    return checks


@dataclass(frozen=True, slots=True)
class LegEnergy:
    """Forecasts the part of a full battery that a leg takes at the mission's speed: the hull's drag, and all that is on."""

    apad: APad
    speed_m_s: float
    legs: LegForecast

    @classmethod
    def of(cls, scenario: Scenario) -> LegEnergy:
        return cls(
            scenario.apad, scenario.mission.speed_m_s, LegForecast(scenario.apad, surface_of(scenario))
        )

    def fraction(self, from_m: Point, to_m: Point, at_ms: int) -> float:
        """The part that a straight leg takes, in the known sea of this time."""
        sea = self.legs.at(at_ms, self.speed_m_s)
        metres = math.dist(from_m, to_m) if sea is None else sea.metres(from_m, to_m)
        seconds = metres / self.speed_m_s if sea is None else sea.seconds(from_m, to_m)
        forces, _ = allocate(
            self.apad.drag_n_per_m2_s2 * self.speed_m_s**2, 0.0, 0.0, self.apad.thruster_max_n
        )
        thrust_w = electrical_w(forces, self.apad.thruster_w_per_n)
        watt_seconds = thrust_w * metres / self.speed_m_s + self.apad.battery.hotel_w * seconds
        return watt_seconds / _S_PER_HOUR / self.apad.battery.capacity_wh
