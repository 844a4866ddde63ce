"""The checks of `musselbed doctor` that need ROS's own libraries: its packages, its messages, and who speaks which md5."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import genmsg
import rosgraph.network
from genmsg.gentools import compute_md5
from genmsg.msg_loader import load_depends, load_msg_by_type, load_srv_by_type
from rospkg.rospack import list_by_path  # type: ignore[import-untyped]

from apad_bridge.diagnosis.definitions import Definitions, Md5s, check_definitions, python_md5s
from apad_bridge.diagnosis.finding import Finding, fail, ok, warn
from apad_bridge.diagnosis.graph import Graph
from apad_bridge.ros.generate import SYSTEM_DEFINITIONS
from apad_bridge.ros.messages import DEFINITIONS, MessagesUnusable, generated_folder, use_generated_messages
from apad_bridge.ros.their_services import service_by_text
from apad_bridge.ros.wire_probe import NotTold, service_md5, stamp_offset_s, topic_md5

_PACKAGES = {
    "rospy": "python3-rospy",
    "rosgraph": "python3-rosgraph",
    "rosmaster": "python3-rosmaster",
    "roslaunch": "python3-roslaunch",
    "actionlib": "python3-actionlib",
    "genpy": "python3-genpy",
    "std_msgs": "python3-std-msgs",
    "std_srvs": "python3-std-srvs",
    "geometry_msgs": "python3-geometry-msgs",
    "sensor_msgs": "python3-sensor-msgs",
    "nav_msgs": "python3-nav-msgs",
    "visualization_msgs": "python3-visualization-msgs",
    "diagnostic_msgs": "python3-diagnostic-msgs",
    "tf2_msgs": "python3-tf2-msgs",
    "rosgraph_msgs": "python3-rosgraph-msgs",
}
"""What is imported, and the Debian package that brings it."""

_ACTION = "action_server"
_PRIMITIVE = "commander/primitive"


@dataclass(frozen=True, slots=True)
class _Speech:
    """What an aPad of a generation is known by, and whose md5s it is asked for: types by topic and by service."""

    known_by: str
    topics: dict[str, str]
    services: dict[str, str]


_A = _Speech(
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
_B = _Speech(
    _PRIMITIVE,
    {"position": "auv_msgs/NavSts"},
    {
        f"{_PRIMITIVE}/go2point": "misc_msgs/Go2pointPrimitiveService",
        f"{_PRIMITIVE}/dynamic_positioning": "misc_msgs/DynamicPositioningPrimitiveService",
        f"{_PRIMITIVE}/docking": "misc_msgs/DockingPrimitiveService",
    },
)
_LATE_S = 0.5
"""An offset of clocks beyond this is worth a line: it is far above what a network takes."""


def check_ros_packages() -> Iterator[Finding]:
    for name, debian in _PACKAGES.items():
        try:
            module = importlib.import_module(name)
        except ImportError as error:
            yield fail(
                name,
                f"cannot be imported: {error}",
                f"apt-get install {debian}, or run launch_scripts/install",
            )
            continue
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            version = "importable"
        yield ok(name, f"{version} in {Path(str(module.__file__)).parent}")


def check_messages() -> Finding:
    try:
        folder = use_generated_messages()
    except MessagesUnusable as error:
        found, _, mend = str(error).rpartition(": ")
        return fail("messages", found, mend)
    return ok("messages", f"generated and current, in {folder}")


def check_other_definitions() -> Iterator[Finding]:
    """The user's workspaces, as this shell knows them, beside ours."""
    ours = generated_folder()
    packages = sorted(entry.name for entry in DEFINITIONS.iterdir())
    known = Definitions(str(ours), python_md5s(ours, packages))
    path = [*os.environ.get("PYTHONPATH", "").split(os.pathsep), *sys.path]
    entries = dict.fromkeys(Path(entry).absolute() for entry in path if entry)
    others = [
        Definitions(str(entry), _known_to(known, python_md5s(entry, packages)))
        for entry in entries
        if entry != ours
    ]
    for text in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
        if text and Path(text).is_dir() and Path(text).absolute() != ours:
            others.append(_definitions_by_text(Path(text), packages, known))
    return check_definitions(known, others)


