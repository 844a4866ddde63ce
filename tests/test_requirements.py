"""The pinned packages of launch_scripts/requirements agree with the bounds of setup.cfg, and are whole.

Of Debian's Python the environment sees the modules that needed-packages.bash lists: ROS needs all of them, and no other.
"""

from __future__ import annotations

import ast
import configparser
import platform
import re
import subprocess
import sys
import sysconfig
import warnings
from collections.abc import Iterator
from fnmatch import fnmatch
from importlib.metadata import PackageNotFoundError, distribution, packages_distributions, version
from inspect import getmodulename
from modulefinder import ModuleFinder
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
SCRIPTS = ROOT / "launch_scripts"
PYTHONS = ("3.11", "3.13")
"""Of Debian 12 and Debian 13."""
HERE = ".".join(platform.python_version_tuple()[:2])
PIN = re.compile(r"([\w.-]+)==([\w.]+) --hash=sha256:[0-9a-f]{64}")
PURPOSES = {"run": [], "mu": ["mu"], "test": ["mu", "test"]}
"""The extras beside those of a run."""


def pins(python: str, purpose: str) -> dict[str, str]:
    """The versions that a file pins, by canonical name; a line that is neither pin, comment nor another file fails."""
    found: dict[str, str] = {}
    for line in (SCRIPTS / f"requirements/{python}/{purpose}.txt").read_text().splitlines():
        if line.startswith("#"):
            continue
        if line.startswith("-r "):
            found |= pins(python, line.removeprefix("-r ").removesuffix(".txt"))
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
    return named[1].split(",") + PURPOSES[purpose]


def bounds(python: str, purpose: str) -> Iterator[Requirement]:
    """What setup.cfg asks for on a Python, with the extras that the installer brings."""
    setup = configparser.ConfigParser()
    setup.read(ROOT / "setup.cfg")
    texts = [
        setup["options"]["install_requires"],
        *map(setup["options.extras_require"].get, extras(purpose)),
    ]
    for text in texts:
        for it in map(Requirement, filter(None, (text or "").splitlines())):
            if it.marker is None or it.marker.evaluate({"python_version": python}):
                yield it


def needed(python: str, purpose: str) -> Iterator[tuple[str, Requirement]]:
    """(who asks, what for) of all that the bounds lead to on a Python, by the metadata of the packages installed here.

    A package that only that Python needs, and that is not installed here, is asked for without its own needs.
    """
    waiting = [("setup.cfg", it) for it in bounds(python, purpose)]
    done: set[tuple[str, frozenset[str]]] = set()
    while waiting:
        who, wanted = waiting.pop()
        yield who, wanted
        key = (canonicalize_name(wanted.name), frozenset(wanted.extras))
        if key in done:
            continue
        done.add(key)
        try:
            needs = distribution(wanted.name).requires or ()
        except PackageNotFoundError:
            assert python != HERE, f"{wanted.name} is not installed"
            continue
        there = {"python_version": python, "python_full_version": f"{python}.0"}
        for it in map(Requirement, needs):
            if it.marker is None or any(
                it.marker.evaluate({"extra": extra, **there}) for extra in ("", *wanted.extras)
            ):
                waiting.append((wanted.name, it))


@pytest.mark.parametrize("purpose", PURPOSES)
@pytest.mark.parametrize("python", PYTHONS)
def test_what_setup_cfg_asks_for_is_pinned_within_its_bounds_and_so_is_what_that_needs(
    python: str, purpose: str
) -> None:
    pinned = pins(python, purpose)
    asked = set()
    for who, wanted in needed(python, purpose):
        name = canonicalize_name(wanted.name)
        asked.add(name)
        assert name in pinned, f"{who} needs {wanted}: launch_scripts/make-lock"
        assert pinned[name] in wanted.specifier, f"{who} needs {wanted}: launch_scripts/make-lock"
    if python == HERE:
        # Nothing asks for setuptools: it makes the package of musselbed itself.
        assert set(pinned) - asked == {"setuptools"}


def test_both_pythons_have_the_same_versions_where_both_need_a_package() -> None:
    first, second = (pins(python, "test") for python in PYTHONS)
    assert {name: first[name] for name in first.keys() & second.keys()} == {
        name: second[name] for name in first.keys() & second.keys()
    }


def test_the_pythons_of_the_lock_are_those_that_are_tested_here() -> None:
    named = re.search(
        r'^pinned_pythons="(.*)"$', (SCRIPTS / "needed-packages.bash").read_text(), re.MULTILINE
    )
    assert named and tuple(named[1].split()) == PYTHONS
    assert sorted(it.name for it in (SCRIPTS / "requirements").iterdir()) == sorted(PYTHONS)


