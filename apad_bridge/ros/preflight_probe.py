"""Measures a real aPad and the way to it before a mission, and has the findings made of that (`doctor/preflight.py`).

Nothing is ordered here, and no node of ours is on the graph: the aPad's publishers are asked past the master.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version

from apad_bridge.assembly.safety import LegEnergy
from apad_bridge.assembly.stacks import STACKS
from apad_bridge.doctor.finding import Check, Finding, fail, ok
from apad_bridge.doctor.graph import Graph
from apad_bridge.doctor.network import Unreachable, call_for_reply, connect
from apad_bridge.doctor.positions import (
    PositionSample,
    check_gps,
    check_lag,
    check_loss,
    check_position,
)
from apad_bridge.doctor.preflight import (
    MOST_JUMP_M,
    EnergyNeed,
    WatchdogSeen,
    check_bench,
    check_clearance,
    check_delay,
    check_energy,
    check_fence,
    check_generation,
    check_limits,
    check_off,
    check_pilot,
    check_reaction,
    check_reserve,
    check_watchdog,
)
from apad_bridge.ros.doctor_apad_checks import check_held, named_like
from apad_bridge.ros.types.wire_probe import NotAnnounced, service_md5
from apad_bridge.ros.vehicle_probe import charge, clock_offset_s, heard_bool, heard_text, positions
from apad_bridge.ros_names.names import CLOCK, USE_SIM_TIME, in_full, of_apad, ours
from apad_bridge.ros_names.namespaces import below_apad, is_one_of_several
from apad_bridge.scenario.area.fence import fence_of
from apad_bridge.scenario.guard_options import GuardOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start
from apad_bridge.scenario.surface import fastest_drift_m_s, hardest_metre
from apad_bridge.vehicle.stack import Stack

WATCHED_S = 3.0
ROUND_TRIPS = 20
_S_PER_HOUR = 3600


def check_way(graph: Graph) -> Iterator[Finding]:
    """The delay to the master's machine."""
    try:
        yield check_delay([_round_trip_s(graph.uri) for _ in range(ROUND_TRIPS)], graph.uri)
    except Unreachable as error:
        yield fail("delay", str(error), "see the line of the master")


def check_parameters(graph: Graph, apad: str) -> Finding:
    """The parameters by which other places or times would be meant."""
    found = []
    for name in (USE_SIM_TIME, *(f"{apad}/LocalOrigin{it}" for it in ("Lat", "Lon"))):
        code, _, value = call_for_reply(graph.uri, "getParam", name)
        found.append(f"{name} {value if code == 1 else 'not set'}")
        if name == USE_SIM_TIME and code == 1 and value:
            mend = "rosparam set /use_sim_time false, and start the nodes again; for a simulated aPad: --time ros"
            return fail(f"{apad} parameters", f"{name} is true: no real vehicle follows a {CLOCK}", mend)
    return ok(f"{apad} parameters", ", ".join(found))


@dataclass
class WatchedAPad:
    """The scenario's aPad on the graph, which is seen by the run's names; measured once, when a check first asks."""

    graph: Graph
    scenario: Scenario
    starts: Sequence[Start]
    namespace: str = ""

    @property
    def name(self) -> str:
        return in_full(self.namespace, self.scenario.apad.name)

    @property
    def guards(self) -> GuardOptions:
        return self.scenario.guards or GuardOptions()

    @cached_property
    def stacks(self) -> list[Stack]:
        """Each stack whose software the graph has under this name."""
        return [it for it in STACKS if self.name in named_like(self.graph, it)]

    @cached_property
    def samples(self) -> list[PositionSample]:
        """Its positions of `WATCHED_S`."""
        return positions(self.graph, self.topic("position"), WATCHED_S)

    @property
    def place_m(self) -> tuple[float, float] | None:
        finite = [it for it in self.samples if math.isfinite(it.north_m) and math.isfinite(it.east_m)]
        return (finite[-1].north_m, finite[-1].east_m) if finite else None

    @property
    def heartbeat(self) -> str:
        """The topic of the heartbeat that a run sends to this vehicle's watchdog."""
        leaf = ours("heartbeat")
        if is_one_of_several(self.scenario):
            leaf = below_apad(leaf, self.scenario.apad.name)
        return in_full(self.namespace, leaf)

    def topic(self, leaf: str) -> str:
        return of_apad(self.name, leaf)


def _check_generation(apad: WatchedAPad) -> Finding:
    return check_generation(apad.name, apad.scenario.apad.generation, [it.generation for it in apad.stacks])


def _check_off(apad: WatchedAPad) -> Iterator[Finding]:
    for stack in apad.stacks:
        missing = []
        for leaf in stack.off_services:
            try:
                service_md5(apad.graph, f"{apad.name}/{leaf}")
            except NotAnnounced:
                missing.append(leaf)
        yield check_off(apad.name, missing, stack.off_services, hardware_cut=apad.guards.hardware_cut)


def _check_docks_held(apad: WatchedAPad) -> Iterator[Finding]:
    if any(it.capabilities(1).reports_contact for it in apad.stacks):
        yield check_held(apad.graph, apad.name, apad.namespace)


def _check_position(apad: WatchedAPad) -> Finding:
    return check_position(
        apad.name,
        apad.samples,
        WATCHED_S,
        min(apad.guards.jump_m, MOST_JUMP_M),
        2 * apad.scenario.apad.max_speed_m_s,
        apad.graph.living_publishers(apad.topic("position")),
    )


def _check_fence(apad: WatchedAPad) -> list[Finding]:
    starts_m = [(it.north_m, it.east_m) for it in apad.starts]
    return check_fence(
        apad.name, apad.place_m, fence_of(apad.scenario.area), apad.guards.clearance_m, starts_m
    )


