"""Follows docs/tutorial.md literally in a copy of the packages: files, changes, commands and their output.

A block that is fenced as python or yaml is the file that its first line names; a block fenced as diff is applied; an
indented line is a command; and the command's output must contain each line of the text block that follows it.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/tutorial.md"
_STEP = re.compile(
    r"^```(?P<kind>\w+)\n(?P<block>.*?)^```$|^    (?P<command>\S[^\n]*)$", re.MULTILINE | re.DOTALL
)


def steps() -> Iterator[tuple[str, str]]:
    for found in _STEP.finditer(PAGE.read_text()):
        yield ("command", found["command"]) if found["command"] else (found["kind"], found["block"])


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    # With the modules that Python has compiled: a file that the page changes is compiled anew, and no other. What another
    # test's Python is writing just now has a longer name, and is gone before it can be copied.
    being_written = shutil.ignore_patterns("*.pyc.*")
    for name in ("firmware_model", "agents", "apad_bridge", "docs", "tests/firmware_model", "tests/shared"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=being_written)
    (tmp_path / "pytest.ini").write_text(
        "[pytest]\npythonpath = tests/shared\naddopts = --import-mode=importlib -p no:cacheprovider\n"
    )
    return tmp_path


def apply(clone: Path, diff: str) -> None:
    """As the page says: the block is saved, and `git apply` changes the clone by it."""
    (clone / "change.diff").write_text(diff)
    applied = subprocess.run(
        ["git", "apply", "change.diff"],
        cwd=clone,
        env=os.environ | {"GIT_CEILING_DIRECTORIES": str(clone.parent)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert applied.returncode == 0, f"{applied.stderr}\n{diff}"


def run(clone: Path, command: str) -> subprocess.CompletedProcess[str]:
    program, *words = shlex.split(command)
    module = {"musselbed": "apad_bridge.commands.main", "pytest": "pytest"}[program]
    # The copy comes before the installed packages, for the plugin as well.
    environment = os.environ | {"PYTHONPATH": str(clone), "COLUMNS": "160", "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable, "-m", module, *words],
        cwd=clone,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_every_step_of_the_tutorial_does_what_the_page_says(clone: Path) -> None:
    done, checked = None, 0
    for kind, block in steps():
        match kind:
            case "command":
                done = run(clone, block)
                assert done.returncode in (0, 1) and "Traceback" not in done.stderr, done.stderr
            case "text":
                missing = [line for line in block.splitlines() if line not in done.stdout]
                assert missing == [], done.stdout + done.stderr
                assert done.returncode == int("FAILED" in done.stdout)
                checked += 1
            case "diff":
                apply(clone, block)
            case _:
                name = re.match(r"# (\S+)\n", block)
                assert name is not None, "a file's block begins with its name"
                (clone / name[1]).write_text(block)
    assert checked == sum(kind == "command" for kind, _ in steps()) == 6
