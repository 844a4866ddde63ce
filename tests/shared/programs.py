"""Programs that tests start, the command of musselbed above all, and the processes and journals that they leave."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from journals import Line, lines_in
from patient import PATIENCE_S

from apad_bridge.commands.main import main

ROOT = Path(__file__).parents[2]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
Begin = Callable[..., subprocess.Popen[str]]
"""Starts a program that ends with the test: the fixture `begin`."""


@contextmanager
def begun(*words: object, ends_by: int = signal.SIGINT, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A program with pipes, in the clone; a signal ends it if it still runs then."""
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": ROOT}
    process: subprocess.Popen[str] = subprocess.Popen(list(map(str, words)), **(pipes | options))
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(ends_by)
        process.communicate(timeout=2 * PATIENCE_S)


def done(*words: object, code: int | None = 0, **options: Any) -> subprocess.CompletedProcess[str]:
    """A program that has ended. AssertionError with its output if it did not by this exit code; None: by any."""
    usual: dict[str, Any] = {"capture_output": True, "text": True, "timeout": 2 * PATIENCE_S, "cwd": ROOT}
    ended: subprocess.CompletedProcess[str] = subprocess.run(list(map(str, words)), **(usual | options))
    assert code in (None, ended.returncode), f"{ended.returncode}: {ended.stdout}\n{ended.stderr}"
    return ended


def musselbed(*words: object, code: int | None = 0, **options: Any) -> subprocess.CompletedProcess[str]:
    return done(*MUSSELBED, *words, code=code, **options)


def code_here(*words: object) -> int:
    """The exit code of the command in this process, which is sooner there."""
    try:
        return main(list(map(str, words)))
    except SystemExit as ended:
        assert isinstance(ended.code, int)
        return ended.code


def ended_well(process: subprocess.Popen[str], code: int = 0) -> tuple[str, str]:
    """Both outputs of a program that ends by itself, with this exit code."""
    outputs = process.communicate(timeout=2 * PATIENCE_S)
    assert process.returncode == code, outputs
    return outputs


def with_helpers(environment: dict[str, str]) -> dict[str, str]:
    """The variables of a program of ours that imports these modules, too."""
    return environment | {"PYTHONPATH": str(Path(__file__).parent)}


def line_of(process: subprocess.Popen[str]) -> str:
    """The next line of its output, without its end."""
    assert process.stdout is not None
    return process.stdout.readline().rstrip("\n")


def wait_until(holds: Callable[[], Any], *flights: subprocess.Popen[str], why: str = "") -> Any:
    """Polls what announces nothing, while the flights go on; gives what was found."""
    until_s, pause = time.monotonic() + 2 * PATIENCE_S, threading.Event()
    while not (found := holds()):
        assert time.monotonic() < until_s, why or "it never came to that"
        assert all(it.poll() is None for it in flights), (why, [it.communicate() for it in flights])
        pause.wait(0.05)
    return found


def lines_of(run: Path, *kinds: str) -> list[Line]:
    """The lines of its journal so far, of these kinds or of all."""
    return [it for it in lines_in(run / "journal.jsonl") if not kinds or it["kind"] in kinds]


def docked(run: Path) -> list[int]:
    """The aMussels that the journal says are docked now, in docking order."""
    held: list[int] = []
    for line in lines_of(run, "dock"):
        held = [it for it in held if it != line["agent"]] + [line["agent"]] * line["closed"]
    return held


def left_full(run: Path) -> list[int]:
    """The aMussels that left a dock full, in order."""
    return [it["agent"] for it in lines_of(run, "released") if it["full"]]


def processes_of(*words: object) -> dict[int, str]:
    """The command lines of living processes, but for this one, that have all of these words; by pid."""
    found = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            if all(str(it) in line for it in words) and entry.name != str(os.getpid()):
                found[int(entry.name)] = line
    return found


def parent_of(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def children(pid: int) -> list[int]:
    return [int(it) for it in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
