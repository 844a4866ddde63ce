"""Checks for `musselbed doctor` of the aPads on the graph: their generation, definitions and clock."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

from apad_bridge.assembly.stacks import stacks, unloadable
from apad_bridge.doctor.definitions import Md5s
from apad_bridge.doctor.finding import Check, Finding, cannot_tell, fail, ok, run_check, run_checks, warn
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.live_apad import MOST_CHARGE, Door, LiveAPad, NotAnnounced
from apad_bridge.doctor.network import TIMEOUT_S
from apad_bridge.doctor.origin_check import check_origin
from apad_bridge.doctor.positions import reported_places
from apad_bridge.ros_names.names import AMUSSEL, in_full
from apad_bridge.scenario.area.local_frame import OriginLike
from apad_bridge.scenario.schema import LIMITS, Scenario
from apad_bridge.vehicle.generation_a.messages import RELEASE
from apad_bridge.vehicle.generation_a.others_goals import SERVER_SILENT_MS
from apad_bridge.vehicle.stack import Stack

_PART_OF_A = re.compile(r"(.*)/action_server/(goal|feedback|result)")
_SERVER, _DOCKS = "action_server", "check_docking_availability"
_AT_ONCE = 16
_HELD_S, _HELD_HZ = 1.0, 5.0
"""The published server tells of a held aMussel at 20 Hz, and of one that was released once."""
_RELEASED = 1
_PLACE_S = 1.0
_LATE_S = 0.5
"""A larger offset of clocks causes a warning: it is far above a network's delay."""


@dataclass(frozen=True)
class FoundAPad(LiveAPad):
    """An aPad of this stack, and the scenario that may be flown with it."""

    stack: Stack
    scenario: Scenario | None

    @cached_property
    def ours(self) -> Md5s:
        return self.door.our_md5s()


def check_apads(
    door: Door, graph: Graph, scenario: Scenario | None = None, flown: Container[str] = ()
) -> Iterator[Finding]:
    """Makes `CHECKS` of each aPad on the graph, of any generation; a mission is about to begin with those `flown`."""
    for generation, line in unloadable().items():
        yield warn(line, "mend the package, or uninstall it", check=f"stack {generation}")
    found = [(name, stack) for stack in stacks() for name in named_like(graph, stack)]
    dead = sorted(
        _with_parts_of_a(graph) - {name for name, stack in found if _SERVER in stack.recognised_actions}
    )
    for name in dead:
        apad = LiveAPad(door, graph, name)
        yield from run_check(f"{name} action server", partial(_check_action_server, apad))
    if not found and not dead:
        mend = (
            "start it, or fly the simulated one: musselbed run --apad sim; a real one has "
            f"{' or '.join(f'{stack.known_by} below its NAME' for stack in stacks())}"
        )
        yield warn("none on this master", mend, check="aPad")
        return
    for name, stack in sorted(found, key=lambda it: (it[0], it[1].generation)):
        found_apad = FoundAPad(door, graph, name, stack, scenario)
        yield from run_checks(CHECKS, found_apad, name, before_mission=name in flown)


def check_docks(apad: LiveAPad, scenario: Scenario | None) -> Iterator[Finding]:
    """Asks an aPad of generation A what its docks hold already, before a run that would begin with them empty."""
    try:
        told = _docking_info(apad)
    except NotAnnounced as error:
        yield cannot_tell(
            f"did not report what they hold: {error}",
            "start the node that offers its services",
        )
        return
    if told is None:
        return
    if not (held := _names_held(told)):
        yield ok(f"empty; free: {', '.join(map(str, told.available_slots)) or 'none said'}")
        return
    ours = (
        []
        if scenario is None
        else [it for it in held if it in {f"{AMUSSEL}{n}" for n in scenario.fleet.all_ids}]
    )
    others = [it for it in held if it not in ours]
    found = []
    if ours:
        found.append(
            f"{', '.join(ours)}: a run believes them docked from its begin, and their bodies lie on the bottom"
        )
    if others:
        found.append(f"{', '.join(others)}, which a run does not see: trips to fill these docks are wasted")
    mend = f"release by name: {_releases(apad.name, held)}"
    free = 0 if scenario is None else scenario.apad.docks - len(held)
    if free > 0:
        mend += f"; or leave these docks out: apad.docks: {free} in the scenario"
    yield warn(f"hold {'; '.join(found)}", mend)


def _docking_info(apad: LiveAPad) -> Any:
    """The answer of `check_docking_availability`, None where nobody offers it. NotAnnounced for none."""
    service = apad.topic(_DOCKS)
    if service not in apad.graph.services:
        return None
    return apad.door.answer(apad.graph, service, "misc_msgs/GetDockingInfo")


def _names_held(told: Any) -> list[str]:
    return [it.strip("/") for it in told.slots if it.strip("/")]


