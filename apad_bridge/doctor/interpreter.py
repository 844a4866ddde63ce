"""Checks this Python, its packages, and other packages that shadow ours, such as another `agents`, or theirs."""

from __future__ import annotations

import importlib.metadata
import os
import re
import sys
import sysconfig
from collections import Counter
from collections.abc import Iterable, Iterator
from importlib.machinery import PathFinder
from importlib.util import find_spec
from inspect import getmodulename
from pathlib import Path

from apad_bridge.doctor.finding import Check, Finding, fail, ok, warn
from firmware_model.entry_points import in_one_line

INSTALL = "run launch_scripts/install"
OUR_PACKAGES = ("agents", "apad_bridge", "firmware_model")
DEBIAN_PYTHON = Path("/usr/bin/python3")
DEBIAN_PACKAGES = Path("/usr/lib/python3/dist-packages")
OUR_ROOT = Path(__file__).parents[2]
"""The folder of this code: the clone, or site-packages."""

NUMPY_FROM, NUMPY_BELOW = (1, 26, 4), (2, 3)
"""Debian's messages call ndarray.tostring for rospy.numpy_msg, and numpy 2.3 removed it. Python 3.14 has no such numpy."""


def check_python(
    executable: Path | None = None, environment: Path | None = None, debian: Path = DEBIAN_PYTHON
) -> list[Finding]:
    """Checks the interpreter under the virtual environment `environment`; both are the running ones by default."""
    executable = executable or Path(getattr(sys, "_base_executable", sys.executable))
    environment = environment or Path(sys.prefix)
    version = ".".join(map(str, sys.version_info[:3]))
    if not debian.exists() or executable.resolve() != debian.resolve():
        return [
            fail(
                f"{version} of {executable}, which does not see Debian's rospy",
                f"{INSTALL}, which uses {debian}",
            )
        ]
    settings = environment / "pyvenv.cfg"
    if not settings.exists():
        return [
            warn(
                f"{version} of Debian, in no virtual environment",
                f"{INSTALL} and use .venv/bin/musselbed",
            )
        ]
    if PathFinder.find_spec("rospy") is None:
        return [fail(f"{environment} does not see Debian's rospy", INSTALL)]
    if re.search(r"^include-system-site-packages\s*=\s*true\s*$", settings.read_text(), re.MULTILINE):
        every = "sees all Python packages of Debian's, and each may shadow a pinned one"
        return [warn(f"{environment} {every}", f"{INSTALL}, which mends .venv")]
    return [ok(f"{version} of Debian, with its ROS, in {environment}")]


def check_packages(distribution: str = "musselbed") -> Iterator[Finding]:
    """Checks the packages that setup.cfg requires, as this installation recorded them."""
    try:
        required = importlib.metadata.requires(distribution) or []
    except importlib.metadata.PackageNotFoundError:
        yield fail(f"{distribution} is not installed in {sys.prefix}", INSTALL)
        return
    for line in required:
        if "extra ==" in line or not _is_of_this_python(line):
            continue
        name = re.split(r"[^A-Za-z0-9_.-]", line, maxsplit=1)[0]
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            yield fail("is not installed", INSTALL, check=name)
            continue
        yield check_numpy(version) if name == "numpy" else ok(version, check=name)


def check_parts_of_others() -> Iterator[Finding]:
    """Names the packages that bring a part: they are trusted, fly along, and are loaded here.

    A sensor of one that is refused is a fault, because it keeps every fleet of whole boards from flying.
    """
    # Imported here: this module must not need a package that another one shadows.
    from firmware_model.entry_points import MEND, entry_points, parts_of_others

    found = "; ".join(f"{package}: {parts}" for package, parts in parts_of_others().items())
    yield ok(found or "none")
    for group in ("strategies", "codecs", "commands"):
        brought = entry_points(f"musselbed.{group}")
        for name, count in Counter(it.name for it in brought).items():
            if count > 1:
                packages = ", ".join(sorted(it.brought_by for it in brought if it.name == name))
                yield warn(f"{name} is in each of {packages}", "uninstall one of them", check=group)
        # Ours are loaded by whoever needs them: the doctor needs none.
        for it in (it for it in brought if not it.module.startswith("apad_bridge.")):
            try:
                it.load()
            except (Exception, SystemExit) as error:
                told = f"{it.name} of {it.brought_by} cannot be loaded: {in_one_line(error)}"
                yield warn(told, MEND, check=group)
    try:
        from firmware_model.power import rails  # noqa: F401
    except ImportError as error:
        yield fail(str(error).removesuffix(f": {MEND}"), MEND, check="sensors")


