"""Modules that packages bring to the command line by entry points: rooms of ours that can leave, and a stranger's packages.

The packages' metadata are read here, because importing importlib.metadata takes as long as all else that a help needs.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from typing import Any, NamedTuple


class EntryPoint(NamedTuple):
    """A module that an installed package brings under a name; a room of ours counts as a package."""

    package: str
    name: str
    module: str

    @property
    def line(self) -> str:
        """The first line of the module's docstring without the command, read and not executed; empty without one."""
        package, *rest = self.module.split(".")
        with suppress(OSError, ValueError):
            if (spec := find_spec(package)) is None or spec.origin is None:
                return ""
            path = os.path.join(os.path.dirname(spec.origin), *rest) + ".py" if rest else spec.origin
            with open(path, encoding="utf-8") as file:
                first = file.readline().strip()
            return first.strip('".').rpartition("`: ")[2] if first.startswith('"""') else ""
        return ""

    def load(self) -> Any:
        return import_module(self.module)


def entry_points(group: str) -> list[EntryPoint]:
    """The entry points of this group, by package and name. Of two versions of a package the first on the path counts."""
    found = {}
    for folder in reversed(sys.path):
        for package, text in _metadata_in(folder):
            found[package] = text
    return sorted(it for package, text in found.items() for it in _entries_of(package, text, group))


def _metadata_in(folder: str) -> Iterator[tuple[str, str]]:
    """Yields the name and the text of entry points of each package that is installed in this folder of the path."""
    with suppress(OSError):
        for info in os.listdir(folder):
            if info.endswith((".dist-info", ".egg-info")):
                with (
                    suppress(OSError),
                    open(os.path.join(folder, info, "entry_points.txt"), encoding="utf-8") as file,
                ):
                    yield info.rpartition(".")[0].partition("-")[0], file.read()


def _entries_of(package: str, text: str, group: str) -> Iterator[EntryPoint]:
    section = text.partition(f"[{group}]\n")[2].partition("\n[")[0]
    for line in section.splitlines():
        name, is_entry, module = (it.strip() for it in line.partition("="))
        if is_entry:
            root, *rooms = module.split(".")
            yield EntryPoint(rooms[0] if root == "apad_bridge" else package, name, module)
