"""The rules of the house that a machine can check: which way imports run, who may know ROS, types and style."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from apad_bridge.ros.types.messages import DEFINITIONS
from apad_bridge.vehicle.guards import gate
from apad_bridge.vehicle.vehicle_link import Cleared

ROOT = Path(__file__).parents[1]
ROOMS = ("firmware_model", "agents", "apad_bridge")
ROS = {
    "rospy",
    "rosgraph",
    "rosmaster",
    "roslaunch",
    "rosnode",
    "rosservice",
    "rostopic",
    "rosparam",
    "rosbag",
    "actionlib",
}
ROS |= {"genpy", "genmsg", "std_msgs", "std_srvs", "geometry_msgs", "actionlib_msgs", "rosgraph_msgs"}
ROS |= {folder.name for folder in DEFINITIONS.iterdir()}


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """All nodes of a file's syntax tree, which several rules look at."""
    return list(ast.walk(ast.parse(path.read_text())))


def imported_names(path: Path) -> set[str]:
    """The first part of every absolute import, wherever in the file it stands."""
    names: set[str] = set()
    for node in nodes_of(path):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.add(node.module.split(".")[0])
    return names


def files_that_import(names: set[str]) -> Iterator[Path]:
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            if imported_names(path) & names:
                yield path.relative_to(ROOT)


def test_a_counterpart_imports_nothing_of_ours() -> None:
    """A stranger's vehicle shows an assumption of ours only where it does not share it."""
    paths = list((ROOT / "tests" / "counterparts").glob("*/**/*.py"))
    assert paths and [str(it) for it in paths if imported_names(it) & set(ROOMS)] == []


def run_tool(*command: str) -> None:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_only_the_ros_room_knows_ros() -> None:
    strangers = [str(path) for path in files_that_import(ROS) if path.parts[:2] != ("apad_bridge", "ros")]
    assert strangers == []


@pytest.mark.parametrize("library", ["serial", "imcpy", "foxglove"])
def test_one_file_at_most_imports(library: str) -> None:
    assert len(list(files_that_import({library}))) <= 1


def test_no_process_of_ours_reads_pickles() -> None:
    assert list(files_that_import({"pickle", "shelve", "dill", "cloudpickle"})) == []


def test_only_the_plugin_of_firmware_model_imports_pytest() -> None:
    plugins = (Path("firmware_model/bench/pytest_plugin.py"), Path("agents/mussel/port/pytest_plugin.py"))
    assert set(files_that_import({"pytest"})) <= set(plugins)


def callers_of(method: str, receivers: set[str]) -> set[tuple[str, str]]:
    """(file, receiver) of each call RECEIVER.method(...) in apad_bridge, where RECEIVER ends in one of these names."""
    found = set()
    for path in sorted((ROOT / "apad_bridge").rglob("*.py")):
        for node in nodes_of(path):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr == method
            ):
                receiver = ast.unparse(node.func.value)
                if receiver.rpartition(".")[2].strip("_") in receivers:
                    found.add((str(path.relative_to(ROOT)), receiver))
    return found


def test_no_road_to_a_vehicle_goes_around_its_guards() -> None:
    """A link takes a `Cleared` alone, which the type check proves; the gate alone has a class of it that can be made."""
    assert {it.__module__ for it in Cleared.__subclasses__()} == {gate.__name__}
    assert inspect.isabstract(Cleared)
    assert callers_of("command", {"tasks", "core", "self"}) == {
        ("apad_bridge/ros/generation_a/link.py", "self._core"),
        ("apad_bridge/ros/generation_b/link.py", "self._core"),
        ("apad_bridge/vehicle/generation_b/core.py", "self._tasks"),
        ("apad_bridge/vehicle/generation_b/tasks.py", "self"),
    }


def test_only_what_the_gate_let_out_goes_on_the_wire() -> None:
    """A link's ways out take what the gate has cleared, as the type check proves; nothing else has these ways."""
    assert callers_of("publish", {"goals", "cancels"}) == set()
    assert callers_of("send", {"sender"}) == {
        ("apad_bridge/ros/generation_a/link.py", "self._sender"),
        ("apad_bridge/ros/generation_b/link.py", "self._sender"),
    }
    assert callers_of("take", {"calls"}) <= {
        ("apad_bridge/vehicle/generation_b/core.py", "self._tasks.calls"),
        ("apad_bridge/supervisor/loop.py", "self._serial_lines"),
    }