def _is_of_this_python(line: str) -> bool:
    """False for a requirement of Pythons below or from a version on, of which this is none."""
    marker = re.search(r'python_version\s*(<|>=)\s*"3\.(\d+)"', line)
    return marker is None or (sys.version_info.minor < int(marker[2])) is (marker[1] == "<")


def check_numpy(version: str, python: tuple[int, int] = sys.version_info[:2]) -> Finding:
    numbers = tuple(int(part) for part in re.findall(r"\d+", version)[:3])
    if NUMPY_FROM <= numbers < NUMPY_BELOW:
        return ok(version, check="numpy")
    if python >= (3, 14) and numbers >= NUMPY_BELOW:
        return warn(
            f"{version}: publishing by rospy.numpy_msg fails with it", "publish lists instead", check="numpy"
        )
    return fail(
        f"{version} does not go with Debian's rospy (1.26.4 or later, below 2.3)", INSTALL, check="numpy"
    )


def check_pinned(site: Path | None = None) -> Iterator[Finding]:
    """Checks that the packages in `site`, the environment's own folder of them by default, are those that are imported."""
    site = site or Path(sysconfig.get_path("purelib"))
    taken: dict[Path, list[str]] = {}
    for name in sorted(_modules_in(site)):
        if (elsewhere := _imported_from_elsewhere(name, site)) is not None:
            taken.setdefault(elsewhere, []).append(name)
    for elsewhere, names in taken.items():
        found = f"{', '.join(names)} would be imported from {elsewhere}, and not from {site}"
        yield fail(found, _removal(elsewhere))
    if not taken:
        yield ok(f"none of {site}")


def _modules_in(folder: Path) -> set[str]:
    """Names of packages and modules, without those of the standard library, which always come first."""
    entries = folder.iterdir() if folder.is_dir() else ()
    names = {getmodulename(it.name) or it.name for it in entries} - sys.stdlib_module_names
    return {it for it in names if it.isidentifier() and it != "__pycache__"}


def _imported_from_elsewhere(name: str, folder: Path) -> Path | None:
    """The folder from which a module is, or would be, imported; None if it is `folder`.

    A package without an __init__.py may be in several folders: None if `folder` is one of them.
    """
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    places = spec.submodule_search_locations or ([spec.origin] if spec.has_location and spec.origin else [])
    parents = [Path(it).parent for it in places]
    return None if folder in parents or not parents else parents[0]


def check_shadows(
    path: Iterable[str] | None = None, root: Path = OUR_ROOT, here: Path | None = None
) -> Iterator[Finding]:
    """Checks for other packages of our names, on the entries of `path` (sys.path by default) or in the folder `here`.

    `here` counts because Python looks there first in a child that is started as a module.
    """
    here = here or Path.cwd()
    entries = [Path(entry) if entry else here for entry in (sys.path if path is None else path)]
    for name in OUR_PACKAGES:
        if earlier := _foreign(name, [here], root):
            yield fail(
                f"{earlier[0]} would be taken for musselbed's",
                f"run musselbed in another folder than {here}",
                check=name,
            )
            continue
        ours = entries.index(root) if root in entries else len(entries)
        first, later = _foreign(name, entries[:ours], root), _foreign(name, entries[ours:], root)
        if first and ours < len(entries):
            yield fail(f"{first[0]} comes before {root / name}", _removal(first[0]), check=name)
        elif first or later:
            yield warn(
                f"{root / name} is used; {(first or later)[0]} is another package of that name",
                _removal((first or later)[0]),
                check=name,
            )
        else:
            yield ok(str(root / name), check=name)


def _foreign(name: str, entries: Iterable[Path], root: Path) -> list[Path]:
    found = []
    for entry in entries:
        for candidate in (entry / name / "__init__.py", entry / f"{name}.py"):
            if candidate.exists() and not candidate.resolve().is_relative_to(root.resolve() / name):
                found.append(candidate)
    return found


def _removal(module: Path) -> str:
    listed = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    for entry in listed:
        if module.is_relative_to(entry):
            return f"take {entry} off PYTHONPATH"
    if module.is_relative_to(DEBIAN_PACKAGES):
        return INSTALL
    return "uninstall the package it belongs to from this environment, or give musselbed one of its own"


CHECKS: tuple[Check[None], ...] = (
    Check("python", lambda _: check_python()),
    Check("packages", lambda _: check_packages()),
    Check("packages of others", lambda _: check_parts_of_others()),
    Check("our packages", lambda _: check_shadows()),
    Check("shadowed packages", lambda _: check_pinned()),
)
