"""The table of names: current in the docs, equal to the legacy stack's without a namespace, and the only place of names."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from apad_bridge.ros_names.frames import Frames
from apad_bridge.ros_names.names import beside_others, in_full, of_amussel, of_apad, ours, ours_of_apad
from apad_bridge.ros_names.names_table import GLOBAL, SECTIONS

ROOT = Path(__file__).parents[3]
ROWS = [row for section in SECTIONS for row in section.rows]


def test_no_name_stands_twice() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS)


def test_only_what_a_master_has_once_is_global() -> None:
    assert {row.name for row in ROWS if row.name.startswith("/")} == {row.name for row in GLOBAL.rows}
    assert {row.name for row in GLOBAL.rows} == {
        "/clock",
        "/clock_reached",
        "/use_sim_time",
        "/tf",
        "/tf_static",
        "/diagnostics",
        "/battery_alert",
    }


@pytest.mark.parametrize(
    ("namespace", "name", "full"),
    [
        # Without a namespace names are those of the legacy stack.
        ("", of_amussel(24, "position"), "/amussel24/position"),
        ("", of_amussel(24, "battery_level"), "/amussel24/battery_level"),
        ("", of_amussel(24, "position_static"), "/amussel24/position_static"),
        ("", of_amussel(24, "charge_info"), "/amussel24/charge_info"),
        ("", of_apad("apad1", "action_server"), "/apad1/action_server"),
        ("", of_apad("apad1", "commander/primitive/go2point"), "/apad1/commander/primitive/go2point"),
        ("", ours("beliefs"), "/musselbed/beliefs"),
        ("", ours_of_apad("apad1", "take_over"), "/musselbed/apad1/take_over"),
        # A namespace comes before every name but a global one.
        ("lab/basin", ours("claims"), "/lab/basin/musselbed/claims"),
        ("basin", of_apad("apad1", "position"), "/basin/apad1/position"),
        ("basin", of_apad("/apad1", "position"), "/apad1/position"),
        ("basin", ours_of_apad("/apad1", "dock"), "/basin/musselbed/apad1/dock"),
        ("basin", "/clock", "/clock"),
    ],
)
def test_a_name_in_full(namespace: str, name: str, full: str) -> None:
    assert in_full(namespace, name) == full


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        (ours, ("belief",)),
        (of_amussel, (1, "depth")),
        (of_apad, ("apad1", "dock")),
        (ours_of_apad, ("apad1", "position")),
    ],
)
def test_what_is_not_in_the_table_has_no_name(
    name: Callable[..., str], arguments: tuple[object, ...]
) -> None:
    with pytest.raises(KeyError, match="not in the table"):
        name(*arguments)


@pytest.mark.parametrize(
    ("frame", "name"),
    [
        (Frames().enu, "musselbed/enu"),
        (Frames().agent(7), "amussel7/base_link"),
        (Frames().apad("apad1"), "apad1/base_link"),
        (Frames("lab/basin").ned, "lab/basin/musselbed/ned"),
        (Frames("lab/basin").agent(7), "lab/basin/amussel7/base_link"),
        (Frames("lab/basin").apad("apad1"), "lab/basin/apad1/base_link"),
        (Frames("lab/basin").apad("/apad1"), "apad1/base_link"),
    ],
)
def test_frames_carry_the_namespace_without_a_slash_before_it(frame: str, name: str) -> None:
    assert frame == name


def test_of_several_supervisors_each_has_all_but_what_is_common() -> None:
    moved = dict(mapping.split(":=") for mapping in beside_others("apad2"))
    assert moved["musselbed/beliefs"] == "musselbed/apad2/beliefs"
    assert moved["musselbed/spawn"] == "musselbed/apad2/spawn"
    assert not {"musselbed/claims", "musselbed/heard", "musselbed/said"} & moved.keys()


NAMED = re.compile(
    r"/?(?:musselbed/[a-z_]+|amussel\d*/[a-z_]+|(?<=/)(?:clock|tf|tf_static|diagnostics|use_sim_time))"
)


def literals(path: Path) -> Iterator[tuple[int, str]]:
    """Yields every text in a module that is not a docstring, and each part of an f-string by itself."""
    tree = ast.parse(path.read_text())
    docstring_ids = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstring_ids:
            yield node.lineno, node.value


def test_no_name_is_written_anywhere_else() -> None:
    found = []
    for path in sorted((ROOT / "apad_bridge" / "ros").glob("*.py")):
        if path.name not in ("names_table.py", "frames.py"):
            found += [f"{path.name}:{line}: {text}" for line, text in literals(path) if NAMED.fullmatch(text)]
    assert found == []


def test_the_search_for_names_finds_some() -> None:
    found = [
        text for _, text in literals(ROOT / "apad_bridge/ros_names/names_table.py") if NAMED.fullmatch(text)
    ]
    assert len(found) > 20
