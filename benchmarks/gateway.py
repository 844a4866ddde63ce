"""A thousand aMussels on ROS: messages that a gateway publishes, messages that readers lose, and the reports' latency.

Each aMussel's position is published ten times a second and its battery once, over TCPROS on a master of our own; one
process reads all of it off the wire, and an ordinary rospy node reads some of it and measures latencies in its callbacks.
`lost` counts messages that were published and did not arrive at the reader of everything. In the row with a stalled
reader, another reader of everything is stopped with SIGSTOP once it is connected; `stalled_disconnected_s` is the time
from the first message that found a socket full to that connection's end.

`ticks` is a separate measurement: a flight at real time with 100 aMussels, a process each, at theta 30, beside the
simulated aPad's node at wall time and a control process that works for 20 ms ten times a second. A tick's lateness is
the time at which a rospy node receives its beliefs, against a grid of seconds through the earliest of them; the control
process measures its own lateness.
"""

from __future__ import annotations

import json
import os
import select
import signal
import statistics
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.table import Table

from apad_bridge.ros.system.master import loopback_environment, start_master
from benchmarks.rows import told

AGENTS, SHORT_AGENTS = 1000, 100
TICKS, SHORT_TICKS = 15, 5
STALLED_TICKS, SHORT_STALLED_TICKS = 45, 12
STALLED_BUFFER_BYTES = 4096
NODES = Path(__file__).parent / "nodes"
TIMEOUT_S = 120.0
FLOWN_AGENTS = 100
FLOWN_S, SHORT_S = 40, 10
SCENARIO = Path(__file__).parents[1] / "launch_scripts" / "scenarios" / "pool-12.yaml"
GUARDED = SCENARIO.with_name("real-apad.yaml")
KEYS = ("agents", "readers", "messages_per_s", "lost", "latency_p50_ms", "latency_p99_ms", "cpu_of_a_core")


def measure(short: bool = False) -> dict[str, Any]:
    agents, healthy_ticks, stalled_ticks, flown_s = (
        (SHORT_AGENTS, SHORT_TICKS, SHORT_STALLED_TICKS, SHORT_S)
        if short
        else (AGENTS, TICKS, STALLED_TICKS, FLOWN_S)
    )
    rows = [told(row(agents, healthy_ticks, stalled=False)), told(row(agents, stalled_ticks, stalled=True))]
    return {"rows": rows, "ticks": told(ticks(flown_s))}


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(title="The aMussels' topics, at 10 and 1 messages a second")
    for key in KEYS:
        table.add_column(key.replace("_", " "), justify="left" if key == "readers" else "right")
    for it in result["rows"]:
        table.add_row(*(f"{it[key]:.4g}" if isinstance(it[key], float) else str(it[key]) for key in KEYS))
    console.print(table)
    ticks = result["ticks"]
    console.print(
        f"a flight's ticks with {ticks['agents']} aMussels: {ticks['late_p50_ms']:.1f} ms late (p50), "
        f"{ticks['late_p99_ms']:.1f} ms (p99); the control process {ticks['control_late_p50_ms']:.2f} and "
        f"{ticks['control_late_p99_ms']:.1f} ms"
    )
    stalled = result["rows"][-1]
    console.print(
        f"the stalled reader was left out {stalled['stalled_left_out']} times and lost "
        f"{stalled['stalled_disconnected']} of {2 * stalled['agents']} connections, each within "
        f"{stalled['stalled_disconnected_s']:.2f} s of the first message that found its socket full"
    )


