"""Checks of an aPad before it moves: pure functions of what was measured, and the table that measures for each.

Nothing is ordered here, and no node of ours is on the graph: the aPad's publishers are asked past the master.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version

from apad_bridge.assembly.safety import LegEnergy
from apad_bridge.assembly.stacks import stacks
from apad_bridge.doctor.apad_checks import check_held, named_like
from apad_bridge.doctor.finding import Check, CheckStatus, Finding, cannot_tell, fail, ok, warn
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.limits import (
    MOST_JUMP_M,
    check_clearance,
    check_fence,
    check_limits,
    check_reaction,
    check_reserve,
)
from apad_bridge.doctor.live_apad import MOST_CHARGE, LiveAPad, NotAnnounced, TopicSeen
from apad_bridge.doctor.network import Unreachable, call_for_reply, connect
from apad_bridge.doctor.positions import PositionSample, check_gps, check_lag, check_loss, check_position
from apad_bridge.ros_names.names import CLOCK, USE_SIM_TIME, below_apad, in_full, is_one_of_several, ours
from apad_bridge.scenario.area.fence import fence_of
from apad_bridge.scenario.blocks.guard_options import GuardOptions
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.hull_in_flow import fastest_drift_m_s, hardest_metre
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts_table import Start
from apad_bridge.vehicle.stack import Stack

SLOW_S, TOO_SLOW_S = 0.2, 1.0
"""A worse way there and back causes a warning; a far worse one is red, for a stop would be as late."""
WATCHDOG_STATES = frozenset(
    {"WAITING", "WATCHING", "SILENT", "HELD", "OFF", "PILOTED", "HOMEWARD", "HOME", "LEFT"}
)
"""The states of `launch_scripts/vehicle_watchdog`."""
LEAST_SILENCE_S, MOST_SILENCE_S = 5.0, 15.0
"""A watchdog that waits less stops the aPad for a gap of a poor link, and one that waits longer lets it go too far."""
_WATCHED_S = 3.0
_ROUND_TRIPS = 20
_S_PER_HOUR = 3600
QUAY_CHECK = "on the quay: does the joystick still work after OFF?"


def check_delay(round_trips_s: Sequence[float], uri: str) -> Finding:
    """The network's delay, by the time that connections to the master take: one way there and back each."""
    median_s, worst_s = statistics.median(round_trips_s), max(round_trips_s)
    found = f"{uri}: {1000 * median_s:.0f} ms there and back, {1000 * worst_s:.0f} ms at worst of {len(round_trips_s)}"
    mend = "come nearer with the antenna, take another channel, or leave others off this Wi-Fi"
    if worst_s > TOO_SLOW_S:
        return fail(found, mend)
    return warn(found, mend) if worst_s > SLOW_S else ok(found)


def check_generation(wanted: Generation, found: Sequence[Generation]) -> Finding:
    """The vehicle speaks the scenario's generation, and only one where the scenario names none."""
    names = " and ".join(it.value for it in found)
    if not found:
        return fail(
            "no aPad of either generation answers: no node takes orders",
            "start the vehicle's action server (generation A) or its commander (B), and see the aPad's name",
        )
    if wanted is Generation.AUTO and len(found) > 1:
        return fail(f"both are there: {names}", "apad.generation in the scenario says which to fly")
    if wanted is not Generation.AUTO and wanted not in found:
        return fail(
            f"it is {names}, and the scenario's is {wanted.value}",
            f"apad.generation: {found[0].value}, or start the other software on the vehicle",
        )
    return ok(names if wanted is Generation.AUTO else wanted.value)


def check_off(missing: Sequence[str], offered: Sequence[str], *, hardware_cut: bool) -> Finding:
    """A stop that needs no position: `offered` and `missing` are the services by which the vehicle cuts its thrust."""
    if not missing:
        return ok(f"it offers {', '.join(offered)}: no thrust by order. {QUAY_CHECK}")
    found = f"{', '.join(missing)} not offered: no order cuts the thrust"
    if hardware_cut:
        return warn(
            f"{found}; the scenario declares a remote hardware cut",
            "on the quay: see the cut work from as far as the aPad will be",
        )
    return fail(
        found,
        "start the node that offers them; or give the vehicle a remote hardware cut and declare it by "
        "guards.hardware_cut: true",
    )


