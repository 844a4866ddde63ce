"""Each block of README and docs that is marked to run, in a fresh copy of the clone, a page at a time.

The copy's scenarios last `MISSION_S` only. `RUN` stands for a whole flight of pool-12, or for one that flies meanwhile. The
suite leaves these tests out, which take six minutes: launch_scripts/test -m docs_commands
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from doc_blocks import PAGES, ROOT, Block, blocks
from programs import begun, done, wait_until

from apad_bridge.supervisor.control_protocol import listens

pytestmark = [pytest.mark.system, pytest.mark.docs_commands]
MISSION_S = 120
PATIENCE_S = 600.0
OTHER_RUN = "runs/other"
PROGRAMS = "source launch_scripts/setup.bash\n"
PAGES_THAT_RUN = [page for page in PAGES if any(block.mark.startswith("run") for block in blocks(page))]


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """The checkout's files as after `git clone` and `launch_scripts/install`, with short scenarios.

    The environment is the checkout's own. So the copy has no packages: they would shadow those of the environment.
    """
    clone = tmp_path / "musselbed"
    listed = done("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard")
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file() and not name.startswith(
            ("apad_bridge/", "agents/", "firmware_model/", "tests/")
        ):
            (clone / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, clone / name)
    (clone / ".venv").symlink_to(ROOT / ".venv")
    for scenario in (clone / "launch_scripts" / "scenarios").glob("*.yaml"):
        text, count = re.subn(r"(?m)^duration_s: \d+", f"duration_s: {MISSION_S}", scenario.read_text())
        assert count == 1, scenario
        scenario.write_text(text)
    return clone


def in_a_shell(clone: Path, script: str, variables: dict[str, str] | None = None) -> None:
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "ROS_"))}
    there = {"cwd": clone, "env": environment | (variables or {}), "timeout": PATIENCE_S}
    done("bash", "-eu", "-o", "pipefail", "-c", PROGRAMS + script, **there)


def test_the_papers_figures_are_what_the_code_gives() -> None:
    in_a_shell(ROOT, "docs/pictures/make-paper-figures --check")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the whole pool experiment, which has ended."""
    run = tmp_path_factory.mktemp("flown") / "pool-12"
    in_a_shell(ROOT, f"musselbed run launch_scripts/scenarios/pool-12.yaml --time asap --out {run}\n")
    return run


@contextmanager
def flight(clone: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """The directory of a run that flies over ROS, and the variables with which ROS's tools find its master."""
    run = clone / "runs" / "flies"
    scenario = ROOT / "launch_scripts" / "scenarios" / "pool-12.yaml"
    program = [ROOT / ".venv/bin/musselbed", "run", scenario, "--speed", "5", "--out", run]
    with begun(*program, cwd=clone, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        wait_until(lambda: run.is_dir() and listens(run), process)
        yield "runs/flies", {"ROS_MASTER_URI": json.loads((run / "run.json").read_text())["master_uri"]}


def execute(block: Block, clone: Path, run: str, variables: dict[str, str] | None = None) -> None:
    text = re.sub(r"\bRUN\b", run, block.text.replace("OTHER_RUN", OTHER_RUN))
    if block.kind == "python":
        (clone / "block.py").write_text(text)
        text = ".venv/bin/python block.py\n"
    elif block.argument:
        text = text.replace("\n", f" {block.argument}\n")
    in_a_shell(clone, text, variables)


@pytest.mark.parametrize("page", PAGES_THAT_RUN, ids=lambda page: page.stem)
def test_every_block_that_is_marked_runs(page: Path, clone: Path, flown: Path) -> None:
    for run in ("runs/flown", OTHER_RUN):
        shutil.copytree(flown, clone / run, ignore=shutil.ignore_patterns("*.sock"))
    for block in blocks(page):
        match block.mark:
            case "file":
                (clone / block.argument).write_text(block.text)
            case "run":
                execute(block, clone, "runs/flown")
            case "run beside a flight":
                with flight(clone) as (run, variables):
                    execute(block, clone, run, variables)
