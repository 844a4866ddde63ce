"""Makes classes of services from the definitions in the user's workspace, where they differ from ours."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import genmsg
from genmsg.gentools import compute_full_text, compute_md5
from genmsg.msg_loader import load_depends, load_srv_from_file
from rospkg.rospack import list_by_path  # type: ignore[import-untyped]

from apad_bridge.ros.types.any_message import class_by_text
from apad_bridge.ros.types.generate import SYSTEM_DEFINITIONS
from apad_bridge.ros.types.messages import DEFINITIONS
from apad_bridge.scenario.lab_interface.fields import has


# Finds the texts of message definitions on this machine: the user's workspace before ours before Debian's.
def text_folders(kind: str = "msg") -> dict[str, list[str]]:
    """Folders of .msg (or, by `kind`, .srv) texts by package, the user's (on ROS_PACKAGE_PATH) first."""
    folders: dict[str, list[str]] = {}
    for root in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
        places: dict[str, str] = {}
        if root and Path(root).is_dir():
            list_by_path("package.xml", root, places)
        for name, place in places.items():
            _add(folders, name, Path(place) / kind)
    for definitions in (DEFINITIONS, SYSTEM_DEFINITIONS):
        for folder in sorted(definitions.glob(f"*/{kind}")):
            _add(folders, folder.parent.name, folder)
    return folders


def _add(folders: dict[str, list[str]], package: str, folder: Path) -> None:
    if folder.is_dir():
        folders.setdefault(package, []).append(str(folder))


def service_by_text(kind: str, md5: str) -> Any | None:
    """A service class of `kind` (such as misc_msgs/GetDockingInfo) with this md5, if a text on ROS_PACKAGE_PATH has it."""
    return next((it for it in _services(kind) if it._md5sum == md5), None)


def service_to_offer(ours: Any, read: Callable[[Any], object]) -> Any:
    """The class of an offered service: by the user's text of this type, if `read` can read its request, else ours.

    Callers have sourced that workspace and use its definition. The response needs a field `status`.
    """
    for theirs in _services(ours._type):
        if theirs._md5sum == ours._md5sum:
            break
        try:
            read(theirs._request_class())
        except AttributeError:
            continue
        if has(theirs._response_class(), "status"):
            return theirs
    return ours


def _services(kind: str) -> Iterator[Any]:
    """A class for every text that can be read, the user's first, then ours."""
    package, name = kind.split("/")
    messages = text_folders("msg")
    for folder in text_folders("srv").get(package, []):
        text = Path(folder) / f"{name}.srv"
        if not text.is_file():
            continue
        try:
            yield _service(kind, text, messages)
        except (genmsg.MsgNotFound, genmsg.InvalidMsgSpec, genmsg.MsgGenerationException, OSError):
            continue  # the live service cannot be of a text that is wrong


def _service(kind: str, text: Path, messages: dict[str, list[str]]) -> Any:
    context = genmsg.MsgContext.create_default()
    specification = load_srv_from_file(context, str(text), kind)
    load_depends(context, specification, messages)
    classes = [
        class_by_text(part.full_name, compute_full_text(context, part))
        for part in (specification.request, specification.response)
    ]
    name = kind.split("/")[1]
    members = {
        "_type": kind,
        "_md5sum": compute_md5(context, specification),
        "_request_class": classes[0],
        "_response_class": classes[1],
    }
    return type(name, (), members)