def check_pilot(*, hears_pilot: bool, manual: TopicSeen) -> Finding:
    """Nobody steers the aPad. `hears_pilot`: its generation tells by the topic `manual`."""
    if manual.value:
        return fail("a pilot steers (manual is true)", "let the pilot put the joystick down, then try again")
    if manual.is_published and manual.value is None:
        return cannot_tell(
            "the node that publishes manual is silent: a pilot may steer",
            "start the joystick's node again, or have it publish at once (latched)",
        )
    if not hears_pilot:
        return ok("this generation does not tell of one: agree by voice who has the aPad")
    if not manual.is_published:
        return warn(
            "no node publishes manual: the bench cannot notice a pilot who takes the aPad over",
            "start the joystick's node; or remap manual to what tells of your pilot",
        )
    return ok("nobody steers (manual is false)")


def check_bench(topic: str, others: Sequence[str]) -> Finding:
    """`others` are the living nodes that publish this vehicle's heartbeat: benches that fly it already."""
    return fail(*second_bench(topic, others)) if others else ok(f"no other bench publishes {topic}")


def second_bench(topic: str, others: Sequence[str]) -> tuple[str, str]:
    """The trouble with benches that fly the same vehicle, and the mend."""
    found = (
        f"{', '.join(others)} publishes {topic}: another bench flies this aPad, and both would order it. "
        "Its watchdog could not tell that one of them died"
    )
    return found, "end that run first, by Ctrl-C or `musselbed abort RUN`"


@dataclass(frozen=True, slots=True)
class WatchdogSeen:
    """The topics of the vehicle's watchdog: its state, and its settings as JSON."""

    state: TopicSeen
    settings: TopicSeen
    nodes: Sequence[str] = ()
    """Those that publish a state and live."""


def check_watchdog(seen: WatchdogSeen, heartbeat: str, *, drifts: bool, is_demanded: bool) -> Finding:
    """The vehicle's watchdog runs, and listens to the `heartbeat` of this bench.

    `drifts`: controllers go off between primitives. `is_demanded`: by `guards.watchdog`.
    """
    state = seen.state
    mend = "start launch_scripts/vehicle_watchdog on the vehicle's own computer: docs/failures.md"
    if len(seen.nodes) > 1:
        return fail(f"{', '.join(seen.nodes)} publish its state", "end all of these but one")
    if state.value is not None and state.value in WATCHDOG_STATES:
        return _judge_settings(f"it runs, and says {state.value}", seen.settings, heartbeat)
    if state.value is not None:
        return fail(f"{state.value!r} is none of its states: another node publishes its topic", mend)
    if state.is_published:
        return fail("its topic has a publisher, and is silent", mend)
    if drifts:
        return fail("none: on a lost link this aPad drifts as soon as a primitive ends", mend)
    if is_demanded:
        return fail("none, and guards.watchdog demands one", mend)
    return warn("none: on a lost link this aPad continues to its last goal", mend)


def _judge_settings(found: str, settings: TopicSeen, heartbeat: str) -> Finding:
    """A watchdog that listens elsewhere, or for too long, stops nothing in time."""
    try:
        told = json.loads(settings.value or "")
        listens_to, silence_s = str(told["heartbeat"]), float(told["silence_s"])
    except (ValueError, TypeError, KeyError):
        return cannot_tell(
            f"{found}, but not to which heartbeat it listens: it is an older one, or another node",
            "copy this version's launch_scripts/vehicle_watchdog to the vehicle's computer, and start it",
        )
    found = f"{found}; it listens to {listens_to}, and acts after {silence_s:g} s"
    if listens_to != heartbeat:
        return fail(
            f"{found}: this bench's heartbeat is {heartbeat}", f"start it with --heartbeat {heartbeat}"
        )
    mend = "start it with --silence-s 10"
    if not silence_s <= MOST_SILENCE_S:
        return fail(f"{found}: {MOST_SILENCE_S:g} s is the most", mend)
    if silence_s < LEAST_SILENCE_S:
        return warn(f"{found}: a poor link has gaps of {LEAST_SILENCE_S:g} s", mend)
    return ok(found)


@dataclass(frozen=True, slots=True)
class EnergyNeed:
    """Parts of a full battery."""

    at_rest: float
    """For the mission's time without any motion."""
    under_way: float
    """For the mission's time at the mission's speed."""
    way_home: float
    reserve: float


