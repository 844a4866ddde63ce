"""The pinned packages of launch_scripts/requirements agree with the bounds of setup.cfg, and are whole."""

from __future__ import annotations

import configparser
import platform
import re
from collections.abc import Iterator
from importlib.metadata import distribution, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
SCRIPTS = ROOT / "launch_scripts"
PIN = re.compile(r"([\w.-]+)==([\w.]+) --hash=sha256:[0-9a-f]{64}")
PURPOSES = ("run", "test")


def pins(purpose: str) -> dict[str, str]:
    """The versions that a file pins, by canonical name; a line that is neither pin, comment nor another file fails."""
    found: dict[str, str] = {}
    for line in (SCRIPTS / f"requirements/{purpose}.txt").read_text().splitlines():
        if line.startswith("#"):
            continue
        if line.startswith("-r "):
            found |= pins(line.removeprefix("-r ").removesuffix(".txt"))
            continue
        pin = PIN.fullmatch(line)
        assert pin, line
        name = canonicalize_name(pin[1])
        assert name not in found, f"{name} is pinned twice"
        found[name] = pin[2]
    return found


def extras(purpose: str) -> list[str]:
    named = re.search(r"^extras=(.*)$", (SCRIPTS / "needed-packages.bash").read_text(), re.MULTILINE)
    assert named
    return named[1].split(",") + (["test"] if purpose == "test" else [])


def bounds(purpose: str) -> Iterator[Requirement]:
    """What setup.cfg asks for, with the extras that the installer brings."""
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    texts = [
        setup["options"]["install_requires"],
        *map(setup["options.extras_require"].get, extras(purpose)),
    ]
    for text in texts:
        yield from map(Requirement, filter(None, (text or "").splitlines()))


def needed(purpose: str) -> Iterator[tuple[str, Requirement]]:
    """(who asks, what for) of all that the bounds lead to, by the metadata of the packages that are installed here."""
    waiting = [("setup.cfg", it) for it in bounds(purpose)]
    done: set[tuple[str, frozenset[str]]] = set()
    while waiting:
        who, wanted = waiting.pop()
        yield who, wanted
        key = (canonicalize_name(wanted.name), frozenset(wanted.extras))
        if key in done:
            continue
        done.add(key)
        for it in map(Requirement, distribution(wanted.name).requires or ()):
            if it.marker is None or any(
                it.marker.evaluate({"extra": extra}) for extra in ("", *wanted.extras)
            ):
                waiting.append((wanted.name, it))


@pytest.mark.parametrize("purpose", PURPOSES)
def test_what_setup_cfg_asks_for_is_pinned_within_its_bounds_and_so_is_what_that_needs(purpose: str) -> None:
    pinned = pins(purpose)
    asked = set()
    for who, wanted in needed(purpose):
        name = canonicalize_name(wanted.name)
        asked.add(name)
        assert name in pinned, f"{who} needs {wanted}: launch_scripts/make-lock"
        assert pinned[name] in wanted.specifier, f"{who} needs {wanted}: launch_scripts/make-lock"
    # Nothing asks for setuptools: it makes the package of musselbed itself.
    assert set(pinned) - asked == {"setuptools"}


@pytest.mark.skipif(platform.machine() != "x86_64", reason="the versions are pinned for x86-64")
def test_the_installer_has_brought_the_pinned_versions() -> None:
    assert {name: version(name) for name in pins("test")} == pins("test")
