"""Faults inflicted on real runs, and their consequences: what is left over, torn or lost. FAULTS is the table of them.

A try runs musselbed in a terminal of its own and a new directory, and inflicts the fault. Then it counts the processes that
are left, the tracebacks on the terminal and in the logs, the records that do not open, and the missions that ended
otherwise than documented. A variable in their environment marks the processes of a try.
"""

from __future__ import annotations

import os
import pty
import random
import resource
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import ReaderError

from apad_bridge.records.journal import read_journal
from apad_bridge.scenario.loader import load, write_resolved
from apad_bridge.scenario.schema import Fleet
from apad_bridge.scenario.timed_faults import Faults
from benchmarks.rows import told

ROOT = Path(__file__).parents[3]
SCENARIO = ROOT / "launch_scripts" / "scenarios" / "pool-12.yaml"
SEVERAL = ROOT / "launch_scripts" / "scenarios" / "bay-120.yaml"
MUSSELBED = Path(sys.executable).with_name("musselbed")
TRIES = 3
SEED = 20261122
_VARIABLE = "MUSSELBED_FAULT_TRY"
_GONE_S = 10.0
"""The time that a run's processes have to be gone, once its command has ended."""
_END_S = 240.0
"""The longest time that a command may take to begin or to end: some seconds, and minutes on a busy machine."""
_TRACEBACK = "Traceback (most recent call last)"
_WALL = ("--time", "wall", "--speed", "20")
_NURSERY = "agents.nursery"
_COUNTS = ("left_over", "tracebacks", "torn_records", "lost_missions")

Found = TypeVar("Found")


