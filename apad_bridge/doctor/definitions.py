"""Compares other packages' Python messages of our names by md5s, which it reads from their text without running them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from apad_bridge.doctor.finding import Finding, ok, warn

_MD5 = re.compile(r"""^\s+_md5sum = ["']([0-9a-f]{32})["']""", re.MULTILINE)
_TYPE = re.compile(r"""^\s+_type\s*= ["'](\w+/\w+)["']""", re.MULTILINE)
_MAX_LISTED = 3

Md5s = dict[str, str]
"""md5 by type, such as auv_msgs/NavSts."""


@dataclass(frozen=True, slots=True)
class Definitions:
    """One folder's definitions of types that we know too."""

    source: str
    md5s: Md5s
    unreadable: tuple[str, ...] = ()


def python_md5s(entry: Path, packages: Iterable[str]) -> Md5s:
    """Reads the md5s of generated modules under an entry of PYTHONPATH. It imports nothing: they may be of Python 2."""
    md5s: Md5s = {}
    for package in packages:
        for kind in ("msg", "srv"):
            for module in sorted((entry / package / kind).glob("_*.py")):
                text = module.read_text(errors="replace")
                # A service's module holds request and response first; its own md5 and type come last.
                types, sums = _TYPE.findall(text), _MD5.findall(text)
                if types and sums:
                    md5s[types[-1]] = sums[-1]
    return md5s


def check_definitions(ours: Definitions, others: Iterable[Definitions]) -> Iterator[Finding]:
    """Compares others' definitions of our types. They shadow nothing in musselbed's own processes; a live aPad decides."""
    others = list(others)
    for other in others:
        differing = sorted(name for name, md5 in other.md5s.items() if ours.md5s.get(name, md5) != md5)
        if differing:
            shown = ", ".join(
                f"{name} ({other.md5s[name]}, ours {ours.md5s[name]})" for name in differing[:_MAX_LISTED]
            )
            more = f" and {len(differing) - _MAX_LISTED} more" if len(differing) > _MAX_LISTED else ""
            yield warn(
                f"{other.source} differs from {ours.source} in {shown}{more}",
                "if your aPad speaks theirs (see the lines that begin with its name), put their texts into "
                "apad_bridge/ros/definitions and run launch_scripts/install; otherwise leave that workspace unsourced",
            )
        elif other.md5s:
            yield ok(f"{other.source} defines {len(other.md5s)} of our types, each as we do")
        if other.unreadable:
            yield warn(
                f"{other.source} holds what cannot be read: {', '.join(other.unreadable[:_MAX_LISTED])}",
                "mend that package, or take it off ROS_PACKAGE_PATH",
            )
    if not any(other.md5s or other.unreadable for other in others):
        yield ok("no other package on PYTHONPATH or ROS_PACKAGE_PATH defines our types")
