"""Rooms at the top of apad_bridge can leave: a copy without their folders and lines still flies, and nobody misses them."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from configparser import ConfigParser
from pathlib import Path

import pytest
from programs import ROOT, done

pytestmark = pytest.mark.system

WITHOUT_EDITABLE_FINDER = """import sys

sys.meta_path[:] = [it for it in sys.meta_path if not it.__module__.startswith("__editable__")]
"""
"""An editable installation would find the rooms in the checkout from which the copy was made."""


def read_setup(root: Path) -> ConfigParser:
    setup = ConfigParser()
    setup.read(root / "setup.cfg")
    return setup


def rooms_that_can_leave() -> list[str]:
    """The highest layer of the import contract: nothing in apad_bridge imports one of these, nor does another of them."""
    layers = read_setup(ROOT)["importlinter:contract:rooms"]["layers"].strip().splitlines()
    return [room.strip() for room in layers[0].split("|")]


def of_rooms(line: str) -> bool:
    return any(f"apad_bridge.{room}." in line for room in rooms_that_can_leave())


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tree without these rooms, their tests and their entry lines, installed by its metadata."""
    root = tmp_path_factory.mktemp("copy") / "musselbed"
    leaving = {
        f"{top}/{room}" for top in ("apad_bridge", "tests/apad_bridge") for room in rooms_that_can_leave()
    }
    leaving.add("runs")  # a demo's, with sockets that no copy takes

    def ignored(folder: str, names: list[str]) -> set[str]:
        inside = Path(folder).relative_to(ROOT)
        return {
            it for it in names if it.startswith((".", "__pycache__")) or (inside / it).as_posix() in leaving
        }

    shutil.copytree(ROOT, root, ignore=ignored)
    lines = (ROOT / "setup.cfg").read_text().splitlines()
    (root / "setup.cfg").write_text("\n".join(it for it in lines if not of_rooms(it)) + "\n")
    setup = read_setup(root)
    info = root / f"musselbed-{setup['metadata']['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Name: musselbed\nVersion: {setup['metadata']['version']}\n")
    groups = [f"[{group}]{lines}\n" for group, lines in setup["options.entry_points"].items()]
    (info / "entry_points.txt").write_text("\n".join(groups))
    (root / "sitecustomize.py").write_text(WITHOUT_EDITABLE_FINDER)
    return root


def run_in(copy: Path, *words: str) -> str:
    """The output of the copy's Python with these words; it must succeed."""
    return done(sys.executable, *words, cwd=copy, env={**os.environ, "PYTHONPATH": str(copy)}).stdout


def test_the_help_lists_no_command_of_a_room_that_left(copy: Path) -> None:
    listed = run_in(copy, "-m", "apad_bridge.commands.main", "--help")
    assert "\n  run " in listed and "\n  stop " in listed
    assert [
        it for it in ("study", "shadow", "imc", "layout", "foxglove", "ros2") if f"\n  {it} " in listed
    ] == []


def test_the_pool_flies_without_these_rooms_and_has_its_digest(copy: Path, tmp_path: Path) -> None:
    (stated,) = re.findall(
        r"(?m)^\| `pool-12.yaml` \| `(\w{16})` \|$", (ROOT / "docs/records.md").read_text()
    )
    flown = run_in(
        copy,
        "-m",
        "apad_bridge.commands.main",
        "run",
        "pool-12",
        "--time",
        "asap",
        "--out",
        str(tmp_path / "run"),
        "--json",
    )
    assert json.loads(flown)["digest"] == stated


def test_the_tests_of_mission_and_records_are_found_without_these_rooms(copy: Path) -> None:
    """The import contracts and the test below judge the packages; this judges what their tests need."""
    rooms = [f"tests/apad_bridge/{it}" for it in ("mission", "records")]
    collected = run_in(copy, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--collect-only", *rooms)
    assert all(f"{room}/test_" in collected for room in rooms)


def test_the_copy_finds_no_room_that_left(copy: Path) -> None:
    """Else the other tests here would show nothing."""
    names = [f"apad_bridge.{room}" for room in rooms_that_can_leave()]
    code = f"from importlib.util import find_spec; print([find_spec(it) for it in {names}])"
    assert run_in(copy, "-c", code) == f"{[None] * len(names)}\n"


def test_no_module_names_a_room_that_can_leave_as_a_text() -> None:
    """The import contracts find imports, in a `try` too; they do not find the text of a name that is imported later."""
    rooms = {ROOT / "apad_bridge" / room for room in rooms_that_can_leave()}
    sources = [it for top in ("agents", "apad_bridge", "firmware_model") for it in (ROOT / top).rglob("*.py")]
    outside = [it for it in sources if not rooms & set(it.parents)]
    assert [str(it) for it in outside if of_rooms(it.read_text())] == []