class Terminal:
    """A command in a pseudo-terminal of its own, which is its controlling one."""

    def __init__(self, command: list[str], variables: Mapping[str, str], limits: Mapping[int, int]) -> None:
        self._output = b""
        self.code: int | None = None
        """The exit code; negative for a signal, None while it runs."""
        self.pid, self._master = pty.fork()
        if self.pid == 0:
            try:
                for kind, limit in limits.items():
                    resource.setrlimit(kind, (limit, limit))
                os.execve(command[0], command, {**os.environ, "COLUMNS": "200", **variables})
            finally:
                os._exit(127)
        self._ended = os.pidfd_open(self.pid)

    @property
    def output(self) -> str:
        return self._output.decode(errors="replace")

    def run_for(self, seconds: float) -> bool:
        """Reads its output for that time, or until it ends; True if it has ended."""
        until_s = time.monotonic() + seconds
        while self.code is None:
            left_s = until_s - time.monotonic()
            if left_s <= 0:
                return False
            readers = [self._ended] if self._master < 0 else [self._ended, self._master]
            ready, _, _ = select.select(readers, [], [], left_s)
            if self._master in ready:
                self._read()
            if self._ended in ready:
                _, status = os.waitpid(self.pid, 0)
                self.code = os.waitstatus_to_exitcode(status)
        while self._master >= 0 and select.select([self._master], [], [], 0)[0]:
            self._read()
        return True

    def _read(self) -> None:
        try:
            piece = os.read(self._master, 65536)
        except OSError:  # the other end has closed
            piece = b""
        self._output += piece
        if not piece:
            self.hang_up()

    def press(self, key: bytes) -> None:
        with suppress(OSError):
            os.write(self._master, key)

    def hang_up(self) -> None:
        """Closes the terminal, as a lost ssh connection does."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1

    def send(self, number: int) -> None:
        if self.code is None:
            os.kill(self.pid, number)

    def close(self) -> None:
        """Kills the command if it still runs."""
        if self.code is None:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
        self.hang_up()
        os.close(self._ended)


@dataclass(slots=True)
class Try:
    """One try: its directory, its random numbers, and the commands that it started."""

    folder: Path
    rng: random.Random
    token: str = field(default_factory=lambda: uuid.uuid4().hex)
    terminals: list[Terminal] = field(default_factory=list)

    @property
    def run_dir(self) -> Path:
        return self.folder / "run"

    def start(self, *arguments: str | Path, limits: Mapping[int, int] | None = None) -> Terminal:
        """Starts musselbed in a terminal of its own, with these limits of its resources."""
        terminal = Terminal([str(MUSSELBED), *map(str, arguments)], {_VARIABLE: self.token}, limits or {})
        self.terminals.append(terminal)
        return terminal

    def run(
        self,
        *options: str,
        duration_s: float = 300,
        fleet: Fleet | None = None,
        faults: Faults | None = None,
        run_dir: Path | None = None,
        limits: Mapping[int, int] | None = None,
    ) -> Terminal:
        """Starts `musselbed run` of the paper's pool, for so many seconds of mission time, perhaps with another fleet."""
        path, scenario = self.folder / "scenario.yaml", load(SCENARIO)
        fleet = fleet or scenario.fleet
        write_resolved(path, replace(scenario, duration_s=duration_s, fleet=fleet, faults=faults))
        return self.start("run", path, "--out", run_dir or self.run_dir, *options, limits=limits)

    def processes(self, words: str = "") -> list[int]:
        """The living processes of this try whose command line has these words."""
        mark = f"{_VARIABLE}={self.token}".encode()
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
                if words in line and mark in (entry / "environ").read_bytes():
                    found.append(int(entry.name))
        return sorted(found)

    @property
    def nurseries(self) -> list[int]:
        """The nurseries that live: an agent has the command line of its nursery, but a name of its own."""
        return [pid for pid in self.processes(_NURSERY) if not _comm(pid).startswith("amussel")]

    def has_flown(self, mission_s: float) -> None:
        """Returns when the journal has come to this mission time."""
        journal = self.run_dir / "journal.jsonl"
        self.wait_for(
            lambda: (journal.exists() and read_journal(journal).last_ms >= 1000 * mission_s) or None,
            f"{mission_s:g} s of mission time",
        )

    def wait_for(self, look: Callable[[], Found | None], what: str, timeout_s: float = _END_S) -> Found:
        """The first answer of `look` that is not None; TimeoutError when there is none in time."""
        until_s = time.monotonic() + timeout_s
        while (found := look()) is None:
            if time.monotonic() > until_s:
                raise TimeoutError(f"{what} did not come within {timeout_s:g} s")
            for terminal in self.terminals:
                terminal.run_for(0.05)
            time.sleep(0.02)
        return found


@dataclass(frozen=True, slots=True)
class Fault:
    """A row of the table. `inflict` flies a mission with the fault, and returns what was lost of it, or None."""

    name: str
    inflict: Callable[[Try], str | None]


@dataclass(frozen=True, slots=True)
class Consequences:
    """Counts of one try, with notes on their reasons."""

    left_over: int
    tracebacks: int
    torn_records: int
    lost_missions: int
    notes: tuple[str, ...]


def tried(fault: Fault, seed: str) -> Consequences:
    """Inflicts a fault once. Ends whatever it leaves over."""
    with tempfile.TemporaryDirectory(prefix="fault-") as folder, ExitStack() as stack:
        attempt = Try(Path(folder), random.Random(seed))
        stack.callback(_kill_all, attempt)
        try:
            lost = fault.inflict(attempt)
        except TimeoutError as error:
            lost = str(error)
        left = _left_over(attempt)
        for terminal in attempt.terminals:
            stack.callback(terminal.close)
        texts = {f"terminal {n}": it.output for n, it in enumerate(attempt.terminals)}
        for path in [*Path(folder).rglob("*.log"), *Path(folder).rglob("*.err")]:
            if path.name != "master.log":  # rosmaster writes a traceback there for each node that was killed
                texts[str(path.relative_to(folder))] = path.read_text(errors="replace")
        tracebacks = {name: text.count(_TRACEBACK) for name, text in texts.items() if _TRACEBACK in text}
        torn = [reason for run in Path(folder).rglob("journal.jsonl") for reason in _torn(run.parent)]
        notes = [
            *(f"left over: {words}" for words in left),
            *(f"{n} tracebacks in {name}: {_last_error(texts[name])}" for name, n in tracebacks.items()),
            *torn,
            *([f"{lost}; it said: {attempt.terminals[0].output.strip()[-200:]!r}"] if lost else []),
        ]
    return Consequences(
        len(left),
        sum(tracebacks.values()),
        len(torn),
        int(lost is not None),
        tuple(notes),
    )


