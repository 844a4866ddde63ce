"""A command that SIGTERM or SIGHUP asks to end ends as with Ctrl-C."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from agents.hosting.interrupts import ENDING
from apad_bridge.commands import main as command
from apad_bridge.runs.exits import Exit

SCRIPT = Path(__file__).parents[3] / "launch_scripts" / "musselbed"


@pytest.mark.parametrize("number", ENDING)
def test_a_terminated_command_says_so_by_its_exit_code(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def is_terminated(_: argparse.Namespace) -> int:
        os.kill(os.getpid(), number)
        signal.pause()
        return Exit.DONE

    top = argparse.ArgumentParser()
    top.set_defaults(run=is_terminated, command="run")
    monkeypatch.setattr(command, "parser", lambda arguments: top)
    assert command.main([]) == Exit.INTERRUPTED


@pytest.mark.parametrize("number", ENDING)
def test_the_command_ends_in_silence_while_the_interpreter_loads_its_packages(
    number: int, tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        f"import signal; signal.raise_signal({int(number)}); print('goes on')"
    )
    done = subprocess.run(
        [sys.executable, "-S", SCRIPT, "--version"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        timeout=60,
    )
    assert (done.returncode, done.stdout, done.stderr) == (Exit.INTERRUPTED, b"", b"")


@pytest.mark.parametrize("number", ENDING)
def test_a_process_that_becomes_another_of_ours_ends_in_silence_from_the_first_moment(
    number: int, tmp_path: Path
) -> None:
    """The signal comes while the new interpreter loads: before any handler of ours can be there."""
    (tmp_path / "sitecustomize.py").write_text(
        f"import os, signal\nif 'BECAME' in os.environ: signal.raise_signal({int(number)})\n"
    )
    program = "from agents.hosting.started import replace_process; replace_process('calendar', ['2026'], {'BECAME': '1'})"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": f"{tmp_path}:{SCRIPT.parents[1]}"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stdout, done.stderr) == (Exit.INTERRUPTED, "", "")


def test_the_command_runs_by_the_python_beside_it(tmp_path: Path) -> None:
    installed, elsewhere = tmp_path / "bin", tmp_path / "a link to it"
    installed.mkdir()
    (installed / "musselbed").write_bytes(SCRIPT.read_bytes())
    (installed / "musselbed").chmod(0o755)
    (installed / "python3").write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    (installed / "python3").chmod(0o755)
    elsewhere.symlink_to(installed / "musselbed")
    done = subprocess.run([elsewhere, "--version"], capture_output=True, text=True, timeout=60)
    assert done.stdout.startswith("musselbed ") and done.stderr == ""


@pytest.mark.parametrize(
    ("number", "program"), [(signal.SIGINT, "readlink"), *((it, "python3") for it in ENDING)]
)
def test_the_command_ends_in_silence_before_python_can_take_a_signal(
    number: int, program: str, tmp_path: Path
) -> None:
    """The signal comes, as by Ctrl-C to all of its processes, while the shell runs or the interpreter starts."""
    installed = tmp_path / "musselbed"
    installed.write_bytes(SCRIPT.read_bytes())
    real = sys.executable if program == "python3" else "/usr/bin/readlink"
    (tmp_path / program).write_text(f'#!/bin/sh\nkill -{int(number)} 0\nexec {real} "$@"\n')
    for made in (installed, tmp_path / program):
        made.chmod(0o755)
    if program == "readlink":
        (tmp_path / "python3").symlink_to(sys.executable)
    done = subprocess.run(
        [installed, "--version"],
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        start_new_session=True,
        capture_output=True,
        timeout=60,
    )
    assert (done.returncode, done.stdout, done.stderr) == (Exit.INTERRUPTED, b"", b"")
