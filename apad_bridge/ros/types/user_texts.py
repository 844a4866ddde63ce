"""Finds the texts of message definitions on this machine: the user's workspace before ours before Debian's."""

from __future__ import annotations

import os
from pathlib import Path

from rospkg.rospack import list_by_path  # type: ignore[import-untyped]

from apad_bridge.ros.types.generate import SYSTEM_DEFINITIONS
from apad_bridge.ros.types.messages import DEFINITIONS


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
