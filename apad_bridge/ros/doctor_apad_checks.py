"""Checks for `musselbed doctor` of the aPads on the graph: their generation, definitions and clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from apad_bridge.doctor.definitions import Md5s, python_md5s
from apad_bridge.doctor.finding import Finding, fail, ok, warn
from apad_bridge.doctor.graph import Graph
from apad_bridge.ros.types.messages import generated_folder
from apad_bridge.ros.types.wire_probe import NotAnnounced, service_md5, stamp_offset_s, topic_md5
from apad_bridge.ros.types.workspace_services import service_by_text

_ACTION = "action_server"
_PRIMITIVE = "commander/primitive"


@dataclass(frozen=True, slots=True)
class _Interface:
    """The name by which a generation is recognised, and the types of its topics and services, whose md5s are checked.

    We do not use the topics and services in `beside`: where one is there and differs, only the simulated aPad differs.
    """

    known_by: str
    topics: dict[str, str]
    services: dict[str, str]
    beside: dict[str, str] = field(default_factory=dict)


_A = _Interface(
    _ACTION,
    {
        f"{_ACTION}/result": "apad/aPadActionResult",
        f"{_ACTION}/feedback": "apad/aPadActionFeedback",
        "position": "auv_msgs/NavSts",
    },
    {
        "check_docking_availability": "misc_msgs/GetDockingInfo",
        "change_docking_status": "misc_msgs/ChangeDockingStatus",
        "get_battery_level": "misc_msgs/GetChargeInfo",
    },
)
_B = _Interface(
    _PRIMITIVE,
    {"position": "auv_msgs/NavSts"},
    {
        f"{_PRIMITIVE}/go2point": "misc_msgs/Go2pointPrimitiveService",
        f"{_PRIMITIVE}/dynamic_positioning": "misc_msgs/DynamicPositioningPrimitiveService",
        f"{_PRIMITIVE}/docking": "misc_msgs/DockingPrimitiveService",
    },
    {
        "commander/go2point": "misc_msgs/Go2pointService",
        "commander/docking": "misc_msgs/DockingService",
        "go2point/result": "navcon_msgs/GoToPointActionResult",
        "go2point/feedback": "navcon_msgs/GoToPointActionFeedback",
    },
)
_LATE_S = 0.5
"""A larger offset of clocks causes a warning: it is far above a network's delay."""


def check_apads(graph: Graph) -> Iterator[Finding]:
    """Asks the aPads on the graph, of any generation, for their md5s, and compares them with our definitions."""
    goal, service = f"/{_ACTION}/goal", f"/{_PRIMITIVE}/go2point"
    found = [
        (topic.removesuffix(goal), _A)
        for topic, nodes in graph.subscribers.items()
        if topic.endswith(goal) and nodes and graph.types.get(topic) in ("apad/aPadActionGoal", "*", None)
    ]
    found += [(name.removesuffix(service), _B) for name in graph.services if name.endswith(service)]
    if not found:
        mend = (
            f"start it, or fly the simulated one: musselbed run --apad sim; a real one has the action NAME/{_ACTION} "
            f"or services below NAME/{_PRIMITIVE}"
        )
        yield warn("aPad", "none on this master", mend)
        return
    ours = python_md5s(generated_folder(), ("apad", "auv_msgs", "misc_msgs", "navcon_msgs"))
    for name, interface in sorted(found, key=lambda it: (it[0], it[1].known_by)):
        yield _check_md5s(graph, name, interface, ours)
        yield from _check_beside(graph, name, interface, ours)
        yield _check_offset(graph, f"{name}/position", name)


def _check_md5s(graph: Graph, name: str, interface: _Interface, ours: Md5s) -> Finding:
    differing, silent, same = [], [], []
    for part, type_name in {**interface.topics, **interface.services}.items():
        probe = service_md5 if part in interface.services else topic_md5
        try:
            md5 = probe(graph, f"{name}/{part}")
        except NotAnnounced as error:
            silent.append(f"{part} ({error})")
            continue
        if md5 == ours[type_name]:
            same.append(f"{part} {md5}")
        elif part in interface.services and service_by_text(type_name, md5) is not None:
            same.append(f"{part} {md5} (by the text on ROS_PACKAGE_PATH, ours is {ours[type_name]})")
        else:
            differing.append(f"{part}: {type_name} is {md5}, ours {ours[type_name]}")
    if differing:
        mend = (
            "source its workspace, or put the aPad's texts of these types into apad_bridge/ros/definitions and run "
            "launch_scripts/install"
        )
        return fail(name, "; ".join(differing), mend)
    if silent:
        return warn(
            name,
            f"did not tell the md5 of {'; '.join(silent)}",
            "start its nodes; see the lines of its nodes above",
        )
    return ok(name, f"an aPad with {interface.known_by}; speaks our definitions: {', '.join(same)}")


def _check_beside(graph: Graph, name: str, interface: _Interface, ours: Md5s) -> Iterator[Finding]:
    differing, same = [], []
    for part, type_name in interface.beside.items():
        full = f"{name}/{part}"
        if full not in graph.services and full not in graph.publishers:
            continue
        try:
            md5 = (service_md5 if full in graph.services else topic_md5)(graph, full)
        except NotAnnounced:
            continue
        if md5 == ours[type_name]:
            same.append(f"{part} {md5}")
        else:
            differing.append(f"{part}: md5 {md5}, ours {ours[type_name]} ({type_name})")
    if differing:
        yield warn(
            f"{name} beside",
            f"not used by us, and other than the simulated aPad's: {'; '.join(differing)}",
            "to try programs of yours against the simulated aPad, put the aPad's texts into "
            "apad_bridge/ros/definitions by these names and run launch_scripts/install",
        )
    elif same:
        yield ok(f"{name} beside", f"as the simulated aPad's: {', '.join(same)}")


def _check_offset(graph: Graph, topic: str, name: str) -> Finding:
    """The offset of the aPad's clock from this machine's, by the stamp of its next position."""
    try:
        offset_s = stamp_offset_s(graph, topic)
    except NotAnnounced as error:
        return warn(
            f"{name} clock",
            f"unknown: {topic}: {error}",
            "start the node that publishes it, then run this again",
        )
    if abs(offset_s) <= _LATE_S:
        return ok(f"{name} clock", f"{offset_s:+.2f} s from this machine's, the network's delay included")
    return warn(
        f"{name} clock",
        f"{offset_s:+.1f} s from this machine's: stamps of the two cannot be compared",
        "set both clocks alike (chrony, ntpdate) before a run, or subtract this when logs are merged; "
        "with /clock on the master, fly with --time ros",
    )