def check_energy(charge: float | None, need: EnergyNeed) -> Finding:
    """The charge against the least and the most that the mission can take."""
    if charge is None:
        return cannot_tell("its charge is not known", "see the line of the battery")
    if not 0 <= charge <= MOST_CHARGE:
        return fail(f"{100 * charge:.0f} % is no charge of a battery", "see the gauge, and what publishes it")
    least = need.at_rest + need.way_home + need.reserve
    most = need.under_way + need.way_home + need.reserve
    found = (
        f"{100 * charge:.0f} %; the mission takes {100 * least:.0f} to {100 * most:.0f} %, with {100 * need.reserve:.0f} % "
        f"kept and {100 * need.way_home:.1f} % for the way home"
    )
    if charge < least:
        return fail(found, "charge it, or lower duration_s")
    if charge < most:
        return warn(found, "it may have to end early: charge it, or lower duration_s or mission.speed_m_s")
    return ok(found)


def check_lookout(name: str) -> Finding:
    if name:
        return ok(f"{name}, with the vehicle's own switch in the hand", check="lookout")
    return warn(
        "no lookout is named: there is no collision avoidance, and no order of ours is an emergency stop",
        "--lookout NAME: who looks out and holds the vehicle's hardware switch",
        check="lookout",
    )


def check_stop(failure: str | None, told: str = "") -> Finding:
    """The proof of a stop: `failure` is why it failed, None for one that went well with what it `told`."""
    if failure is None:
        return ok(told)
    return fail(failure, "fly nothing before this is repaired: prove it again on a tether")


def not_proven(apad: str, what: str, option: str) -> Finding:
    return warn(
        "not proven since this scenario's last preflight on this master",
        f"musselbed preflight ... {option}",
        check=f"{apad} {what}",
    )


@dataclass(frozen=True)
class WatchedAPad(LiveAPad):
    """The scenario's aPad on the graph, which is seen by the run's names; measured once, when a check first asks."""

    scenario: Scenario
    starts: Sequence[Start]
    namespace: str

    @property
    def guards(self) -> GuardOptions:
        return self.scenario.guards or GuardOptions()

    @cached_property
    def stacks(self) -> list[Stack]:
        """Each stack whose software the graph has under this name."""
        return [it for it in stacks() if self.name in named_like(self.graph, it)]

    @cached_property
    def samples(self) -> list[PositionSample]:
        """Its positions of `_WATCHED_S`."""
        return self.positions(_WATCHED_S)

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


def _check_way(graph: Graph) -> Finding:
    try:
        return check_delay([_round_trip_s(graph.uri) for _ in range(_ROUND_TRIPS)], graph.uri)
    except Unreachable as error:
        return fail(str(error), "see the line of the master")


def _round_trip_s(uri: str) -> float:
    begun_s = time.monotonic()
    connect(uri).close()
    return time.monotonic() - begun_s


def _check_off(apad: WatchedAPad) -> Iterator[Finding]:
    for stack in apad.stacks:
        missing = []
        for leaf in stack.off_services:
            try:
                apad.door.service_md5(apad.graph, apad.topic(leaf))
            except NotAnnounced:
                missing.append(leaf)
        yield check_off(missing, stack.off_services, hardware_cut=apad.guards.hardware_cut)


def _check_position(apad: WatchedAPad) -> Finding:
    return check_position(
        apad.samples,
        _WATCHED_S,
        min(apad.guards.jump_m, MOST_JUMP_M),
        2 * apad.scenario.apad.max_speed_m_s,
        apad.graph.living_publishers(apad.topic("position")),
    )


def _check_fence(apad: WatchedAPad) -> list[Finding]:
    from apad_bridge.assembly.safety import unreachable_starts

    place_m = apad.place_m
    found = check_fence(place_m, fence_of(apad.scenario.area), apad.guards.clearance_m)
    if place_m is None or found.status is not CheckStatus.OK:
        return [found]
    starts = unreachable_starts(apad.scenario, apad.starts, [place_m])
    return [found, *(warn(happens, mend, check="starts") for happens, mend in starts)]