def _last_error(text: str) -> str:
    after = text.rpartition(_TRACEBACK)[2].splitlines()
    return next((line for line in after[1:] if line and not line.startswith(" ")), "")


def _left_over(attempt: Try) -> list[str]:
    """The command lines of the processes that are still there some time after their commands have ended."""
    until_s = time.monotonic() + _GONE_S
    while (pids := attempt.processes()) and time.monotonic() < until_s:
        time.sleep(0.1)
    lines = []
    for pid in pids:
        with suppress(OSError):
            lines.append(Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()[:160])
    return lines


def _kill_all(attempt: Try) -> None:
    for pid in attempt.processes():
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _torn(run_dir: Path) -> Iterator[str]:
    for path in run_dir.glob("*.bag"):
        try:
            with closing(Reader(path)) as reader:
                reader.open()
        except (ReaderError, OSError, AssertionError, struct.error) as error:
            yield f"{path.name} ({path.stat().st_size} bytes) does not open: {error}"
    journal = read_journal(run_dir / "journal.jsonl")
    if journal.dropped:
        yield f"journal.jsonl has {journal.dropped} lines that cannot be read"
    for before, after in pairwise(journal.entries):
        if after.at_ms < before.at_ms:
            yield f"journal.jsonl steps back in time from {before.at_ms} to {after.at_ms} ms"


def _expect(terminal: Terminal, codes: set[int], words: str = "", within_s: float = _END_S) -> str | None:
    """Waits for the command's end; what was lost if its code or its words are others."""
    if not terminal.run_for(within_s):
        return f"it still ran after {within_s:g} s"
    if terminal.code not in codes:
        return f"exit code {terminal.code} instead of {sorted(codes)}"
    if words not in terminal.output:
        return f"it does not say {words!r}"
    return None


def _several_apads(attempt: Try) -> Terminal:
    options = ("--agents", "15", "--time", "wall", "--speed", "10")
    return attempt.start("run", SEVERAL, "--out", attempt.run_dir, *options)


_STARTS: dict[str, tuple[Callable[[Try], Terminal], float]] = {
    "asap": (lambda attempt: attempt.run("--time", "asap"), 3.0),
    "over ROS": (lambda attempt: attempt.run(*_WALL), 6.0),
    "several aPads": (_several_apads, 14.0),
}
"""Arguments of a run, and the seconds within which it has certainly started."""


def _interrupted(attempt: Try, kind: signal.Signals, where: str) -> str | None:
    start, longest_s = _STARTS[where]
    terminal = start(attempt)
    terminal.run_for(attempt.rng.uniform(0.03, longest_s))
    match kind:
        case signal.SIGINT:
            terminal.press(b"\x03")
        case signal.SIGTERM:
            terminal.send(signal.SIGTERM)
        case signal.SIGHUP:
            terminal.hang_up()
    lost = _expect(terminal, {0, 130}, within_s=40.0)
    # Before it runs a line of ours, the interpreter ends by the signal itself.
    return None if terminal.code == -kind and not attempt.run_dir.exists() else lost


def _disk_full(attempt: Try, *, over_ros: bool) -> str | None:
    with _small_disk(attempt.folder / "disk") as disk:
        run_dir = disk / "run"
        limits = {} if disk.is_mount() else {resource.RLIMIT_FSIZE: 100_000}
        options = _WALL if over_ros else ("--time", "asap")
        terminal = attempt.run(*options, duration_s=2400, run_dir=run_dir, limits=limits)
        lost = _expect(terminal, {3}, str(run_dir))
        _left_over(attempt)
        torn = list(_torn(run_dir)) if (run_dir / "journal.jsonl").exists() else []
    return lost or (torn[0] if torn else None)


