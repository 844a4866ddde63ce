"""One bench over two machines: the vehicle's with a fleet and a console, and the supervisor's, in network namespaces."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.rosbag1 import Reader
from scenario_files import POOL_FILE
from two_machines import Link, Machine, two_machines, why_no_two_machines

from apad_bridge.commands.preflight_checks import recording_commands
from apad_bridge.records.journal import read_journal
from apad_bridge.scenario.loader import load

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(bool(why_no_two_machines()), reason=f"one machine only: {why_no_two_machines()}"),
]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
PATIENCE_S = 240.0
SPEED = 4
ASK = """
import json, sys, urllib.request
url, order = sys.argv[1], sys.argv[2]
opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
page = opener.open(url, timeout=60).read().decode()
ask = urllib.request.Request(url.partition("?")[0] + "orders", order.encode(), {"Content-Type": "application/json"})
print(json.dumps({"page": len(page), "has_mussels": "amussel" in page.lower(), **json.load(opener.open(ask, timeout=60))}))
"""


@dataclass
class Graph:
    """A master with an aPad and a /clock, on the vehicle's machine."""

    scenario: Path
    vehicle: Machine
    bench: Machine
    home: Path
    uri: str
    stack: ExitStack

    def start(self, machine: Machine, name: str, *words: str) -> subprocess.Popen[str]:
        """A program there, in a folder of that machine; what it says is in NAME.out."""
        folder = self.home / machine.address
        folder.mkdir(exist_ok=True)
        said = self.stack.enter_context((self.home / f"{name}.out").open("w"))
        process = subprocess.Popen(
            machine.command(*words),
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
            env=machine.environment(self.uri) | {"ROS_HOME": str(self.home / "ros")},
            cwd=folder,
            text=True,
            start_new_session=True,
        )
        self.stack.callback(end, process)
        return process

    def said(self, name: str) -> str:
        return (self.home / f"{name}.out").read_text()


def end(process: subprocess.Popen[str]) -> None:
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(10)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            pass


def wait_until(is_so: Callable[[], object], what: str) -> None:
    """Files and other machines announce nothing, so it is polled."""
    until_s, pause = time.monotonic() + PATIENCE_S, threading.Event()
    while not is_so():
        assert time.monotonic() < until_s, what
        pause.wait(0.1)


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    data: dict[str, Any] = yaml.safe_load(POOL_FILE.read_text())
    data.update(name="split", duration_s=150, theta=600)
    data["fleet"].update(count=4, start={"charge": [0.5, 0.75]})
    data["area"]["polygon_m"] = [[0, 0], [4, 0], [4, 4], [0, 4]]
    data["apad"]["start_m"] = [2, 2]
    scenario = tmp_path / "split.yaml"
    scenario.write_text(yaml.safe_dump(data))
    with ExitStack() as stack:
        vehicle, bench = stack.enter_context(two_machines(Link()))
        uri = f"http://{vehicle.address}:11311"
        graph = Graph(scenario, vehicle, bench, tmp_path, uri, stack)
        graph.start(vehicle, "master", "/usr/bin/rosmaster", "--core")
        connect = f"import socket; socket.create_connection(({vehicle.address!r}, 11311), 1).close()"
        answers = vehicle.command(sys.executable, "-c", connect)
        wait_until(lambda: subprocess.run(answers, stderr=subprocess.DEVNULL).returncode == 0, "no master")
        clock = [sys.executable, "-m", "apad_bridge.ros.system.clock_node", "--speed", str(SPEED)]
        graph.start(vehicle, "clock", *clock)
        graph.start(vehicle, "apad", *MUSSELBED, "apad", str(scenario), "--time", "clock")
        wait_until(lambda: "ready" in graph.said("apad"), "no aPad")
        yield graph


def test_fleet_mission_and_console_are_on_two_machines_and_the_run_stays_with_its_supervisor(
    graph: Graph,
) -> None:
    scenario, vehicle, bench = graph.scenario, graph.vehicle, graph.bench
    record, *_ = recording_commands(load(scenario), namespace="")
    recorder = graph.start(vehicle, "record", "bash", "-c", record)
    wait_until(lambda: (graph.home / vehicle.address / "apad1.bag.active").exists(), "nothing is recorded")
    graph.start(vehicle, "fleet", *MUSSELBED, "fleet", str(scenario), "--time", "ros")
    mission = graph.start(
        bench, "mission", *MUSSELBED, "mission", str(scenario), "--time", "ros", "--out", "run"
    )
    run = graph.home / bench.address / "run"
    wait_until(lambda: record in graph.said("mission"), "the vehicle's command was not printed")
    journal = run / "journal.jsonl"
    wait_until(
        lambda: journal.exists() and '"kind":"belief"' in journal.read_text(), "the fleet is not heard"
    )

    console = graph.start(vehicle, "console", *MUSSELBED, "console", "--json")
    wait_until(lambda: '"url"' in graph.said("console"), graph.said("console"))
    url = json.loads(graph.said("console").splitlines()[0])["url"]
    assert url.startswith("http://127.0.0.1:")
    order = json.dumps({"act": "remark", "by": "Ana", "text": "from the other machine"})
    asked = subprocess.run(
        vehicle.command(sys.executable, "-c", ASK, url, order),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert asked.returncode == 0, asked.stderr
    answer = json.loads(asked.stdout)
    assert answer["accepted"] and answer["has_mussels"]

    assert mission.wait(PATIENCE_S) == 0, graph.said("mission")
    wait_until(lambda: '"ended_by"' in graph.said("console"), "the console was not told of the end")
    console.send_signal(signal.SIGINT)
    assert console.wait(PATIENCE_S) == 0
    remarks = [it for it in read_journal(journal).lines if it["kind"] == "remark"]
    assert [(it["text"], it["by"]) for it in remarks] == [("from the other machine", "Ana")]
    assert json.loads((run / "summary.json").read_text())["services"] > 0
    # On the other machine there are the fleet's own run and the bag.
    there = graph.home / vehicle.address
    assert not [it for it in there.rglob("journal.jsonl") if '"kind":"dock"' in it.read_text()]
    bag = there / "apad1.bag"
    os.killpg(recorder.pid, signal.SIGINT)
    wait_until(bag.exists, "the bag was not closed")
    with Reader(bag) as reader:
        topics = {it.topic for it in reader.connections}
    assert {"/apad1/position", "/musselbed/mission", "/musselbed/beliefs"} <= topics
    assert not [it for it in topics if it.startswith("/amussel")]


def test_a_console_without_a_run_on_the_master_says_so(graph: Graph) -> None:
    console = graph.start(graph.bench, "console", *MUSSELBED, "console")
    assert console.wait(PATIENCE_S) == 3
    (line,) = graph.said("console").splitlines()
    assert f"no run is on the master at {graph.uri}: start `musselbed mission`" in line
