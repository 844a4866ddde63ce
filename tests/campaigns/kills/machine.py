"""A simulated machine that can lose its power: all of its processes end at once, and nothing stays but its disk.

It is a pid, mount and network namespace of its own. After a restart the numbers of processes and ports are given anew,
and /tmp and /dev/shm are empty. The processes are seen, and get signals, from outside.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from tries import NoFlight

INIT = Path(__file__).with_name("nodes") / "init.py"
NAMESPACES = [
    "unshare",
    "--map-root-user",
    "--pid",
    "--fork",
    "--kill-child",
    "--mount",
    "--mount-proc",
    "--net",
]
ROLES = {
    "supervisor": "runs.supervisor_process",
    "master": "master_process",
    "aPad": "simulated_node.apad_node",
    "sea": "several.sea_process",
    "clock": "system.clock_node",
    "console": "commands.main console",
    "IMC gateway": "commands.main imc",
    "Foxglove server": "commands.main foxglove",
}
"""Words in the command line of each process of a run, by its role."""
DISK = "/var/tmp"
"""Files there outlive a restart."""
PARENT, NURSERY, AGENT = "parent", "nursery", "agent"
_STARTS_S, _ENDS_S = 60.0, 60.0


def why_no_machine(repository: Path) -> str:
    """Why this machine cannot simulate another one; empty if it can."""
    if missing := [it for it in ("unshare", "mount", "ip") if shutil.which(it) is None]:
        return f"{missing[0]} is missing"
    if repository.is_relative_to("/tmp"):
        return f"{repository} is in /tmp, which is empty after a restart"
    tried = subprocess.run(
        [*NAMESPACES, "mount", "-t", "tmpfs", "none", "/tmp"], capture_output=True, text=True, check=False
    )
    return tried.stderr.strip() if tried.returncode else ""


class Machine:
    """Boots at once. It ends with `crash`, or with this process."""

    def __init__(self, environment: dict[str, str]) -> None:
        self._codes: dict[str, int] = {}
        self._pending = b""
        self._process = subprocess.Popen(
            [*NAMESPACES, sys.executable, str(INIT)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            bufsize=0,
        )
        if not self._read(lambda: "machine" in self._codes, _STARTS_S):
            self.crash()
            raise NoFlight("the machine does not start")
        self._space = self._own_space()

    def start(self, name: str, *words: str, folder: Path) -> None:
        """Starts a program; what it says is in FOLDER/NAME.out and NAME.err."""
        assert self._process.stdin is not None
        line = json.dumps({"name": name, "words": words, "folder": str(folder)})
        self._process.stdin.write(f"{line}\n".encode())

    def code(self, name: str) -> int | None:
        """The program's exit code, negative for a signal; None while it runs."""
        self._read(lambda: name in self._codes, 0.0)
        return self._codes.get(name)

    def ends(self, name: str, within_s: float) -> bool:
        """Waits for the program's end; True if it came."""
        return self._read(lambda: name in self._codes, within_s)

    def processes(self) -> dict[int, str]:
        """The role of each living process but the first, by its pid outside; a part of its command line without one."""
        return {pid: _role(pid) for pid in self._inside() if pid != self._init}

    def crash(self) -> None:
        """Power goes: the kernel ends all processes at once."""
        self._process.kill()  # the first process is killed with it, and all others with the first
        self._process.wait(_ENDS_S)
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()

    def _own_space(self) -> str:
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children").read_text().split()
        self._init = int(children[0])
        return os.readlink(f"/proc/{self._init}/ns/pid")

    def _inside(self) -> list[int]:
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if os.readlink(entry / "ns" / "pid") == self._space:
                    found.append(int(entry.name))
        return found

    def _read(self, is_so: Callable[[], bool], within_s: float) -> bool:
        """Reads what the first process tells until it is so; False when the time is over."""
        assert self._process.stdout is not None
        until_s = time.monotonic() + within_s
        while not is_so():
            left_s = max(0.0, until_s - time.monotonic())
            if not select.select([self._process.stdout], [], [], left_s)[0]:
                return False
            piece = os.read(self._process.stdout.fileno(), 65536)
            if not piece:
                return False
            *lines, self._pending = (self._pending + piece).split(b"\n")
            self._codes |= dict(map(json.loads, lines))
        return True


def _role(pid: int) -> str:
    try:
        line = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        name = Path(f"/proc/{pid}/comm").read_text()
    except OSError:
        return ""
    if "agents.nursery" in line:
        return AGENT if name.startswith("amussel") else NURSERY
    for role, words in ROLES.items():
        if words in line:
            return role
    is_parent = "commands.main run" in line or "commands.main resume" in line
    return PARENT if is_parent else line[:160].strip()


def send(pid: int, number: signal.Signals) -> bool:
    """Sends a signal; False if the process has ended."""
    with suppress(ProcessLookupError):
        os.kill(pid, number)
        return True
    return False