def _check_clearance(apad: WatchedAPad) -> Finding:
    """A vehicle that does not obey a go-to's speed goes as fast as its guard lets it."""
    guards, drift_m_s = apad.guards, fastest_drift_m_s(apad.scenario)
    if all(it.capabilities(1).obeys_speed for it in apad.stacks):
        return check_clearance(guards, apad.scenario.mission.speed_m_s, "mission.speed_m_s", drift_m_s)
    if guards.speed_limit_m_s is None:
        return fail(
            "this generation goes at a speed of its own, and no guard bounds it",
            "set guards.speed_limit_m_s, with the clearance that it needs",
        )
    return check_clearance(guards, guards.speed_limit_m_s, "guards.speed_limit_m_s", drift_m_s)


def _check_limits(apad: WatchedAPad) -> list[Finding]:
    fence = fence_of(apad.scenario.area)
    return check_limits(
        apad.guards,
        greatest_m_s=apad.scenario.apad.max_speed_m_s,
        deceleration_m_s2=apad.scenario.apad.max_acceleration_m_s2,
        longest_m=math.inf if fence is None else fence.longest_m,
        speed_m_s=apad.scenario.mission.speed_m_s,
    )


def _check_watchdog(apad: WatchedAPad) -> Finding:
    nodes = apad.graph.living_publishers(apad.topic("watchdog"))
    return check_watchdog(
        WatchdogSeen(apad.heard_text("watchdog"), apad.heard_text("watchdog_settings"), nodes),
        apad.graph.name_there(apad.heartbeat),
        drifts=any(it.drifts_between_orders for it in apad.stacks),
        is_demanded=apad.guards.watchdog is not None,
    )


def _check_parameters(apad: LiveAPad) -> Finding:
    """The parameters by which other places or times would be meant."""
    found = []
    for name in (USE_SIM_TIME, *(apad.topic(f"LocalOrigin{it}") for it in ("Lat", "Lon"))):
        code, _, value = call_for_reply(apad.graph.uri, "getParam", name)
        found.append(f"{name} {value if code == 1 else 'not set'}")
        if name == USE_SIM_TIME and code == 1 and value:
            mend = "rosparam set /use_sim_time false, and start the nodes again; for a simulated aPad: --time ros"
            return fail(f"{name} is true: no real vehicle follows a {CLOCK}", mend)
    return ok(", ".join(found))


def _show_software(apad: WatchedAPad) -> Finding:
    here = ", ".join(f"{it} {version(it)}" for it in ("musselbed", "rospy"))
    generations = ", ".join(it.generation for it in apad.stacks) or "unknown"
    return ok(f"generation {generations}; here {here}")


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


CHECKS_OF_WAY: tuple[Check[Graph], ...] = (Check("delay", _check_way, may_be_red_in_trial=True),)
CHECKS: tuple[Check[WatchedAPad], ...] = (
    Check(
        "generation",
        lambda it: check_generation(it.scenario.apad.generation, [stack.generation for stack in it.stacks]),
    ),
    Check("off", _check_off),
    Check(
        "docks held",
        lambda it: (
            check_held(it, it.namespace)
            if any(stack.capabilities(1).reports_contact for stack in it.stacks)
            else []
        ),
        may_be_red_in_trial=True,
    ),
    Check("position", _check_position, is_never_overridden=True),
    Check("GPS", lambda it: check_gps(it.samples, it.guards.position_error_m), may_be_red_in_trial=True),
    Check("loss", lambda it: check_loss(it.samples, _WATCHED_S), may_be_red_in_trial=True),
    Check("lag", lambda it: check_lag(it.samples, it.clock_offset_s()), may_be_red_in_trial=True),
    Check("fence", _check_fence, is_never_overridden=True),
    Check("clearance", _check_clearance, may_be_red_in_trial=True),
    Check("reaction", lambda it: check_reaction(it.guards)),
    Check("limits", _check_limits, may_be_red_in_trial=True),
    Check("reserve", lambda it: check_reserve(it.guards), may_be_red_in_trial=True),
    Check(
        "pilot",
        lambda it: check_pilot(
            hears_pilot=any(stack.hears_pilot for stack in it.stacks), manual=it.heard_bool("manual")
        ),
        is_never_overridden=True,
    ),
    Check(
        "bench",
        lambda it: check_bench(it.heartbeat, it.graph.living_publishers(it.heartbeat)),
        is_never_overridden=True,
    ),
    Check("watchdog", _check_watchdog, may_be_red_in_trial=True),
    Check(
        "energy",
        lambda it: check_energy(it.charge(), energy_need(it.scenario, it.place_m)),
        may_be_red_in_trial=True,
    ),
    Check("parameters", _check_parameters),
    Check("software", _show_software),
)
