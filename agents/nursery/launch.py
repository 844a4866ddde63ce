"""Brings a nursery to life in a run directory: a fresh interpreter in a session of its own, that outlives its starter."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping

from agents.fleet import FleetConfig
from agents.hosting.interrupts import held_back
from agents.hosting.link_protocol import readable
from agents.mussel.physical import Physical
from agents.nursery.fleet_file import MAX_AGENT_ID, FleetFile, RestartPolicy

READY_TIMEOUT_S = 20.0
LOG_NAME = "nursery.log"


class NurseryFailed(RuntimeError):
    """Why there is no nursery."""


def prepare(
    run_dir: str | os.PathLike[str],
    fleet: FleetConfig,
    initial_states: Mapping[int, Physical],
    restart_policy: RestartPolicy | None = None,
) -> None:
    """Writes what a nursery needs into an existing run directory.

    ValueError for an id that fits into no packet, FileExistsError where a fleet lives already.
    """
    for agent_id in initial_states:
        if not 0 <= agent_id <= MAX_AGENT_ID:
            raise ValueError(f"aMussel {agent_id}: ids are 0 to {MAX_AGENT_ID}")
    FleetFile(fleet, dict(initial_states), restart_policy or RestartPolicy()).write(os.fspath(run_dir))


def launch_nursery(run_dir: str | os.PathLike[str]) -> subprocess.Popen[bytes]:
    """Starts a nursery in a prepared directory and waits until it listens; NurseryFailed, in its own words, if it does not.

    It says no word on the caller's terminal: what it has to tell goes to `nursery.log` in the directory.
    """
    reading, writing = os.pipe()
    package_root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
    search = [package_root, *(entry for entry in sys.path if entry and entry != package_root)]
    with held_back() as let_in:
        try:
            with open(os.path.join(run_dir, LOG_NAME), "ab") as log:
                process = subprocess.Popen(
                    # -S: the path is handed over ready, and site would bring modules that no agent needs.
                    [sys.executable, "-S", "-m", "agents.nursery", os.fspath(run_dir), str(writing)],
                    env={**os.environ, "PYTHONPATH": os.pathsep.join(search)},
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    pass_fds=[writing],
                    start_new_session=True,
                )
        finally:
            os.close(writing)
        try:
            let_in()
            _wait_until_ready(reading, os.path.join(run_dir, LOG_NAME))
        except BaseException:
            # Ctrl-C too: nobody else knows of it yet, and it would wait for a supervisor for ever.
            process.kill()
            process.wait()
            raise
        finally:
            os.close(reading)
    return process


def _wait_until_ready(reading: int, log: str) -> None:
    heard = readable(reading, READY_TIMEOUT_S)
    word = os.read(reading, 4096).decode() if heard else f"it was not ready within {READY_TIMEOUT_S:g} s\n"
    if word != "ready\n":
        raise NurseryFailed(word.strip() or f"the nursery ended at once; {log} says why")
