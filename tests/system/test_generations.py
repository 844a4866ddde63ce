"""The links to a fleet and to an aPad over real TCPROS: a master, the simulated aPad's node and gateways are processes."""

from __future__ import annotations

import json
import select
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from graphs import latched
from killing import standing_still
from patient import PATIENCE_S
from programs import MUSSELBED, ROOT, Begin, done, line_of, lines_of, musselbed, wait_until
from scenario_files import silent_in_its_dock, write_scenario

from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.ros.simulated_node.apad_process import APadNodeFailed, start_apad_node
from apad_bridge.ros.system.master import Master, loopback_environment
from apad_bridge.ros.system.route import free_port
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system


@pytest.fixture
def start(tmp_path: Path, begin: Begin) -> Begin:
    """Starts a program of this folder as a node on the master at an address."""

    def started(uri: str, program: str, *arguments: str) -> subprocess.Popen[str]:
        return begin(
            sys.executable,
            "-m",
            f"tests.system.{program}",
            *arguments,
            env=loopback_environment(tmp_path / "ros", uri),
            stdin=subprocess.PIPE,
            ends_by=signal.SIGKILL,
        )

    return started


def four(path: Path, duration_s: float, **changes: Any) -> Path:
    """Four aMussels that are candidates from the start and charged within a minute."""
    starts = path.with_suffix(".csv")
    starts.write_text("id,north,east,battery\n1,2,3,0.75\n2,4,8,0.74\n3,9,5,0.70\n4,8,9,0.72\n")
    fleet = {"count": 4, "start": str(starts)}
    changes["apad"] = {"start_m": [6, 6], **changes["apad"]}
    return write_scenario(path, theta=600, duration_s=duration_s, fleet=fleet, **changes)


def heard_from(process: subprocess.Popen[str]) -> str:
    """Its next line, or AssertionError when it says nothing."""
    assert process.stdout is not None
    readable, _, _ = select.select([process.stdout], [], [], PATIENCE_S)
    assert readable, "it said nothing"
    return line_of(process)


def test_a_charge_of_which_no_packet_came_counts_by_the_docks_own_service(tmp_path: Path) -> None:
    """Generation A's service names who is in its docks."""
    path, out = tmp_path / "silent.yaml", tmp_path / "run"
    loader.write_resolved(path, silent_in_its_dock("a"))
    summary = json.loads(musselbed("run", path, "--speed", 500, "--json", "--out", out).stdout)
    assert [it["full"] for it in lines_of(out, "released")] == [True]
    assert summary["services"] == 1 and not lines_of(out, "docks_disagree")
    assert not [cause for cause in summary["causes"] if "the aMussel is not heard in it" in cause]


def test_the_vehicles_own_eyes_dock_simulated_amussels_that_a_camera_shows_them(tmp_path: Path) -> None:
    """Same plan, slots and order as in virtual time, where a docking takes what the scenario says and not what it takes."""
    servo = {
        "search_yaw_rate_rad_s": 0.2,
        "max_yaw_rate_rad_s": 0.3,
        "max_surge_m_s": 0.15,
        "surge_stdev": 0.2,
        "search_s": 120,
    }
    docking = {"profile": "camera", "timeout_s": 150, "servo": servo}
    path = four(
        tmp_path / "camera.yaml",
        450,
        mission={"docking": docking, "batch": 2, "silence_timeout_s": 400},
        apad={"generation": "b", "drift_m_s": [0.01, -0.02]},
    )
    decided, legs_m, flown = [], [], {}
    for name, options in (("ros", ("--speed", 500)), ("asap", ("--time", "asap"))):
        out = tmp_path / name
        musselbed("run", path, *options, "--hosting", "one_process", "--out", out)
        flown[name] = json.loads((out / "summary.json").read_text())
        steps = [(it["agent"], it["dock"], True) for it in lines_of(out, "plan")[0]["steps"]]
        docks = [(it["agent"], it["dock"], it["closed"]) for it in lines_of(out, "dock")[:2]]
        assert docks == steps and len(docks) == 2
        decided.append(docks)
        legs_m.append([it["metres"] for it in lines_of(out, "leg")[:2]])
    assert decided[0] == decided[1]
    assert flown["ros"]["first_cause"] is None and flown["ros"]["dropped"] == {}
    # Where the vehicle ends up after a docking by eye is its own business: a metre a docking.
    assert legs_m[0] == pytest.approx(legs_m[1], abs=1.0)


