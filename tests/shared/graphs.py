"""Somebody's ROS graph for a test's fleet and mission: a master, an aPad and a /clock; and a short scenario."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import yaml
from journals import Line, lines_in
from patient import PATIENCE_S
from scenario_files import POOL_FILE

from apad_bridge.ros.simulated_node.apad_process import start_apad_node, stop_apad_node
from apad_bridge.ros.system.master import loopback_environment, start_master


def served_pool(path: Path, side_m: float, duration_s: float) -> Path:
    """Writes a scenario of four low aMussels in a square, which an aPad in its middle serves in a short time."""
    data = yaml.safe_load(POOL_FILE.read_text())
    data.update(name=path.stem, duration_s=duration_s, theta=600)
    data["fleet"].update(count=4, start={"charge": [0.5, 0.75]})
    data["area"]["polygon_m"] = [[0, 0], [side_m, 0], [side_m, side_m], [0, side_m]]
    data["apad"]["start_m"] = [side_m / 2, side_m / 2]
    data["mission"]["docking"].update(dock_s=3, undock_s=1)
    data["board"]["float_timeout_s"] = 432000
    path.write_text(yaml.safe_dump(data))
    return path


@contextmanager
def somebodys_graph(
    scenario: Path, folder: Path, speed: float, boat: Sequence[str] = ()
) -> Iterator[dict[str, str]]:
    """A master with an aPad on it, and a /clock `speed` times as fast as the wall's; gives the shell's environment.

    `boat` is the command of another vehicle in place of the simulated aPad.
    """
    with ExitStack() as stack:
        master = start_master(folder / "ros", 120)
        stack.callback(master.stop)
        environment = {**os.environ, **loopback_environment(folder / "ros", master.uri)}
        clock = [sys.executable, "-m", "apad_bridge.ros.system.clock_node", "--speed", str(speed)]
        if not boat:
            stack.callback(stop_apad_node, start_apad_node(scenario, master.uri, folder / "apad.log"))
        for command in filter(None, (clock, boat)):
            process = subprocess.Popen(command, env=environment)
            stack.callback(process.wait, 180)
            stack.callback(process.terminate)
        yield environment


def lines_of(run: Path) -> list[Line]:
    """The lines of its journal so far."""
    return lines_in(run / "journal.jsonl")


def wait_until(holds: Callable[[], bool], *flights: subprocess.Popen[str]) -> None:
    """Until it holds while the flights go on. Files announce nothing, so it is polled."""
    until_s, pause = time.monotonic() + PATIENCE_S, threading.Event()
    while not holds():
        assert time.monotonic() < until_s and all(it.poll() is None for it in flights)
        pause.wait(0.5)
