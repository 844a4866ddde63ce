"""One bench over two machines: the vehicle's with a fleet and a console, and the supervisor's, in network namespaces."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
from graphs import served_pool
from programs import MUSSELBED, done, left_full, lines_of
from rosbags.rosbag1 import Reader
from two_machines import Link, Machine, Programs, interrupt, master_uri, two_machines, why_no_two_machines

from apad_bridge.commands.prepare.run_preflight import recording_commands
from apad_bridge.scenario.loader import load

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(bool(why_no_two_machines()), reason=f"one machine only: {why_no_two_machines()}"),
]
PATIENCE_S = 240.0
SPEED = 4
ASK = """
import json, sys, urllib.request
url, order = sys.argv[1], sys.argv[2]
base, token = url.split("/?token=")
page = urllib.request.urlopen(url, timeout=180).read().decode()
ask = urllib.request.Request(base + "/orders", order.encode(), {"X-Musselbed-Token": token, "Origin": base})
answer = json.load(urllib.request.urlopen(ask, timeout=180))
print(json.dumps({"page": len(page), "has_mussels": "amussel" in page.lower(), **answer}))
"""


@dataclass
class Graph:
    """A master with an aPad and a /clock, on the vehicle's machine."""

    scenario: Path
    vehicle: Machine
    bench: Machine
    programs: Programs


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    # It lasts until it is ended: a busy machine takes long to serve its first.
    scenario = served_pool(tmp_path / "split.yaml", 4, 36_000)
    with ExitStack() as stack:
        vehicle, bench = stack.enter_context(two_machines(Link()))
        programs = Programs(tmp_path, master_uri(vehicle), stack)
        programs.start_master(vehicle)
        clock = [sys.executable, "-m", "apad_bridge.ros.system.clock_node", "--speed", str(SPEED)]
        programs.start(vehicle, "clock", *clock)
        programs.start(vehicle, "apad", *MUSSELBED, "apad", str(scenario), "--time", "clock")
        programs.wait_until(lambda: "ready" in programs.said("apad"), "no aPad")
        yield Graph(scenario, vehicle, bench, programs)


def test_fleet_mission_and_console_are_on_two_machines_and_the_run_stays_with_its_supervisor(
    graph: Graph,
) -> None:
    scenario, vehicle, bench = graph.scenario, graph.vehicle, graph.bench
    programs = graph.programs
    record, *_ = recording_commands(load(scenario), namespace="")
    recorder = programs.start(vehicle, "record", "bash", "-c", record)
    programs.wait_until(
        lambda: (programs.folder(vehicle) / "apad1.bag.active").exists(), "nothing is recorded"
    )
    fleet = programs.start(vehicle, "fleet", *MUSSELBED, "fleet", str(scenario), "--time", "ros")
    mission = programs.start(
        bench, "mission", *MUSSELBED, "mission", str(scenario), "--time", "ros", "--out", "run"
    )
    run = programs.folder(bench) / "run"
    programs.wait_until(lambda: record in programs.said("mission"), "the vehicle's command was not printed")
    programs.wait_until(lambda: lines_of(run, "belief"), "the fleet is not heard")

    console = programs.start(vehicle, "console", *MUSSELBED, "console", "--json")
    programs.wait_until(lambda: '"url"' in programs.said("console"), programs.said("console"))
    url = json.loads(programs.said("console").splitlines()[0])["url"]
    assert url.startswith("http://127.0.0.1:")
    order = json.dumps({"act": "remark", "by": "Ana", "text": "from the other machine"})
    answer = json.loads(done(*vehicle.command(sys.executable, "-c", ASK, url, order)).stdout)
    assert answer["accepted"] and answer["has_mussels"]

    programs.wait_until(lambda: left_full(run), "nobody was served")
    done(*bench.command(*MUSSELBED, "abort", str(run)))
    assert mission.wait(PATIENCE_S) == 0, programs.said("mission")
    programs.wait_until(
        lambda: '"ended_by"' in programs.said("console"), "the console was not told of the end"
    )
    interrupt(console)
    assert console.wait(PATIENCE_S) == 0
    assert [(it["text"], it["by"]) for it in lines_of(run, "remark")] == [("from the other machine", "Ana")]
    assert json.loads((run / "summary.json").read_text())["services"] == len(left_full(run)) > 0
    # On the other machine there are bags alone.
    there = programs.folder(vehicle)
    bag = there / "apad1.bag"
    interrupt(recorder)
    interrupt(fleet)
    fleet.wait(PATIENCE_S)
    programs.wait_until(bag.exists, "the bag was not closed")
    (of_fleet,) = (there / "runs").iterdir()
    assert {it for it in there.rglob("*") if it.is_file()} == {bag, of_fleet}, programs.said("fleet")
    with Reader(of_fleet) as reader:
        assert "/musselbed/truth" in {it.topic for it in reader.connections}
    with Reader(bag) as reader:
        topics = {it.topic for it in reader.connections}
    assert {"/apad1/position", "/musselbed/mission", "/musselbed/beliefs"} <= topics
    assert not [it for it in topics if it.startswith("/amussel")]


def test_a_console_without_a_run_on_the_master_says_so(graph: Graph) -> None:
    console = graph.programs.start(graph.bench, "console", *MUSSELBED, "console")
    assert console.wait(PATIENCE_S) == 3
    (line,) = graph.programs.said("console").splitlines()
    assert f"no run is on the master at {graph.programs.uri}: start `musselbed mission`" in line