def _known_to(ours: Definitions, md5s: Md5s) -> Md5s:
    return {name: md5 for name, md5 in md5s.items() if name in ours.md5s}


def _definitions_by_text(root: Path, packages: Iterable[str], ours: Definitions) -> Definitions:
    """md5s of the .msg and .srv texts in the ROS packages below `root`."""
    places: dict[str, str] = {}
    list_by_path("package.xml", str(root), places)
    search_path = {path.parent.name: [str(path)] for path in SYSTEM_DEFINITIONS.glob("*/msg")}
    search_path |= {name: [str(Path(place) / "msg")] for name, place in places.items()}
    md5s: Md5s = {}
    unreadable: list[str] = []
    for name in sorted(set(packages) & set(places)):
        for text in sorted([*Path(places[name]).glob("msg/*.msg"), *Path(places[name]).glob("srv/*.srv")]):
            full_name = f"{name}/{text.stem}"
            if full_name not in ours.md5s:
                continue
            try:
                md5s[full_name] = _md5_of_text(full_name, text, search_path)
            except genmsg.MsgNotFound as error:
                unreadable.append(f"{text} (no {error.package}/{error.base_type})")
            except (genmsg.InvalidMsgSpec, genmsg.MsgGenerationException, OSError) as error:
                unreadable.append(f"{text} ({error})")
    return Definitions(str(root), md5s, tuple(unreadable))


def _md5_of_text(full_name: str, text: Path, search_path: dict[str, list[str]]) -> str:
    context = genmsg.MsgContext.create_default()
    if text.suffix == ".srv":
        search_path = {
            **search_path,
            full_name.split("/")[0]: [str(text.parent), *search_path[full_name.split("/")[0]]],
        }
        spec = load_srv_by_type(context, full_name, search_path)
    else:
        spec = load_msg_by_type(context, full_name, search_path)
    load_depends(context, spec, search_path)
    return str(compute_md5(context, spec))


def announced_host() -> str:
    """What rospy nodes of this machine call themselves: ROS_HOSTNAME, ROS_IP, or the machine's name."""
    return str(rosgraph.network.get_host_name())


def bind_address() -> str:
    """Where rospy nodes of this machine listen."""
    return str(rosgraph.network.get_bind_address())


def check_apads(graph: Graph) -> Iterator[Finding]:
    """The aPads on the graph, of either generation, and whether they speak our definitions: asked of themselves."""
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
    ours = python_md5s(generated_folder(), ("apad", "auv_msgs", "misc_msgs"))
    for name, speech in sorted(found, key=lambda it: (it[0], it[1].known_by)):
        yield _check_md5s(graph, name, speech, ours)
        yield _check_offset(graph, f"{name}/position", name)


def _check_md5s(graph: Graph, name: str, speech: _Speech, ours: Md5s) -> Finding:
    differing, silent, same = [], [], []
    for part, type_name in {**speech.topics, **speech.services}.items():
        probe = service_md5 if part in speech.services else topic_md5
        try:
            md5 = probe(graph, f"{name}/{part}")
        except NotTold as error:
            silent.append(f"{part} ({error})")
            continue
        if md5 == ours[type_name]:
            same.append(f"{part} {md5}")
        elif part in speech.services and service_by_text(type_name, md5) is not None:
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
    return ok(name, f"an aPad with {speech.known_by}; speaks our definitions: {', '.join(same)}")


def _check_offset(graph: Graph, topic: str, name: str) -> Finding:
    """How far the aPad's clock is from this machine's, by the stamp of its next position."""
    try:
        offset_s = stamp_offset_s(graph, topic)
    except NotTold as error:
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