def test_text_for_people_goes_through_a_console_of_ours() -> None:
    """rich's own would write the control characters of others to a terminal."""
    makers = [
        path.relative_to(ROOT).as_posix()
        for path in sorted((ROOT / "apad_bridge").rglob("*.py"))
        for node in nodes_of(path)
        if isinstance(node, ast.ImportFrom)
        and node.module in ("rich", "rich.console")
        and {it.name for it in node.names} & {"Console", "print", "get_console"}
    ]
    assert makers == []


def test_no_line_of_a_journal_leaves_the_records() -> None:
    """A reader of a journal gives events, whose fields the type check knows. A study has a file of lines of its own."""
    readers = {
        path.relative_to(ROOT / "apad_bridge").as_posix()
        for path in (ROOT / "apad_bridge").rglob("*.py")
        for node in nodes_of(path)
        if isinstance(node, ast.ImportFrom) and node.module == "apad_bridge.records.line_file"
    }
    assert {it for it in readers if not it.startswith("records/")} == {"studies/runner.py"}


def test_permission_to_execute_code_is_given_in_one_place() -> None:
    """A command gives it; a process of ours takes it over from the one that started it, and a script has it already."""
    makers = {
        path.relative_to(ROOT / "apad_bridge").as_posix()
        for path in (ROOT / "apad_bridge").rglob("*.py")
        for node in nodes_of(path)
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "Trust"
    }
    assert makers == {
        "commands/trust.py",
        "runs/supervisor_process.py",
        "studies/specification.py",
        "runs/script_in_memory.py",
        "scripting/planned.py",
    }


def test_imports_run_one_way() -> None:
    # By its own code and not its script: a script's first line names the place where its environment was made.
    run_tool(sys.executable, "-c", "from importlinter.cli import lint_imports_command as main; main()")


def module_imports() -> dict[str, set[str]]:
    """The modules that each module of ours imports, wherever in its file, also for types alone."""
    paths = [path.relative_to(ROOT) for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    names = {".".join(path.with_suffix("").parts).removesuffix(".__init__"): path for path in paths}
    found: dict[str, set[str]] = {name: set() for name in names}
    for name, path in names.items():
        for node in nodes_of(ROOT / path):
            if isinstance(node, ast.Import):
                found[name] |= {alias.name for alias in node.names} & names.keys()
            elif isinstance(node, ast.ImportFrom) and node.module:
                within = {f"{node.module}.{alias.name}" for alias in node.names} & names.keys()
                found[name] |= within or {node.module} & names.keys()
    return found


def test_no_two_modules_import_each_other_in_a_circle() -> None:
    try:
        list(TopologicalSorter(module_imports()).static_order())
    except CycleError as error:
        pytest.fail(f"a circle of imports: {' -> '.join(error.args[1])}")


def test_types_are_strict() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]
    tests = ROOT / "tests"
    shared = {it.stem for folder in ("shared", "campaigns") for it in (tests / folder).glob("*.py")}
    assert settings["modules"] == sorted(it for it in shared if not it.startswith("test_"))
    assert {it.parent.name for it in tests.glob("campaigns/*/campaign.py")} <= set(settings["packages"])
    run_tool(sys.executable, "-m", "mypy")


def scripts_by_their_first_line() -> list[str]:
    """The Python scripts whose names do not end in .py, so that ruff does not find them by itself."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True)
    found = []
    for name in filter(None, listed.stdout.split("\0")):
        path = ROOT / name
        if path.suffix != ".py" and path.is_file():
            with path.open("rb") as file:
                first = file.readline(200)
            if first.startswith(b"#!") and b"python" in first:
                found.append(name)
    return found


def test_style_is_clean() -> None:
    scripts = scripts_by_their_first_line()
    assert {"benchmarks/run", "tests/campaigns/run", "launch_scripts/vehicle_watchdog"} <= set(scripts)
    run_tool(sys.executable, "-m", "ruff", "check", "--no-fix", ".", *scripts)