READY = """
import sys
from pathlib import Path
from agents.time_scale import TimeScale
from apad_bridge.assembly.safety import safety_of
from apad_bridge.assembly.stacks import part_of, stack_of
from apad_bridge.ros.gateway.gateway import open_gateway
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.link_errors import VehicleNotReady
scenario = load(Path(sys.argv[1]))
gateway = open_gateway([7], TimeScale(1), node_name="bench")
open_link = part_of(stack_of(scenario.apad.generation).generation, "ros.link", "open_link")
try:
    opened = open_link(scenario, safety_of(scenario).gate, lambda now_ms: {}, {}, 0, our_clock=True)
    opened.link.wait_until_ready(float(sys.argv[2]))
except VehicleNotReady as error:
    print(error)
gateway.close()
"""
"""Waits so long for an aPad, and prints why none is there."""


def test_without_an_apad_it_says_what_is_missing_and_with_a_strange_one_what_differs(
    tmp_path: Path, shell: dict[str, str], begin: Begin
) -> None:
    scenario = four(tmp_path / "four.yaml", 100, apad={})
    command = (sys.executable, "-c", READY, scenario)
    failed = done(*command, 1, env=shell).stdout
    for missing in (
        "nobody publishes /apad1/position",
        "no message from its action server",
        "no subscriber on /apad1/action_server/goal",
    ):
        assert missing in failed
    words = ("pub", "--latch", "/apad1/position", "std_msgs/String", "data: here")
    assert "latching" in heard_from(begin("/usr/bin/rostopic", *words, env=shell | {"PYTHONUNBUFFERED": "1"}))
    failed = done(*command, PATIENCE_S, env=shell).stdout
    assert "/apad1/position is std_msgs/String (md5 992ce8a1687cec8c8bd883ec73ca41d1) there" in failed
    assert "auv_msgs/NavSts (md5 d1c2e3fd518b63978e72fa7409f4ba71) here" in failed


def test_a_node_that_cannot_come_up_leaves_nothing_and_says_why(tmp_path: Path, master: Master) -> None:
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("name: 7\n")
    with pytest.raises(APadNodeFailed, match=r"ended with status 2: .*wrong\.yaml"):
        start_apad_node(wrong, master.uri, tmp_path / "apad.log")
    with pytest.raises(APadNodeFailed, match="no ROS master answers"):
        start_apad_node(wrong, "http://127.0.0.1:1/", tmp_path / "apad.log")


def test_a_laboratorys_words_are_heard_and_told_by_its_own_names(
    tmp_path: Path, shell: dict[str, str], master: Master, start: Begin
) -> None:
    """With ROS's own tools at the other ends; one alert is of a type that nobody here chose."""
    names = tmp_path / "lab.yaml"
    shipped = (ROOT / "launch_scripts" / "interfaces" / "strings.yaml").read_text()
    names.write_text(shipped.replace("hear:", "hear:\n  - {what: clear, topic: /stamped, id: point.x}"))
    program = start(master.uri, "hear_a_laboratory", str(names))
    assert heard_from(program) == "ready"
    echo = done("/usr/bin/rostopic", "echo", "-n", 1, "/amussel3/wifi_status", env=shell)
    assert "data: True" in echo.stdout
    with latched(shell, "/base/docked_alert", "std_msgs/String", "data: 'amussel17, dock 3'"):
        assert json.loads(heard_from(program)) == ["DockReport", "17", "2", "True"]
    with latched(shell, "/stamped", "geometry_msgs/PointStamped", "{point: {x: 4.0}}"):
        assert json.loads(heard_from(program)) == ["ClearanceMessage", "clear", "4"]
    said, _ = program.communicate("", timeout=PATIENCE_S)
    assert json.loads(said.splitlines()[-1]) == {}


