"""A ROS master of a run's own: a process in its own session, on a free loopback port.

It never joins a master that runs already: it binds a port that the kernel picks, and the process that answers there must be
the one that was started, by its pid. A run on somebody else's master connects to that URI and does not use this module.
"""

from __future__ import annotations

import os
import selectors
import subprocess
import sys
import time
import xmlrpc.client
from dataclasses import dataclass, field
from http.client import HTTPException
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from agents.hosting.interrupts import held_back, let_in
from apad_bridge.doctor.network import Timed

ORPHAN_S = 600.0
"""A master outlives its starter by this by default, once it is ready: long enough for `musselbed resume` to find the
run's nodes alive."""

_PROGRAM = Path(__file__).with_name("master_process.py")
_LOG = "master.log"
_ANSWER_S = 3.0
_KILLED_S = 60.0
"""The longest time that a killed process may take to be gone: on a busy machine more than a second."""


class MasterFailed(Exception):
    """No master answers. The text is one line with the consequence. No process was left running."""


@dataclass(slots=True)
class Master:
    """A running master. `stop()` ends it. If its starter dies before, it ends by itself after `orphan_s`."""

    uri: str
    process: subprocess.Popen[bytes] = field(repr=False)

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def stop(self, timeout_s: float = 3.0) -> None:
        """Ends the master by its pid: by SIGTERM, and after `timeout_s` by SIGKILL. Does nothing when it is gone."""
        end_process(self.process, timeout_s)


def start_master(home: Path, timeout_s: float, orphan_s: float = ORPHAN_S) -> Master:
    """Starts a master that keeps its files in `home` (made if it is missing), and returns when it answers XML-RPC.

    Raises:
        MasterFailed: it did not answer within `timeout_s`; it has been ended and no node was started. Or there is no ROS.
    """
    if find_spec("rosmaster") is None:
        raise MasterFailed(f"{sys.executable} sees no ROS 1: fly by --time asap, or see docs/install.md")
    home.mkdir(parents=True, exist_ok=True)
    log = home / _LOG
    deadline_s = time.monotonic() + timeout_s
    with held_back():
        with open(home / "master.err", "ab") as errors:
            process = subprocess.Popen(
                [sys.executable, "-I", str(_PROGRAM), str(log.absolute()), str(orphan_s)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=loopback_environment(home),
                start_new_session=True,
            )
        try:
            with let_in():
                uri = _printed_uri(process, deadline_s)
                _check_answer(uri, process.pid, deadline_s)
            _let_it_outlive_us(process)
        except MasterFailed as error:
            end_process(process, 1.0)
            raise MasterFailed(
                f"the embedded ROS master {error}: no node was started; see {home / 'master.err'}"
            ) from None
        except BaseException:
            end_process(process, 1.0)
            raise
    return Master(uri, process)


def loopback_environment(home: Path, master_uri: str | None = None) -> dict[str, str]:
    """The environment of a run's own ROS nodes: loopback only, without the caller's ROS and Python settings.

    The caller's ROS_HOSTNAME, ROS_NAMESPACE, ROS_IPV6 or PYTHONPATH would send nodes elsewhere, rename them or shadow code.
    """
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(("ROS_", "PYTHON"))
    }
    environment |= {"ROS_IP": "127.0.0.1", "ROS_HOME": str(home.absolute())}
    if master_uri is not None:
        environment["ROS_MASTER_URI"] = master_uri
    return environment


def _printed_uri(process: subprocess.Popen[bytes], deadline_s: float) -> str:
    assert process.stdout is not None
    printed = b""
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        while not printed.endswith(b"\n"):
            if not selector.select(max(0.0, deadline_s - time.monotonic())):
                raise MasterFailed("did not bind a port in time")
            if not (piece := os.read(process.stdout.fileno(), 1024)):
                raise MasterFailed(f"ended with exit code {process.wait(timeout=5)}")
            printed += piece
    return printed.decode().strip()


def _let_it_outlive_us(process: subprocess.Popen[bytes]) -> None:
    assert process.stdin is not None
    try:
        process.stdin.write(b"stay\n")
        process.stdin.flush()
    except BrokenPipeError:
        raise MasterFailed("ended while it started") from None


def why_gone_of(home: Path, uri: str) -> str | None:
    """One line for a master of this `home` that answers no more at its URI; None for one that does, or that stands still.

    Another program may have its port now, and another run's master is no master of this run.
    """
    gone = f"the run's own ROS master at {uri} is gone"
    try:
        code, _, pid = _ask_pid(uri, _ANSWER_S)
    except TimeoutError:
        return None
    except (OSError, HTTPException, xmlrpc.client.Error, ValueError, TypeError) as error:
        return f"{gone} ({error})"
    try:
        words = Path(f"/proc/{int(pid)}/cmdline").read_text().split("\0") if code == 1 else []
    except (OSError, ValueError, TypeError):
        words = []
    return None if str((home / _LOG).absolute()) in words else f"{gone} (another program answers there)"


def _ask_pid(uri: str, timeout_s: float) -> Any:
    with xmlrpc.client.ServerProxy(uri, transport=Timed(timeout_s)) as master:
        return master.getPid("/musselbed")


def _check_answer(uri: str, pid: int, deadline_s: float) -> None:
    try:
        answer = _ask_pid(uri, max(0.1, deadline_s - time.monotonic()))
    except (OSError, HTTPException, xmlrpc.client.Error) as error:
        raise MasterFailed(f"at {uri} does not answer ({error})") from None
    if answer != [1, "", pid]:
        raise MasterFailed(f"at {uri} is not the process {pid} that was started (it says {answer!r})")


def end_process(process: subprocess.Popen[bytes], patience_s: float = 3.0) -> int:
    """Asks a process to end, kills it after `patience_s`, and returns its status. One that has ended is reaped."""
    process.terminate()
    try:
        process.wait(patience_s)
    except subprocess.TimeoutExpired:
        process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    return process.wait(_KILLED_S)