def row(agents: int, ticks: int, *, stalled: bool) -> dict[str, Any]:
    with ExitStack() as stack:
        _, environment = on_master(stack)
        listened = map(str, range(1, agents + 1, agents // 20))
        gateway = Node(stack, environment, str(NODES / "gateway.py"), str(agents))
        _, open_s, uri = gateway.line().split()
        reader = Node(stack, environment, str(NODES / "tcpros_reader.py"), uri, "everything", str(agents))
        ranging = Node(stack, environment, str(NODES / "rospy_reader.py"), *listened)
        assert reader.line() == ranging.line() == "reading"
        if stalled:
            stopped = Node(
                stack,
                environment,
                str(NODES / "tcpros_reader.py"),
                uri,
                "stalled",
                str(agents),
                str(STALLED_BUFFER_BYTES),
            )
            assert stopped.line() == "reading"
            os.kill(stopped.process.pid, signal.SIGSTOP)
        gateway.write_line(f"tick {ticks}")
        assert gateway.line() == "ticked"
        published = json.loads(gateway.end())
        received = json.loads(reader.end())
        latencies_ms = sorted(json.loads(ranging.end()))
        return {
            "agents": agents,
            "readers": "one is stalled" if stalled else "healthy",
            "open_s": float(open_s),
            "messages_per_s": published["published"] / published["took_s"],
            "lost": published["published"] - received["messages"],
            "latency_p50_ms": statistics.median(latencies_ms),
            "latency_p99_ms": latencies_ms[int(0.99 * len(latencies_ms))],
            "cpu_of_a_core": published["cpu_s"] / published["took_s"],
            "stalled_left_out": sum(published["left_out"].values()),
            "stalled_disconnected_s": published["longest_stall_s"],
            "stalled_disconnected": sum(published["disconnected"].values()),
        }


def ticks(duration_s: int = FLOWN_S) -> dict[str, Any]:
    with ExitStack() as stack:
        home, environment = on_master(stack)
        scenario = home / "flown.yaml"
        scenario.write_text(yaml.safe_dump(flown(duration_s)))
        # Before it is ready, the checks find an aPad without its origin.
        assert apad_node(stack, environment, scenario).line() == "ready"
        reader = Node(stack, environment, str(NODES / "tick_reader.py"))
        assert reader.line() == "reading"
        control = Node(stack, environment, str(NODES / "control.py"))
        command = [sys.executable, "-m", "apad_bridge.commands.main", "run", str(scenario), "--apad", "ros"]
        subprocess.run(
            [*command, "--time", "wall", "--json", "--out", str(home / "run")],
            env=environment,
            check=True,
            stdout=subprocess.DEVNULL,
            timeout=duration_s + TIMEOUT_S,
        )
        late_ms = lateness_ms(json.loads(reader.end()))
        return {
            "agents": FLOWN_AGENTS,
            "theta": 30,
            "ticks": len(late_ms),
            "late_p50_ms": statistics.median(late_ms),
            "late_p99_ms": late_ms[int(0.99 * len(late_ms))],
            "control_late_p50_ms": statistics.median(control_ms := sorted(json.loads(control.end()))),
            "control_late_p99_ms": control_ms[int(0.99 * len(control_ms))],
        }


def flown(duration_s: float = FLOWN_S, agents: int = FLOWN_AGENTS) -> dict[str, Any]:
    """The pool scenario with more aMussels, for less time, with guards that the checks of a vehicle over ROS ask for.

    The bounds on a position's age stay those of a slow link, so that a busy machine does not end the measurement.
    """
    scenario: dict[str, Any] = yaml.safe_load(SCENARIO.read_text())
    scenario["duration_s"] = duration_s
    scenario["area"] |= {"fence": [[-50, -50], [80, -50], [80, 80], [-50, 80]], "home_m": [14, 10.5]}
    guards = yaml.safe_load(GUARDED.read_text())["guards"]
    scenario["guards"] = guards | {"battery_reserve": 0.1, "position_age_s": 10, "frozen_s": 10}
    scenario["fleet"] |= {"count": agents, "start": {"charge": [0.5, 0.9]}}
    return scenario


def lateness_ms(heard: list[tuple[float, float]]) -> list[float]:
    """Sorted; the first tick is left out: it waits for the fleet to be ready."""
    offsets_s = [at_s - mission_s for mission_s, at_s in heard[1:]]
    return sorted(1000 * (offset_s - min(offsets_s)) for offset_s in offsets_s)


def on_master(stack: ExitStack) -> tuple[Path, dict[str, str]]:
    """A folder and a master that end with the stack, and the environment of nodes, which find these benchmarks."""
    home = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="musselbed-")))
    master = start_master(home, timeout_s=20, orphan_s=0)
    stack.callback(master.stop)
    return home, loopback_environment(home, master.uri) | {"PYTHONPATH": str(NODES.parents[1])}


class Node:
    """One Python program as a process; reads its lines with a time-out."""

    def __init__(self, stack: ExitStack, environment: dict[str, str], *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, *arguments],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        stack.callback(self._kill)

    def line(self) -> str:
        assert self.process.stdout is not None
        if not select.select([self.process.stdout], [], [], TIMEOUT_S)[0]:
            raise RuntimeError(f"{self.process.args!r} said nothing for {TIMEOUT_S:g} s")
        return self.process.stdout.readline().strip()

    def write_line(self, line: str) -> None:
        assert self.process.stdin is not None
        print(line, file=self.process.stdin, flush=True)

    def end(self) -> str:
        assert self.process.stdin is not None
        self.process.stdin.close()
        return self.line()

    def _kill(self) -> None:
        self.process.kill()
        self.process.wait()


def apad_node(stack: ExitStack, environment: dict[str, str], scenario: Path) -> Node:
    """The simulated aPad at wall time; it says when it is ready."""
    words = ("-m", "apad_bridge.ros.simulated_node.apad_node", "--scenario", str(scenario), "--time", "wall")
    return Node(stack, environment, *words)
