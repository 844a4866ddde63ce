"""Starts a nursery in a run directory: a fresh interpreter in a session of its own, which outlives its starter."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping

from agents.fleet_config import FleetConfig
from agents.hosting import started
from agents.hosting.interrupts import held_back, let_in
from agents.hosting.link_protocol import readable
from agents.mussel.physical import Physical
from agents.nursery.fleet_file import FleetFile, RestartPolicy
from firmware_model.packets.wire import MAX_AGENT_ID

READY_TIMEOUT_S = 20.0
LOG_NAME = "nursery.log"


class NurseryFailed(RuntimeError):
    """No nursery came up, for this reason."""


def prepare(
    run_dir: str | os.PathLike[str],
    fleet: FleetConfig,
    initial_states: Mapping[int, Physical],
    restart_policy: RestartPolicy | None = None,
) -> None:
    """Writes a nursery's files into an existing run directory.

    ValueError for an id that fits into no packet, FileExistsError if the directory has a fleet already.
    """
    for agent_id in initial_states:
        if not 0 <= agent_id <= MAX_AGENT_ID:
            raise ValueError(f"aMussel {agent_id}: ids are 0 to {MAX_AGENT_ID}")
    FleetFile(fleet, dict(initial_states), restart_policy or RestartPolicy()).write(os.fspath(run_dir))


def launch_nursery(run_dir: str | os.PathLike[str]) -> subprocess.Popen[bytes]:
    """Starts a nursery in a prepared directory and waits until it listens.

    NurseryFailed, with its own text, if it fails.
    """
    with held_back():
        return StartedNursery(run_dir).ready()


class StartedNursery:
    """A nursery in a prepared directory, whose starter waits for it later. Whoever makes it calls `ready` or `end`.

    It prints nothing on the caller's terminal: its messages go to `nursery.log` in the directory. Signals that ask to end
    are to be held back until then, since nobody else knows of the nursery.
    """

    def __init__(self, run_dir: str | os.PathLike[str]) -> None:
        self._log = os.path.join(run_dir, LOG_NAME)
        self._ready: int | None
        """The pipe by which the nursery says that it listens; None when nobody waits for that any more."""
        self._ready, writing = os.pipe()
        package_root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
        search = [package_root, *(entry for entry in sys.path if entry and entry != package_root)]
        try:
            with open(self._log, "ab") as log:
                self._process = subprocess.Popen(
                    # -S: PYTHONPATH has the whole path already, and site would import modules that no agent needs.
                    [*started.PYTHON, "-S", "-m", "agents.nursery", os.fspath(run_dir), str(writing)],
                    env={**os.environ, "PYTHONPATH": os.pathsep.join(search), **started.environment()},
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    pass_fds=[writing],
                    start_new_session=True,
                )
        except BaseException:
            os.close(self._ready)
            raise
        finally:
            os.close(writing)

    def ready(self) -> subprocess.Popen[bytes]:
        """Waits until the nursery listens, and lets signals in; NurseryFailed, with its own text, if it fails."""
        assert self._ready is not None  # nobody waits twice
        try:
            with let_in():
                _wait_until_ready(self._ready, self._log)
        except BaseException:
            # Ctrl-C too: nobody else knows of the nursery yet, and it would wait for a supervisor for ever.
            self.end()
            raise
        os.close(self._ready)
        self._ready = None
        return self._process

    def end(self) -> None:
        """Kills a nursery that its starter has not waited for; does nothing for another one."""
        if self._ready is not None:
            self._process.kill()
            self._process.wait()
            os.close(self._ready)
            self._ready = None


def _wait_until_ready(reading: int, log: str) -> None:
    answered = readable(reading, READY_TIMEOUT_S)
    message = (
        os.read(reading, 4096).decode() if answered else f"it was not ready within {READY_TIMEOUT_S:g} s\n"
    )
    if message != "ready\n":
        raise NurseryFailed(message.strip() or f"the nursery ended at once; see {log}")
