"""Checks for `musselbed doctor` that need ROS's libraries: its packages, our messages, and other definitions."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import genmsg
import rosgraph.network
from genmsg.gentools import compute_md5
from genmsg.msg_loader import load_depends, load_msg_by_type, load_srv_by_type
from rospkg.rospack import list_by_path  # type: ignore[import-untyped]

from apad_bridge.doctor.definitions import Definitions, Md5s, check_definitions, python_md5s
from apad_bridge.doctor.finding import Check, Finding, fail, ok
from apad_bridge.ros.types.generate import SYSTEM_DEFINITIONS
from apad_bridge.ros.types.messages import (
    DEFINITIONS,
    MessagesUnusable,
    generated_folder,
    use_generated_messages,
)

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
"""Imported packages, and the Debian package of each."""


def check_ros_packages() -> Iterator[Finding]:
    for name, debian in _PACKAGES.items():
        try:
            module = importlib.import_module(name)
        except ImportError as error:
            yield fail(
                f"cannot be imported: {error}",
                f"apt-get install {debian}, or run launch_scripts/install",
                check=name,
            )
            continue
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            version = "importable"
        yield ok(f"{version} in {Path(str(module.__file__)).parent}", check=name)


def check_messages() -> Finding:
    try:
        folder = use_generated_messages()
    except MessagesUnusable as error:
        found, _, mend = str(error).rpartition(": ")
        return fail(found, mend)
    return ok(f"generated and current, in {folder}")


def check_other_definitions() -> Iterator[Finding]:
    """Compares ours with those in the user's workspaces, by this shell's environment."""
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
    """The md5s of the .msg and .srv texts in the ROS packages below `root`."""
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
    """The host name of this machine's rospy nodes: ROS_HOSTNAME, ROS_IP, or the machine's name."""
    return str(rosgraph.network.get_host_name())


def bind_address() -> str:
    """The address at which rospy nodes of this machine listen."""
    return str(rosgraph.network.get_bind_address())


CHECKS: tuple[Check[None], ...] = (
    Check("ROS packages", lambda _: check_ros_packages()),
    Check("messages", lambda _: check_messages()),
    Check("definitions", lambda _: check_other_definitions()),
)