def _check_clearance(apad: WatchedAPad) -> Finding:
    """A vehicle that does not obey a go-to's speed goes as fast as its guard lets it."""
    guards, drift_m_s = apad.guards, fastest_drift_m_s(apad.scenario)
    if all(it.capabilities(1).obeys_speed for it in apad.stacks):
        speed_m_s = apad.scenario.mission.speed_m_s
        return check_clearance(guards, apad.name, speed_m_s, "mission.speed_m_s", drift_m_s)
    if guards.speed_limit_m_s is None:
        return fail(
            f"{apad.name} clearance",
            "this generation goes at a speed of its own, and no guard bounds it",
            "set guards.speed_limit_m_s, with the clearance that it needs",
        )
    return check_clearance(guards, apad.name, guards.speed_limit_m_s, "guards.speed_limit_m_s", drift_m_s)


def _check_limits(apad: WatchedAPad) -> list[Finding]:
    fence = fence_of(apad.scenario.area)
    return check_limits(
        apad.guards,
        apad.name,
        greatest_m_s=apad.scenario.apad.max_speed_m_s,
        deceleration_m_s2=apad.scenario.apad.max_acceleration_m_s2,
        longest_m=math.inf if fence is None else fence.longest_m,
        speed_m_s=apad.scenario.mission.speed_m_s,
    )


def _check_pilot(apad: WatchedAPad) -> Finding:
    manual = heard_bool(apad.graph, apad.topic("manual"))
    return check_pilot(apad.name, hears_pilot=any(it.hears_pilot for it in apad.stacks), manual=manual)


def _check_bench(apad: WatchedAPad) -> Finding:
    return check_bench(apad.name, apad.heartbeat, apad.graph.living_publishers(apad.heartbeat))


def _check_watchdog(apad: WatchedAPad) -> Finding:
    graph, topic = apad.graph, apad.topic("watchdog")
    seen = WatchdogSeen(
        heard_text(graph, topic),
        heard_text(graph, apad.topic("watchdog_settings")),
        graph.living_publishers(topic),
    )
    return check_watchdog(
        apad.name,
        seen,
        graph.name_there(apad.heartbeat),
        drifts=any(it.drifts_between_orders for it in apad.stacks),
        is_demanded=apad.guards.watchdog is not None,
    )


def _check_energy(apad: WatchedAPad) -> Finding:
    need = energy_need(apad.scenario, apad.place_m)
    return check_energy(apad.name, charge(apad.graph, apad.name), need)


def _tell_software(apad: WatchedAPad) -> Finding:
    here = ", ".join(f"{it} {version(it)}" for it in ("musselbed", "rospy"))
    generations = ", ".join(it.generation for it in apad.stacks) or "unknown"
    return ok(f"{apad.name} software", f"generation {generations}; here {here}")


def energy_need(scenario: Scenario, place_m: tuple[float, float] | None) -> EnergyNeed:
    """Share of the battery that the mission's time can take, by the scenario's model of the aPad."""
    apad, speed_m_s, energy = scenario.apad, scenario.mission.speed_m_s, LegEnergy.of(scenario)
    home_m = apad.start_m if scenario.area.home_m is None else scenario.area.home_m
    place, ahead, at_ms = hardest_metre(scenario)
    reserve = scenario.guards.battery_reserve if scenario.guards is not None else None
    return EnergyNeed(
        at_rest=apad.battery.hotel_w * scenario.duration_s / _S_PER_HOUR / apad.battery.capacity_wh,
        under_way=energy.fraction(place, ahead, at_ms) * speed_m_s * scenario.duration_s,
        way_home=0.0 if place_m is None else energy.fraction(place_m, home_m, at_ms),
        reserve=max(reserve or 0.0, scenario.mission.end_at_apad_fraction),
    )


def _round_trip_s(uri: str) -> float:
    begun_s = time.monotonic()
    connect(uri).close()
    return time.monotonic() - begun_s


CHECKS_OF_WAY: tuple[Check[Graph], ...] = (Check("delay", check_way, may_be_red_in_trial=True),)
CHECKS: tuple[Check[WatchedAPad], ...] = (
    Check("generation", _check_generation),
    Check("off", _check_off),
    Check("docks held", _check_docks_held, may_be_red_in_trial=True),
    Check("position", _check_position, is_never_overridden=True),
    Check(
        "GPS", lambda it: check_gps(it.name, it.samples, it.guards.position_error_m), may_be_red_in_trial=True
    ),
    Check("loss", lambda it: check_loss(it.name, it.samples, WATCHED_S), may_be_red_in_trial=True),
    Check(
        "lag",
        lambda it: check_lag(it.name, it.samples, clock_offset_s(it.graph, it.name)),
        may_be_red_in_trial=True,
    ),
    Check("fence", _check_fence, is_never_overridden=True),
    Check("clearance", _check_clearance, may_be_red_in_trial=True),
    Check("reaction", lambda it: check_reaction(it.guards, it.name)),
    Check("limits", _check_limits, may_be_red_in_trial=True),
    Check("reserve", lambda it: check_reserve(it.guards, it.name), may_be_red_in_trial=True),
    Check("pilot", _check_pilot, is_never_overridden=True),
    Check("bench", _check_bench, is_never_overridden=True),
    Check("watchdog", _check_watchdog, may_be_red_in_trial=True),
    Check("energy", _check_energy, may_be_red_in_trial=True),
    Check("parameters", lambda it: check_parameters(it.graph, it.name)),
    Check("software", _tell_software),
)
