"""The registry of aPad software generations: complete, and its parts can be loaded."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from apad_bridge.assembly.stacks import part_of, stack_of, stacks
from apad_bridge.ros_names.names import of_apad
from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.link_errors import VehicleNotReady
from apad_bridge.vehicle.stack import Stack


def test_every_generation_has_one_entry() -> None:
    assert sorted(stack.generation for stack in stacks()) == sorted(set(Generation) - {Generation.AUTO})
    assert all(stack_of(stack.generation) is stack for stack in stacks())


def test_a_scenario_that_names_no_generation_simulates_generation_a() -> None:
    assert stack_of(Generation.AUTO).generation is Generation.A


@pytest.mark.parametrize("stack", stacks(), ids=lambda it: it.generation)
def test_every_stack_has_the_parts_that_fly_it(stack: Stack) -> None:
    from apad_bridge.ros.simulated_node.legacy_server import LegacyServer

    assert callable(part_of(stack.generation, "ros.link", "open_link"))
    assert issubclass(part_of(stack.generation, "ros.server", "Server"), LegacyServer)


def test_a_part_that_a_stack_does_not_have_is_told() -> None:
    with pytest.raises(VehicleNotReady, match="cannot be flown"):
        part_of(Generation.AUTO, "ros.link", "open_link")


@pytest.mark.parametrize("stack", stacks(), ids=lambda it: it.generation)
def test_every_generation_is_recognised_by_names_in_the_table(stack: Stack) -> None:
    assert stack.recognised_actions or stack.recognised_services
    for leaf in (*stack.recognised_actions, *stack.recognised_services):
        assert of_apad("apad1", leaf) == f"apad1/{leaf}"


def told_with(tmp_path: Path, module: str, *packages: str) -> list[str]:
    """The names, the stacks that load, and the lines about others, in a process that starts with these packages."""
    (tmp_path / "lab_stack.py").write_text(module)
    for package in packages:
        info = tmp_path / f"{package}-1.2.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n")
        (info / "entry_points.txt").write_text("[musselbed.stacks]\nlab = lab_stack\nb = lab_stack\n")
    script = (
        "from apad_bridge.assembly.stacks import Generation, stacks, unloadable\n"
        "print(*Generation, '/', *(it.generation for it in stacks()))\n"
        "print(*unloadable().values(), sep='\\n')"
    )
    return subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=180,
        check=True,
    ).stdout.splitlines()


A_STACK = """
from dataclasses import replace
from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.generation_b.stack import STACK
STACK = replace(STACK, generation=Generation("lab"))
"""


def test_a_package_brings_a_stack_and_ours_keep_their_names(tmp_path: Path) -> None:
    assert told_with(tmp_path, A_STACK, "lab_stack") == ["auto a b lab / a b lab", ""]


@pytest.mark.parametrize(
    ("module", "packages", "why"),
    [
        ("import no_such_module", ["lab_stack"], "ModuleNotFoundError: No module named 'no_such_module'"),
        ("raise SystemExit(0)", ["lab_stack"], "SystemExit: 0"),
        ("", ["lab_stack"], "module 'lab_stack' has no attribute 'STACK'"),
        (
            "from apad_bridge.vehicle.stack import Stack\nSTACK = Stack('lab', 'nothing', lambda docks: None)",
            ["lab_stack"],
            "ValueError: a stack has recognised_actions or recognised_services",
        ),
        (A_STACK, ["lab_one", "lab_two"], "is in lab_one 1.2 and lab_two 1.2: uninstall one of them"),
    ],
)
def test_a_package_that_brings_none_leaves_ours_and_is_named(
    tmp_path: Path, module: str, packages: list[str], why: str
) -> None:
    names, line = told_with(tmp_path, module, *packages)
    assert names == "auto a b lab / a b"
    assert line.startswith("stack 'lab'") and f"{packages[0]} 1.2" in line and line.endswith(why)


def test_who_looks_at_a_run_of_a_package_that_broke_since_gets_one_line(tmp_path: Path) -> None:
    told_with(tmp_path, A_STACK, "lab_stack")
    text = POOL_FILE.read_text().replace("pool.csv", str(POOL_FILE.with_name("pool.csv")))
    (tmp_path / "short.yaml").write_text(text.replace("duration_s: 2400", "duration_s: 5"))

    def musselbed(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "apad_bridge.commands.main", *words],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=180,
        )

    flown = musselbed("run", "short.yaml", "--time", "asap", "--generation", "lab", "--out", "run")
    assert flown.returncode == 0, flown.stderr
    assert musselbed("replay", "run").returncode == 0
    (tmp_path / "lab_stack.py").write_text("import no_such_module")
    done = musselbed("replay", "run")
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert "stack 'lab' (from lab_stack 1.2)" in done.stderr.splitlines()[-1]