def _dock_count(apad: LiveAPad) -> int | None:
    """The vehicle's docks, free and taken, by its own answer; None where it gives none."""
    try:
        told = _docking_info(apad)
    except NotAnnounced:
        return None  # the line of the docks says so
    return None if told is None else len(told.available_slots) + len(_names_held(told)) or None


def check_held(apad: LiveAPad, namespace: str = "") -> Finding:
    """Finds aMussels in generation A's docks by `position_static`, a witness that its availability service ignores."""
    held = re.compile(in_full(namespace, rf"({AMUSSEL}\d+)/position_static"))
    topics = [it for it, nodes in apad.graph.publishers.items() if nodes and held.fullmatch(it)]
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        read = pool.map(lambda it: apad.door.positions(apad.graph, it, _HELD_S), topics)
        rates = {
            topic: len(samples) / _HELD_S
            for topic, samples in zip(topics, read, strict=True)
            if len(samples) >= _HELD_HZ * _HELD_S and samples[-1].status != _RELEASED
        }
    if not rates:
        return ok("no position_static comes: nothing is held")
    told = ", ".join(f"{topic} comes at {rate:.1f} Hz" for topic, rate in sorted(rates.items()))
    return fail(
        f"{told}: the docks hold them, whatever check_docking_availability says",
        "release them by name, and wait until it is silent: "
        + _releases(apad.name, map(_named, sorted(rates))),
    )


def _named(topic: str) -> str:
    return topic.split("/")[-2]


def _releases(name: str, held: Iterable[str]) -> str:
    return "; ".join(
        f"rostopic pub -1 {name}/action_server/goal apad/aPadActionGoal '{{goal: {{id: {RELEASE}, object: {it}}}}}'"
        for it in held
    )


def check_place(apad: LiveAPad, ours: OriginLike) -> Finding:
    """The vehicle's local (0, 0) is the scenario's, by its parameters and by its positions."""
    return check_origin(apad.graph.uri, apad.name, ours, reported_places(apad.positions(_PLACE_S)))


def _with_parts_of_a(graph: Graph) -> set[str]:
    """The namespaces below which something of generation A's action is on the graph."""
    return {
        found[1]
        for topic, nodes in (*graph.publishers.items(), *graph.subscribers.items())
        if nodes
        and (found := _PART_OF_A.fullmatch(topic))
        and graph.types.get(topic) == f"apad/aPadAction{found[2].capitalize()}"
    }


def _check_action_server(apad: LiveAPad) -> Finding:
    """Orders of generation A go by this alone: a server that is half there or silent takes none."""
    graph, server = apad.graph, apad.topic(_SERVER)
    missing = [
        f"publishes {it}"
        for it in ("status", "feedback", "result")
        if not graph.publishers.get(f"{server}/{it}")
    ]
    missing += [
        f"subscribes to {it}" for it in ("goal", "cancel") if not graph.subscribers.get(f"{server}/{it}")
    ]
    mend = (
        "it takes no orders: see the line of the clock, if it follows one; or end its node if it still runs, "
        "rosnode cleanup, and start it again"
    )
    if missing:
        return fail(f"dead: nobody {', '.join(missing)} of {server}", mend)
    try:
        # The first may be the last word of one that is dead, for actionlib latches it.
        apad.door.messages(graph, f"{server}/status", 2, SERVER_SILENT_MS / 1000)
    except NotAnnounced as error:
        return fail(f"dead: {server}/status is silent: {error}", mend)
    return ok(f"lives: {server}/status comes")


def _check_battery(apad: LiveAPad) -> Finding:
    topic = apad.topic("battery_level")
    try:
        percent = apad.battery_percent()
    except NotAnnounced as error:
        return cannot_tell(
            f"unknown: {topic}: {error}",
            "start the node that publishes it; the published server speaks after start_sim alone",
        )
    if percent > 100 * MOST_CHARGE:
        return fail(f"{topic} says {percent:g} %", "see the gauge, and what publishes it")
    if not percent > 0:
        return warn(
            f"{topic} says {percent:g} %: a run that ends at apad.battery's end is over at once",
            "charge it, or set its gauge; the published server's is right after start_sim alone",
        )
    return ok(f"{percent:.0f} %")


def named_like(graph: Graph, stack: Stack) -> set[str]:
    """The namespaces below which the graph has all by which the stack is recognised."""
    marks = [
        {
            topic.removesuffix(f"/{action}/goal")
            for topic, nodes in graph.subscribers.items()
            if topic.endswith(f"/{action}/goal")
            and nodes
            and graph.types.get(topic) in (f"{kind}Goal", "*", None)
        }
        for action, kind in stack.recognised_actions.items()
    ]
    marks += [
        {name.removesuffix(f"/{service}") for name in graph.services if name.endswith(f"/{service}")}
        for service in stack.recognised_services
    ]
    return set.intersection(*marks)


