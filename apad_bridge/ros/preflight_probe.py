"""Measures a real aPad and the way to it before a mission, and has the findings made of that (`doctor/preflight.py`).

Nothing is ordered here, and no node of ours is on the graph: the aPad's publishers are asked past the master.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from importlib.metadata import version

from apad_bridge.assembly.safety import LegEnergy
from apad_bridge.assembly.stacks import STACKS
from apad_bridge.doctor.finding import Finding, fail, ok
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
    check_clearance,
    check_delay,
    check_energy,
    check_fence,
    check_generation,
    check_off,
    check_pilot,
    check_reaction,
    check_reserve,
    check_watchdog,
)
from apad_bridge.ros.doctor_apad_checks import check_held, named_like
from apad_bridge.ros.types.wire_probe import NotAnnounced, service_md5
from apad_bridge.ros.vehicle_probe import charge, clock_offset_s, heard_bool, heard_text, positions
from apad_bridge.ros_names.names import CLOCK, USE_SIM_TIME, in_full, of_apad
from apad_bridge.scenario.area.fence import fence_of
from apad_bridge.scenario.choices import Generation
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


def check_vehicle(
    graph: Graph, scenario: Scenario, starts: Sequence[Start], namespace: str = ""
) -> Iterator[Finding]:
    """Watches the scenario's aPad for `WATCHED_S`, and judges it by the scenario. `graph` is seen by the run's names."""
    apad = in_full(namespace, scenario.apad.name)
    guards = scenario.guards or GuardOptions()
    topic = of_apad(apad, "position")
    stacks = [it for it in STACKS if apad in named_like(graph, it)]
    generations = [it.generation for it in stacks]
    yield check_generation(apad, scenario.apad.generation, generations)
    for stack in stacks:
        yield _check_off(graph, apad, stack, hardware_cut=guards.hardware_cut)
        if stack.capabilities(1).reports_contact:
            yield check_held(graph, apad, namespace)
    samples = positions(graph, topic, WATCHED_S)
    yield check_position(
        apad,
        samples,
        WATCHED_S,
        min(guards.jump_m, MOST_JUMP_M),
        2 * scenario.apad.max_speed_m_s,
        graph.publishers.get(topic, []),
    )
    yield check_gps(apad, samples, guards.position_error_m)
    yield check_loss(apad, samples, WATCHED_S)
    yield check_lag(apad, samples, clock_offset_s(graph, apad))
    place_m = _last_place(samples)
    places = [(it.north_m, it.east_m) for it in starts]
    yield from check_fence(apad, place_m, fence_of(scenario.area), guards.clearance_m, places)
    yield _check_room(apad, scenario, guards, stacks)
    yield check_reaction(guards, apad)
    yield check_reserve(guards, apad)
    is_b = Generation.B in generations
    yield check_pilot(apad, hears_pilot=is_b, manual=heard_bool(graph, of_apad(apad, "manual")))
    yield check_watchdog(apad, drifts=is_b, state=heard_text(graph, of_apad(apad, "watchdog")))
    yield check_energy(apad, charge(graph, apad), energy_need(scenario, place_m))
    yield check_parameters(graph, apad)
    told = ", ".join(f"{it} {version(it)}" for it in ("musselbed", "rospy"))
    yield ok(f"{apad} software", f"generation {', '.join(generations) or 'unknown'}; here {told}")


def _check_off(graph: Graph, apad: str, stack: Stack, *, hardware_cut: bool) -> Finding:
    missing = []
    for leaf in stack.off_services:
        try:
            service_md5(graph, f"{apad}/{leaf}")
        except NotAnnounced:
            missing.append(leaf)
    return check_off(apad, missing, stack.off_services, hardware_cut=hardware_cut)


def _check_room(apad: str, scenario: Scenario, guards: GuardOptions, stacks: Sequence[Stack]) -> Finding:
    """A vehicle that does not obey a go-to's speed goes as fast as its guard lets it."""
    drift_m_s = fastest_drift_m_s(scenario)
    if all(it.capabilities(1).obeys_speed for it in stacks):
        return check_clearance(guards, apad, scenario.mission.speed_m_s, "mission.speed_m_s", drift_m_s)
    if guards.speed_limit_m_s is None:
        return fail(
            f"{apad} clearance",
            "this generation goes at a speed of its own, and no guard bounds it",
            "set guards.speed_limit_m_s, with the clearance that it needs",
        )
    return check_clearance(guards, apad, guards.speed_limit_m_s, "guards.speed_limit_m_s", drift_m_s)


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


def _last_place(samples: Sequence[PositionSample]) -> tuple[float, float] | None:
    finite = [it for it in samples if math.isfinite(it.north_m) and math.isfinite(it.east_m)]
    return (finite[-1].north_m, finite[-1].east_m) if finite else None
