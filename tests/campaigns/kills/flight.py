"""One flight on a simulated machine: it begins, gets the signals of a mix, loses its power, is resumed, and ends."""

from __future__ import annotations

import json
import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import yaml
from tries import NoFlight

from kills.machine import Machine, send
from kills.mixes import Act, Mix, Row

ROOT = Path(__file__).parents[3]
MUSSELBED = (sys.executable, "-m", "apad_bridge.commands.main")
BEGINS_S = 180.0
PATIENCE_S = 240.0
"""Wall seconds for the mission to come to the next act, or to its end."""
VICTIM_S = 5.0
"""The time for a victim that is just started again."""
GONE_S = 20.0
"""The time that a run's processes have to be gone, once its command has ended."""
_LOOK_S = 0.1
_TAIL_BYTES = 20_000
_TRACEBACK = "Traceback (most recent call last)"


@dataclass
class Flight:
    home: Path
    row: Row
    mix: Mix
    rng: random.Random
    ended: threading.Event
    """Set from outside: the campaign ends, and this flight with it."""
    failures: list[str] = field(default_factory=list)
    done: list[str] = field(default_factory=list)
    """The acts that found their victim."""
    code: int | None = None
    said: str = ""
    lost_power: bool = False
    was_resumed: bool = False

    @property
    def run_dirs(self) -> list[Path]:
        return sorted(it.parent for it in (self.home / "run").rglob("journal.jsonl"))

    def fly(self) -> None:
        """NoFlight if it did not begin. All of its processes end with this."""
        (self.home / "scenario.yaml").write_text(yaml.safe_dump(self.mix.scenario))
        time_words = ("asap",) if self.row.speed is None else ("wall", "--speed", f"{self.row.speed:g}")
        crash_s = math.inf if self.mix.crash_s is None else self.mix.crash_s
        before = [it for it in self.mix.acts if it.at_s < crash_s]
        words = ("run", "scenario.yaml", "--out", "run", "--time", *time_words, *self.row.words)
        self._on_machine("run", words, before)
        if self.lost_power and not self.failures:
            self.was_resumed = self.row.resumes
            self._on_machine("resume", ("resume", str(self.run_dirs[0])), self.mix.acts[len(before) :])

    def _on_machine(self, name: str, words: tuple[str, ...], acts: list[Act]) -> None:
        with ExitStack() as stack:
            machine = Machine(self._environment())
            stack.callback(machine.crash)
            machine.start(name, *MUSSELBED, *words, folder=self.home)
            if name == "run":
                self._begin(machine)
            elif not self.row.resumes:
                self._is_refused(machine)
                return
            for it in acts:
                if self._comes_to(machine, name, it.at_s):
                    self._act(machine, it)
            crash_s = self.mix.crash_s
            flies = crash_s is not None and self._comes_to(machine, name, crash_s)
            if name == "run" and flies and not self._has_ended(machine, name):
                self.lost_power = True
                self.done.append(f"power off at {self.flown_s():.0f} s")
            elif not self.failures:
                self._end(machine, name)

    def _environment(self) -> dict[str, str]:
        """A shell of its own user: nothing of this one's ROS, Python, or earlier runs."""
        ours = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("ROS_", "PYTHON", "TMP"))
        }
        return ours | {
            "PYTHONPATH": str(ROOT),
            "HOME": str(self.home),
            "XDG_STATE_HOME": str(self.home / "state"),
        }

    def _begin(self, machine: Machine) -> None:
        until_s = time.monotonic() + BEGINS_S
        while not self.run_dirs or self.flown_s() <= 0:
            if machine.code("run") is not None or time.monotonic() > until_s or self.ended.is_set():
                raise NoFlight(f"the run did not begin: {self._said('run')[-300:]}")
            self.ended.wait(_LOOK_S)

    def flown_s(self) -> float:
        """The mission time of the newest whole line in any journal of the run."""
        newest_ms = 0
        for run in self.run_dirs:
            with (run / "journal.jsonl").open("rb") as journal:
                journal.seek(max(0, journal.seek(0, os.SEEK_END) - _TAIL_BYTES))
                whole = journal.read().split(b"\n")[:-1]
            if whole and whole[-1].startswith(b'{"t":'):
                newest_ms = max(newest_ms, json.loads(whole[-1])["t"])
        return newest_ms / 1000

    def _comes_to(self, machine: Machine, name: str, at_s: float) -> bool:
        """Waits for that mission time; False if the command ended before, or the mission stands."""
        until_s = time.monotonic() + PATIENCE_S
        while self.flown_s() < at_s:
            if self.ended.is_set():
                raise NoFlight("the campaign ends")
            if self.failures or self._has_ended(machine, name):
                return False
            if time.monotonic() > until_s:
                self.failures.append(
                    f"mission time stands at {self.flown_s():.0f} s: {self._said(name)[-300:]}"
                )
                return False
            self.ended.wait(_LOOK_S if self.row.speed is not None else 0.02)
        return True

    def _has_ended(self, machine: Machine, name: str) -> bool:
        """Its command has ended, or its parent was killed and the flight has its summary."""
        code = machine.code(name)
        if code == -signal.SIGKILL:
            return (self.run_dirs[0] / "summary.json").exists()
        return code is not None

    def _act(self, machine: Machine, act: Act) -> None:
        until_s = time.monotonic() + VICTIM_S
        while not (pids := sorted(pid for pid, role in machine.processes().items() if role == act.role)):
            if time.monotonic() > until_s or machine.code("run") or machine.code("resume"):
                return
            self.ended.wait(_LOOK_S)
        pid = self.rng.choice(pids)
        if send(pid, act.number):
            self.done.append(str(act))
        if act.for_s:
            self.ended.wait(act.for_s)
            send(pid, signal.SIGCONT)

    def _end(self, machine: Machine, name: str) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while not self._has_ended(machine, name):
            if self.ended.is_set():
                raise NoFlight("the campaign ends")
            if time.monotonic() > until_s:
                self.failures.append(
                    f"it does not end: mission time {self.flown_s():.0f} s: {self._said(name)[-300:]}"
                )
                return
            self.ended.wait(_LOOK_S)
        self.code, self.said = machine.code(name), self._said(name)
        if self.code == -signal.SIGKILL:
            return  # its orphans wait for another parent
        gone_s = time.monotonic() + GONE_S
        while (left := machine.processes()) and time.monotonic() < gone_s:
            self.ended.wait(_LOOK_S)
        self.failures += [f"left over: {it}" for it in left.values()]

    def _is_refused(self, machine: Machine) -> None:
        """A run that no person can resume says why in one line, and starts nothing."""
        if not machine.ends("resume", BEGINS_S):
            self.failures.append(f"`resume` neither flies nor refuses: {self._said('resume')[-300:]}")
        self.code, self.said = None, self._said("resume")
        if machine.code("resume") not in (2, 3) or len(self.said.strip().splitlines()) != 1:
            self.failures.append(
                f"`resume` is not refused in one line: {machine.code('resume')}: {self.said[-300:]}"
            )
        self.failures += [f"left over by a refused `resume`: {it}" for it in machine.processes().values()]

    def _said(self, name: str) -> str:
        paths = [self.home / f"{name}.{it}" for it in ("err", "out")]
        return "".join(it.read_text(errors="replace") for it in paths if it.exists())

    def tracebacks(self) -> list[str]:
        """The last line of each traceback in what its programs said; a master's has one for each node that was killed."""
        found = []
        for path in [*self.home.glob("*.err"), *self.home.glob("*.out"), *(self.home / "run").rglob("*.log")]:
            text = path.read_text(errors="replace")
            if _TRACEBACK in text and path.name != "master.log":
                after = text.rpartition(_TRACEBACK)[2].splitlines()[1:]
                last = next((line for line in after if line and not line.startswith(" ")), "")
                found.append(f"{text.count(_TRACEBACK)} tracebacks in {path.name}: {last[:200]}")
        return found

    def check(self) -> list[str]:
        """The failures that `musselbed check` finds."""
        found = []
        for run in self.run_dirs:
            words = [*MUSSELBED, "check", str(run)]
            done = subprocess.run(
                words, env=self._environment(), capture_output=True, text=True, timeout=PATIENCE_S
            )
            if done.returncode:
                said = (done.stdout + done.stderr).strip()[:300]
                found.append(f"`check` of {run.name} ends with {done.returncode}: {said}")
        return found
