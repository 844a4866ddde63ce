"""Somebody's ROS graph for a test's fleet and mission: a master, an aPad and a /clock; and a short scenario."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import yaml
from programs import begun, done
from scenario_files import write_scenario

from apad_bridge.ros.simulated_node.apad_process import start_apad_node
from apad_bridge.ros.system.master import end_process, loopback_environment, start_master


def served_pool(path: Path, side_m: float, duration_s: float) -> Path:
    """Writes a scenario of four low aMussels in a square, which an aPad in its middle serves in a short time."""
    return write_scenario(
        path,
        duration_s=duration_s,
        theta=600,
        fleet={"count": 4, "start": {"charge": [0.5, 0.75]}},
        area={"polygon_m": [[0, 0], [side_m, 0], [side_m, side_m], [0, side_m]]},
        apad={"start_m": [side_m / 2, side_m / 2]},
        mission={"docking": {"dock_s": 3, "undock_s": 1}},
        board={"float_timeout_s": 432000},
    )


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
            stack.callback(end_process, start_apad_node(scenario, master.uri, folder / "apad.log"))
        for command in filter(None, (clock, boat)):
            process = subprocess.Popen(command, env=environment)
            stack.callback(process.wait, 180)
            stack.callback(process.terminate)
        yield environment


@contextmanager
def latched(shell: dict[str, str], topic: str, kind: str, message: str) -> Iterator[None]:
    """A message of rostopic's that stays, however late its reader connects: `pub -1` is gone after three seconds."""
    with begun(
        "/usr/bin/rostopic", "pub", "--latch", topic, kind, message, env=shell, ends_by=signal.SIGTERM
    ):
        yield


def called(shell: dict[str, str], service: str, request: str) -> dict[str, Any]:
    """The answer of one of a run's services to rosservice."""
    call = done("/usr/bin/rosservice", "call", f"/musselbed/{service}", request, env=shell)
    answer: dict[str, Any] = yaml.safe_load(call.stdout)
    return answer


def echoed(shell: dict[str, str], *words: object) -> dict[str, Any]:
    """The next message on a topic, by rostopic."""
    message: dict[str, Any] = next(
        yaml.safe_load_all(done("/usr/bin/rostopic", "echo", "-n", 1, *words, env=shell).stdout)
    )
    return message
