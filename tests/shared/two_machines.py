"""Two machines on one network, each a network namespace with a loopback of its own; the link between them; and programs."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from lossy_link import FAR, NEAR

_LINK = Path(__file__).with_name("lossy_link.py")
_ENDS_WITH_STARTER = Path(__file__).with_name("ends_with_starter.py")
_END_S = 10.0
_MASTER_PORT = 11311
NOTHING: Mapping[str, str] = {}


@dataclass(frozen=True, slots=True)
class Link:
    """Each packet is lost with the probability `loss`, or arrives `delay_s` later, either way."""

    loss: float = 0.0
    delay_s: float = 0.0
    seed: int = 1


class Lose(Protocol):
    """Changes a link: each packet is lost with the probability `share`, 1 cuts it, or arrives `delay_s` later."""

    def __call__(self, share: float, delay_s: float = ..., /) -> None: ...


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
    with linked_machines(link) as (near, far, _):
        yield near, far


@contextmanager
def linked_machines(link: Link) -> Iterator[tuple[Machine, Machine, Lose]]:
    """`two_machines`, and a function that changes their link."""
    with ExitStack() as stack:
        near = _keeper(stack, ["unshare", "-rn"])
        inside = ["nsenter", "-t", str(near), "-U", "-n", "--preserve-credentials"]
        far = _keeper(stack, [*inside, "unshare", "-n"])
        words = [sys.executable, str(_LINK), str(far), str(link.loss), str(link.delay_s), str(link.seed)]
        carrier = _started(stack, [*inside, *words], "ready")

        def lose(share: float, delay_s: float = link.delay_s) -> None:
            assert carrier.stdin is not None
            carrier.stdin.write(f"{share} {delay_s}\n")
            carrier.stdin.flush()

        yield Machine(NEAR, near), Machine(FAR, far), lose


@dataclass
class Programs:
    """Programs of machines that share a ROS master at `uri`. Each ends with `stack`, or with this process.

    A program runs in a folder of its machine below `home`; what it says is in home/NAME.out.
    """

    home: Path
    uri: str
    stack: ExitStack
    patience_s: float = 240.0

    def folder(self, machine: Machine) -> Path:
        folder = self.home / machine.address
        folder.mkdir(exist_ok=True)
        return folder

    def start(
        self,
        machine: Machine,
        name: str,
        *words: str,
        environment: Mapping[str, str] = NOTHING,
        errors: Path | None = None,
    ) -> subprocess.Popen[bytes]:
        """A program in a session of its own; `errors` receives its standard error apart from what it says."""
        with ExitStack() as files:
            said = files.enter_context((self.home / f"{name}.out").open("w"))
            process = subprocess.Popen(
                [sys.executable, str(_ENDS_WITH_STARTER), *machine.command(*words)],
                stdin=subprocess.PIPE,
                stdout=said,
                stderr=subprocess.STDOUT if errors is None else files.enter_context(errors.open("w")),
                env={**machine.environment(self.uri), "ROS_HOME": str(self.home / "ros"), **environment},
                cwd=self.folder(machine),
                start_new_session=True,
            )
        self.stack.callback(_end_group, process)
        return process

    def start_master(self, machine: Machine, *before: str, environment: Mapping[str, str] = NOTHING) -> None:
        """The master at `uri`; `before` are words before its own, such as faketime's."""
        self.start(machine, "master", *before, "/usr/bin/rosmaster", "--core", environment=environment)
        connect = f"import socket; socket.create_connection(({machine.address!r}, {_MASTER_PORT}), 1).close()"
        answers = machine.command(sys.executable, "-c", connect)
        self.wait_until(
            lambda: subprocess.run(answers, stderr=subprocess.DEVNULL).returncode == 0,
            "the master does not answer",
        )

    def said(self, name: str) -> str:
        return (self.home / f"{name}.out").read_text()

    def wait_until(self, is_so: Callable[[], object], failure: str) -> None:
        """Files and other machines announce nothing, so it is polled. TimeoutError with `failure`."""
        until_s, pause = time.monotonic() + self.patience_s, threading.Event()
        while not is_so():
            if time.monotonic() > until_s:
                raise TimeoutError(failure)
            pause.wait(0.1)


def master_uri(machine: Machine) -> str:
    return f"http://{machine.address}:{_MASTER_PORT}"


def interrupt(process: subprocess.Popen[bytes]) -> None:
    """Ctrl-C in the program's terminal."""
    os.killpg(process.pid, signal.SIGINT)


def _end_group(process: subprocess.Popen[bytes]) -> None:
    """Ends it and all of its group, which may outlive it."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_END_S)
    assert process.stdin is not None
    process.stdin.close()


def _keeper(stack: ExitStack, words: list[str]) -> int:
    """A process that keeps its namespaces there; it ends at the end of its standard input, which is ours to close."""
    return _started(stack, [*words, "sh", "-c", "echo kept; read _"], "kept").pid


def _started(stack: ExitStack, command: list[str], said: str) -> subprocess.Popen[str]:
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    stack.callback(_end, process)
    assert process.stdout is not None
    if process.stdout.readline().strip() != said:
        raise RuntimeError(f"{command[0]} did not start: its line is above")
    return process


def _end(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None and process.stdout is not None
    process.stdin.close()
    process.wait(_END_S)
    process.stdout.close()
