"""Parts that packages bring by entry points: rooms of ours that can leave, and a stranger's packages.

The packages' metadata are read here, because importing importlib.metadata takes as long as all else that a help needs. This
module needs no other of ours, so the doctor can name a package whose part cannot be loaded.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from itertools import takewhile
from typing import Any, NamedTuple

MEND = "mend that package or uninstall it"
"""The mend for a part that is refused."""


class EntryPoint(NamedTuple):
    """A module, or `module:name` in one, that an installed package brings under a name; a room of ours counts as one."""

    package: str
    name: str
    module: str
    metadata: str = ""
    """The folder of the package's metadata."""

    @property
    def line(self) -> str:
        """The first line of the module's docstring without the command, read and not executed; empty without one."""
        from importlib.util import find_spec

        package, *rest = self.module.split(".")
        with suppress(OSError, ValueError):
            if (spec := find_spec(package)) is None or spec.origin is None:
                return ""
            path = os.path.join(os.path.dirname(spec.origin), *rest) + ".py" if rest else spec.origin
            with open(path, encoding="utf-8") as file:
                first = file.readline().strip()
            return first.strip('".').rpartition("`: ")[2] if first.startswith('"""') else ""
        return ""

    @property
    def brought_by(self) -> str:
        """The package with its version, such as `lab_codec 1.2`; its name alone where its metadata cannot be read."""
        path = os.path.join(self.metadata, "METADATA")
        with suppress(OSError, KeyError), open(path, encoding="utf-8") as file:
            head = dict(it.strip().partition(": ")[::2] for it in takewhile(str.strip, file))
            return f"{head['Name']} {head['Version']}"
        return self.package

    def load(self) -> Any:
        """The module, or what it names in it. It raises what the module raises."""
        module, _, name = self.module.partition(":")
        return getattr(import_module(module), name) if name else import_module(module)


def in_one_line(error: BaseException) -> str:
    """The type and the text of an error of a package's part or of a user's own; the text may have any number of lines."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def entry_points(group: str) -> list[EntryPoint]:
    """The entry points of this group, by package and name. Of two versions of a package the first on the path counts."""
    found = {}
    for folder in reversed(sys.path):
        for metadata, text in _metadata_in(folder):
            found[os.path.basename(metadata).rpartition(".")[0].partition("-")[0]] = metadata, text
    return sorted(
        it
        for package, (metadata, text) in found.items()
        for it in _entries_of(package, metadata, text, group)
    )


def package_to_blame(error: BaseException) -> str | None:
    """The package, with its version, whose own file an error comes from, if it brings a part; None for another error."""
    from traceback import walk_tb

    files = {os.path.normpath(frame.f_code.co_filename) for frame, _ in walk_tb(error.__traceback__)}
    for folder in sys.path:
        for metadata, text in _metadata_in(folder):
            if "[musselbed." in text and not os.path.basename(metadata).startswith("musselbed-"):
                with suppress(OSError), open(os.path.join(metadata, "RECORD"), encoding="utf-8") as record:
                    if any(os.path.join(folder, line.partition(",")[0]) in files for line in record):
                        return EntryPoint("", "", "", metadata).brought_by
    return None


def _metadata_in(folder: str) -> Iterator[tuple[str, str]]:
    """Yields the metadata's folder and the text of entry points of each package installed in this folder of the path."""
    with suppress(OSError):
        for info in os.listdir(folder):
            if info.endswith((".dist-info", ".egg-info")):
                with (
                    suppress(OSError),
                    open(os.path.join(folder, info, "entry_points.txt"), encoding="utf-8") as file,
                ):
                    yield os.path.join(folder, info), file.read()


def _entries_of(package: str, metadata: str, text: str, group: str) -> Iterator[EntryPoint]:
    section = text.partition(f"[{group}]\n")[2].partition("\n[")[0]
    for line in section.splitlines():
        name, is_entry, module = (it.strip() for it in line.partition("="))
        if is_entry:
            root, *rooms = module.split(".")
            yield EntryPoint(rooms[0] if root == "apad_bridge" else package, name, module, metadata)


def parts_of_others() -> dict[str, str]:
    """The parts that installed packages bring to musselbed, as `{"lab_codec 1.2": "codecs lines"}`."""
    from importlib.metadata import distributions  # an agent's process needs neither

    found: dict[str, set[str]] = {}
    for package in distributions():
        for entry in package.entry_points:
            if entry.group.startswith("musselbed.") and package.name != "musselbed":
                part = f"{entry.group.removeprefix('musselbed.')} {entry.name}"
                found.setdefault(f"{package.name} {package.version}", set()).add(part)
    return {package: ", ".join(sorted(parts)) for package, parts in sorted(found.items())}
