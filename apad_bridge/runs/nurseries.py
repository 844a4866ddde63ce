"""The nursery of a run: started by the parent, adopted by each of its supervisors in turn."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Sequence
from pathlib import Path

from agents.coordinator import Coordinator
from agents.launch import NoNursery, launch_nursery, prepare
from agents.processes import Fenced, ProcessHost
from apad_bridge import building
from apad_bridge.flight import Fleet
from apad_bridge.runs.failures import PeerFailed
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start

FOLDER = "fleet"


def start_nursery(scenario: Scenario, starts: Sequence[Start], run_dir: Path) -> subprocess.Popen[bytes]:
    """A nursery with its fleet prepared in the run's directory; its agents start when a supervisor adopts them."""
    folder = run_dir / FOLDER
    folder.mkdir()
    prepare(str(folder), building.fleet_config(scenario), building.births(scenario, starts))
    try:
        return launch_nursery(str(folder))
    except NoNursery as error:
        raise PeerFailed(f"the fleet cannot start: {error}; see {folder}/nursery.log") from error


def end_nursery(nursery: subprocess.Popen[bytes], timeout_s: float) -> None:
    """Ends it, and with it its agents, if its supervisor has not done so."""
    if nursery.poll() is None:
        nursery.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            nursery.wait(timeout_s)
            return
        nursery.kill()
        nursery.wait(timeout_s)


def adopt(scenario: Scenario, run_dir: Path, epoch: int, now_ms: int) -> Fleet:
    """The run's fleet under supervisor number `epoch`, at mission time `now_ms`."""
    try:
        host = ProcessHost.adopt(str(run_dir / FOLDER), epoch)
    except (NoNursery, Fenced) as error:
        raise PeerFailed(f"the fleet cannot be taken over: {error}") from error
    return Fleet(Coordinator(host, host.granted_ms, scenario.theta, now_ms), host)