@contextmanager
def _small_disk(folder: Path) -> Iterator[Path]:
    """A disk of 1.2 MB in memory; without the right to mount one, a plain folder."""
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1200k", "tmpfs", str(folder)]
    mounted = os.geteuid() == 0 and subprocess.run(mount, capture_output=True, check=False).returncode == 0
    try:
        yield folder
    finally:
        if mounted:
            subprocess.run(["umount", "-l", str(folder)], check=True)


def _fleet_given_up(attempt: Try) -> str | None:
    terminal = attempt.run("--time", "wall", "--speed", "10", duration_s=2400)
    attempt.has_flown(5)
    killed: set[int] = set()
    for _ in range(4):

        def another() -> int | None:
            return next(iter(set(attempt.nurseries) - killed), None)

        try:
            nursery = attempt.wait_for(another, "another nursery", 20.0)
        except TimeoutError:
            break
        killed.add(nursery)
        os.kill(nursery, signal.SIGKILL)
    return _expect(terminal, {3}, "loss of the fleet: its nursery died", within_s=60.0)


def _comm(pid: int) -> str:
    """The name of a process: all agents have their nursery's command line, but a name of their own."""
    try:
        return Path(f"/proc/{pid}/comm").read_text()
    except OSError:
        return "amussel that has ended"


def _silent_connections(attempt: Try) -> str | None:
    """Connects to every port of the run as soon as it listens, and says nothing."""
    terminal = attempt.run(*_WALL)
    with ExitStack() as stack:
        taken: set[int] = set()
        until_s = time.monotonic() + _END_S
        while not terminal.run_for(0.02) and time.monotonic() < until_s:
            for port in _ports(attempt.processes()) - taken:
                with suppress(OSError):
                    stack.enter_context(socket.create_connection(("127.0.0.1", port), 1.0))
                    taken.add(port)
        return _expect(terminal, {0}, within_s=0.1)


def _ports(pids: list[int]) -> set[int]:
    """The TCP ports at which these processes listen."""
    inodes = set()
    for pid in pids:
        with suppress(OSError):
            for entry in Path(f"/proc/{pid}/fd").iterdir():
                with suppress(OSError):
                    target = os.readlink(entry)
                    if target.startswith("socket:["):
                        inodes.add(target[8:-1])
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return {int(row[1].rpartition(":")[2], 16) for row in rows if row[3] == "0A" and row[9] in inodes}


FAULTS = (
    *(
        Fault(f"{kind.name} while a run starts, {where}", partial(_interrupted, kind=kind, where=where))
        for kind in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        for where in _STARTS
    ),
    Fault("full disk, asap", partial(_disk_full, over_ros=False)),
    Fault("full disk, over ROS", partial(_disk_full, over_ros=True)),
    Fault("fleet given up", _fleet_given_up),
    Fault("silent TCP connections", _silent_connections),
)
SHORT = ("SIGINT while a run starts, asap", "full disk, asap")
"""Names of the faults whose flights take some seconds each."""


def measure(tries: int = TRIES, short: bool = False) -> dict[str, Any]:
    """Each fault `tries` times. The rows' counts are sums over the tries."""
    tries = 1 if short else tries
    faults = [it for it in FAULTS if it.name in SHORT or not short]
    return {"rows": [_measured(fault, tries) for fault in faults]}


def _measured(fault: Fault, tries: int) -> dict[str, Any]:
    results = [tried(fault, f"{SEED} {fault.name} {n}") for n in range(tries)]
    row: dict[str, Any] = {"fault": fault.name, "tries": tries}
    for key in _COUNTS:
        row[key] = sum(getattr(it, key) for it in results)
    row["notes"] = [note for it in results for note in it.notes]
    return told(row)