def _show_capabilities(stack: Stack, docks: int | None) -> Finding:
    """Lists the orders that a mission may give this aPad, and those that it may not.

    `docks` are those that the vehicle itself counts, None where it does not tell.
    """
    nameable = LIMITS[stack.generation].docks
    able = stack.capabilities(1)
    told = (
        "docks by its own eyes" if able.sees_amussels else "has no eyes to dock by",
        "holds a position" if able.can_hold else "holds a position by going there",
        "reports what its docks hold" if able.reports_contact else "does not report what its docks hold",
        "obeys the speed of a go-to" if able.obeys_speed else "goes at a speed of its own",
        f"does not tell how many docks it has: its messages can name {nameable}"
        if docks is None
        else f"has {docks} docks",
    )
    return ok("; ".join(told))


def _check_md5s(apad: FoundAPad) -> Finding:
    stack, door, ours = apad.stack, apad.door, apad.ours
    differing, silent, same = [], [], []
    for part, type_name in {**stack.topic_types, **stack.service_types}.items():
        if type_name not in ours:  # a package's stack may have types of its own, which its link judges
            continue
        probe = door.service_md5 if part in stack.service_types else door.topic_md5
        try:
            md5 = probe(apad.graph, apad.topic(part))
        except NotAnnounced as error:
            silent.append(f"{part} ({error})")
            continue
        if md5 == ours[type_name]:
            same.append(f"{part} {md5}")
        elif part in stack.service_types and door.is_by_text(type_name, md5):
            same.append(f"{part} {md5} (by the text on ROS_PACKAGE_PATH, ours is {ours[type_name]})")
        else:
            differing.append(f"{part}: {type_name} is {md5}, ours {ours[type_name]}")
    if differing:
        mend = (
            "source its workspace, or put the aPad's texts of these types into apad_bridge/ros/definitions and run "
            "launch_scripts/install"
        )
        return fail("; ".join(differing), mend)
    if silent:
        return cannot_tell(
            f"did not tell the md5 of {'; '.join(silent)}",
            "start its nodes; see the lines of its nodes above",
        )
    return ok(f"an aPad with {stack.known_by}; speaks our definitions: {', '.join(same)}")


def _check_beside(apad: FoundAPad) -> Iterator[Finding]:
    graph, door, ours = apad.graph, apad.door, apad.ours
    differing, same = [], []
    for part, type_name in apad.stack.unused_types.items():
        full = apad.topic(part)
        if full not in graph.services and full not in graph.publishers:
            continue
        try:
            md5 = (door.service_md5 if full in graph.services else door.topic_md5)(graph, full)
        except NotAnnounced:
            continue
        if md5 == ours[type_name]:
            same.append(f"{part} {md5}")
        else:
            differing.append(f"{part}: md5 {md5}, ours {ours[type_name]} ({type_name})")
    if differing:
        yield warn(
            f"not used by us, and other than the simulated aPad's: {'; '.join(differing)}",
            "to try programs of yours against the simulated aPad, put the aPad's texts into "
            "apad_bridge/ros/definitions by these names and run launch_scripts/install",
        )
    elif same:
        yield ok(f"as the simulated aPad's: {', '.join(same)}")


def _check_offset(apad: LiveAPad) -> Finding:
    """The offset of the aPad's clock from this machine's, by the stamp of its next position."""
    topic = apad.topic("position")
    try:
        (offset_s,) = apad.door.stamp_offsets_s(apad.graph, topic, 1, TIMEOUT_S)
    except NotAnnounced as error:
        return cannot_tell(
            f"unknown: {topic}: {error}",
            "start the node that publishes it, then run this again",
        )
    if abs(offset_s) <= _LATE_S:
        return ok(f"{offset_s:+.2f} s from this machine's, the network's delay included")
    return warn(
        f"{offset_s:+.1f} s from this machine's: stamps of the two cannot be compared",
        "set both clocks alike (chrony, ntpdate) before a run, or subtract this when logs are merged; "
        "with /clock on the master, fly with --time ros",
    )


CHECKS: tuple[Check[FoundAPad], ...] = (
    Check("", _check_md5s),
    Check("beside", _check_beside),
    Check("capabilities", lambda it: _show_capabilities(it.stack, _dock_count(it))),
    Check("clock", _check_offset, may_be_red_in_trial=True),
    Check("battery", _check_battery, may_be_red_in_trial=True),
    Check(
        "action server",
        lambda it: _check_action_server(it) if _SERVER in it.stack.recognised_actions else [],
    ),
    Check(
        "docks",
        lambda it: check_docks(it, it.scenario) if _DOCKS in it.stack.service_types else [],
        is_red_at_warning=True,
        may_be_red_in_trial=True,
    ),
)
