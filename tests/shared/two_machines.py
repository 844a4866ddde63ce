"""Two machines on one network, each a network namespace with a loopback of its own; and the link between them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from lossy_link import FAR, NEAR

_LINK = Path(__file__).with_name("lossy_link.py")
_END_S = 10.0


@dataclass(frozen=True, slots=True)
class Link:
    """Each packet is lost with the probability `loss`, or arrives `delay_s` later, either way."""

    loss: float = 0.0
    delay_s: float = 0.0
    seed: int = 1


@dataclass(frozen=True, slots=True)
class Machine:
    """A network namespace with an address. `command` and `environment` start a program there."""

    address: str
    _keeper: int

    def command(self, *words: str) -> list[str]:
        """The program of `words` in this namespace; the process that starts becomes it."""
        return ["nsenter", "-t", str(self._keeper), "-U", "-n", "--preserve-credentials", *words]

    def environment(self, master_uri: str) -> dict[str, str]:
        """The shell of a person there: ROS's two variables, and nothing of this machine's ROS."""
        ours = {name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "PYTHON"))}
        return ours | {"ROS_MASTER_URI": master_uri, "ROS_IP": self.address}


def why_no_two_machines() -> str:
    """Why this machine cannot play two; empty if it can."""
    if missing := [it for it in ("unshare", "nsenter", "ip") if shutil.which(it) is None]:
        return f"{missing[0]} is missing"
    tried = subprocess.run(
        ["unshare", "-rn", "ip", "tuntap", "add", "dev", "tried", "mode", "tun"],
        capture_output=True,
        text=True,
        check=False,
    )
    return tried.stderr.strip() or f"unshare ended with {tried.returncode}" if tried.returncode else ""


@contextmanager
def two_machines(link: Link) -> Iterator[tuple[Machine, Machine]]:
    """Entered when the link between them carries packets; all ends with this, or with this process."""
    with ExitStack() as stack:
        near = _keeper(stack, ["unshare", "-rn"])
        inside = ["nsenter", "-t", str(near), "-U", "-n", "--preserve-credentials"]
        far = _keeper(stack, [*inside, "unshare", "-n"])
        words = [sys.executable, str(_LINK), str(far), str(link.loss), str(link.delay_s), str(link.seed)]
        _started(stack, [*inside, *words], "ready")
        yield Machine(NEAR, near), Machine(FAR, far)


def _keeper(stack: ExitStack, words: list[str]) -> int:
    """A process that keeps its namespaces there; it ends at the end of its standard input, which is ours to close."""
    return _started(stack, [*words, "sh", "-c", "echo kept; read _"], "kept")


def _started(stack: ExitStack, command: list[str], said: str) -> int:
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    stack.callback(_end, process)
    assert process.stdout is not None
    if process.stdout.readline().strip() != said:
        raise RuntimeError(f"{command[0]} did not start: its line is above")
    return process.pid


def _end(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None and process.stdout is not None
    process.stdin.close()
    process.wait(_END_S)
    process.stdout.close()