def test_after_a_masters_restart_everything_is_registered_again(
    tmp_path: Path, begin: Begin, start: Begin
) -> None:
    port = free_port()
    uri = f"http://127.0.0.1:{port}/"
    environment = loopback_environment(tmp_path / "ros", uri)

    def graph() -> Graph | None:
        try:
            return Graph.read(uri)
        except Unreachable:
            return None

    def restart() -> subprocess.Popen[str]:
        """Debian's own rosmaster, which nothing of ours can mend; it is up when it answers."""
        running = begin("/usr/bin/rosmaster", "--core", "-p", port, env=environment)
        wait_until(graph, running)
        return running

    master = restart()
    watcher = start(uri, "watch_a_master")

    def told() -> Any:
        return json.loads(heard_from(watcher))

    assert heard_from(watcher) == "ready"
    before = Graph.read(uri)
    with standing_still(master.pid):  # it takes connections, and answers none
        assert told()[0] == "master_gone"
    assert told()[0] == "master_back"
    master.kill()
    assert told()[0] == "master_gone"
    master = restart()
    kind, data = told()
    after = Graph.read(uri)
    assert kind == "master_back" and data["registered"] > 10
    for part in ("publishers", "subscribers", "services"):
        ours = {name for name, nodes in getattr(before, part).items() if "/watcher" in nodes}
        assert ours and ours <= set(getattr(after, part))
    with latched(environment, "/words", "std_msgs/String", "data: again"):
        assert told() == ["heard", "again"]
    with standing_still(master.pid):  # the node ends without it
        watcher.communicate("", timeout=PATIENCE_S)
        assert watcher.returncode == 0


@pytest.mark.parametrize("topic", ["/orders", "/said"])
def test_a_reader_whose_connection_ended_is_called_back(
    shell: dict[str, str], master: Master, begin: Begin, start: Begin, topic: str
) -> None:
    """rospy's own reader, as vehicles have it, gives a connection up that ends, and never connects again by itself."""
    loser = start(master.uri, "watch_a_master")
    assert loser.stdin is not None and heard_from(loser) == "ready"
    heard = begin("/usr/bin/rostopic", "echo", topic, env=shell | {"PYTHONUNBUFFERED": "1"})
    for losses in range(3):
        while f'data: "{losses}"' not in heard_from(heard):
            pass
        loser.stdin.write("\n")
        loser.stdin.flush()


def test_a_dock_made_by_anothers_planner_reaches_the_aMussels_charge_edge(
    tmp_path: Path, shell: dict[str, str], begin: Begin
) -> None:
    """A fleet alone beside an aPad of generation B in real time; the generation is taken from the graph."""
    path, out = four(tmp_path / "b.yaml", 600, apad={"generation": "b"}), tmp_path / "fleet"
    auto = write_scenario(tmp_path / "auto.yaml", path, apad={"generation": "auto"})
    node = ("apad_bridge.ros.simulated_node.apad_node", "--scenario", path, "--time", "wall")
    assert heard_from(begin(sys.executable, "-m", *node, env=shell)) == "ready"
    fleet = begin(*MUSSELBED, "fleet", auto, "--hosting", "one_process", "--out", out, env=shell)
    alert = ("/musselbed/dock_by_hand", "musselbed_msgs/DockAlert", "{agent: 3, dock: 2, closed: true}")
    begin("/usr/bin/rostopic", "pub", *alert, env=shell)
    felt = wait_until(lambda: [it for it in lines_of(out, "stimulus") if it["id"] == 3], fleet)
    # A contact closed, at slot 2 of an aPad that heads north from (6, 6): astern.
    assert felt[0]["wire"] == [0, 5_600_000, 6_000_000]