@pytest.mark.skipif(
    platform.machine() != "x86_64" or HERE not in PYTHONS, reason="no versions are pinned for this machine"
)
def test_the_installer_has_brought_the_pinned_versions() -> None:
    assert {name: version(name) for name in pins(HERE, "test")} == pins(HERE, "test")


DEBIAN = Path("/usr/lib/python3/dist-packages")
LEFT_OUT = ("paramiko",)
"""roslaunch imports it to start nodes on other machines. Debian's own roslaunch does that, not one in the environment."""


def listed(name: str) -> set[str]:
    """The words of a list in needed-packages.bash. Those of `debian_modules` that end in -info are of metadata."""
    text = (SCRIPTS / "needed-packages.bash").read_text()
    found = re.search(rf"^{name}=\((.*?)^\)$", text, re.MULTILINE | re.DOTALL)
    assert found
    return set(re.sub(r"#.*|'", "", found[1]).split())


def module_names(folder: Path) -> set[str]:
    """The names of all modules in a folder: packages, with or without __init__.py, files and compiled ones."""
    return {getmodulename(it.name) or it.name for it in folder.iterdir()} - {"__pycache__"}


def imports_of_our_code() -> Iterator[str]:
    for folder in ("agents", "apad_bridge", "firmware_model", "benchmarks", "tests"):
        for file in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Import):
                    yield from (it.name for it in node.names)
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    yield node.module


def test_the_list_of_debians_modules_is_that_which_ros_and_our_code_import() -> None:
    """ROS is the Python packages of Debian's that the installer names: users' own nodes import them in the environment.

    Imports within functions count: rospy imports netifaces when it looks for this machine's address.
    """
    ros = {it.removeprefix("python3-").replace("-", "_") for it in listed("debian_packages")}
    pinned = module_names(Path(sysconfig.get_path("purelib")))
    finder = ModuleFinder(path=[str(DEBIAN)], excludes=[*pinned, *LEFT_OUT])
    of_debian = module_names(DEBIAN) - pinned - sys.stdlib_module_names
    bringing = packages_distributions()
    with warnings.catch_warnings(action="ignore"):  # of Debian's code, as it is compiled
        for name in sorted({*ros, *imports_of_our_code()}):
            if name.partition(".")[0] in of_debian:
                finder.import_hook(name)
    imported = {name.partition(".")[0] for name in finder.modules} & of_debian
    patterns = {it for it in listed("debian_modules") if not it.endswith("-info")}
    assert {it for it in imported if not any(fnmatch(it, pattern) for pattern in patterns)} == set()
    assert {it for it in patterns if not any(fnmatch(name, it) for name in imported)} == set()
    assert {it for it in pinned if any(fnmatch(it, pattern) for pattern in patterns)} == set()
    from_pins = {name.partition(".")[0] for name in finder.badmodules} & pinned
    assert "yaml" in from_pins
    brought = {
        it for it in from_pins if {*map(canonicalize_name, bringing[it])} & pins(PYTHONS[0], "run").keys()
    }
    assert from_pins - brought == set()


@pytest.mark.skipif(Path(sys.prefix) != ROOT / ".venv", reason="these tests do not run in an installed .venv")
def test_the_environment_sees_nothing_else_of_debians_python() -> None:
    look = (
        "import sys, importlib.metadata as it; print(*sys.path[1:], sep='\\n'); print(); "
        "print(*{str(found.locate_file('')) + ' ' + found.name for found in it.distributions()}, sep='\\n')"
    )
    printed = subprocess.run(
        [sys.executable, "-I", "-c", look], capture_output=True, text=True, check=True, timeout=60
    ).stdout
    path, distributions = (part.splitlines() for part in printed.split("\n\n"))
    assert [it for it in path if "dist-packages" in it] == []
    links = Path(sys.prefix) / "share/musselbed/debian"
    assert path[-1] == str(links)
    assert {it.name for it in links.iterdir() if it.name != "__pycache__"} == {
        it.name
        for it in DEBIAN.iterdir()
        for pattern in listed("debian_modules")
        if fnmatch(it.name, pattern) or fnmatch(str(getmodulename(it.name)), pattern)
    }
    elsewhere = {it.rpartition(" ")[2] for it in distributions if it.startswith(str(links))}
    assert elsewhere == {it.partition("-")[0] for it in listed("debian_modules") if it.endswith("-info")}
