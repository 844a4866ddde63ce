"""A flight over real TCPROS: an embedded master, the simulated aPad's node and the gateway in processes of their own."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import IO, Any

import pytest
from journals import lines_in
from killing import kill_9, standing_still
from scenario_files import POOL_FILE, silent_in_its_dock

from apad_bridge.doctor.graph import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.ros.simulated_node.apad_process import APadNodeFailed, start_apad_node, stop_apad_node
from apad_bridge.ros.system.master import Master, loopback_environment, start_master
from apad_bridge.ros.system.route import free_port
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
PATIENCE_S = 180.0


@pytest.fixture
def master(tmp_path: Path) -> Iterator[Master]:
    running = start_master(tmp_path / "ros", timeout_s=120, orphan_s=60)
    yield running
    running.stop()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


@pytest.fixture
def start(
    master: Master, start_on: Callable[..., subprocess.Popen[str]]
) -> Callable[..., subprocess.Popen[str]]:
    """Starts a program of this folder as a node on the master."""
    return partial(start_on, master.uri)


@pytest.fixture
def start_on(tmp_path: Path, stack: ExitStack) -> Callable[..., subprocess.Popen[str]]:
    """Starts a program of this folder as a node on some master; it is killed by its pid at the end."""

    def started(uri: str, program: str, *arguments: str) -> subprocess.Popen[str]:
        child = subprocess.Popen(
            [sys.executable, "-m", f"tests.system.{program}", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=loopback_environment(tmp_path / "ros", uri),
            cwd=ROOT,
            text=True,
        )

        def end() -> None:
            child.kill()
            child.communicate()

        stack.callback(end)
        return child

    return started


def four(tmp_path: Path, duration_s: float, generation: str = "a", fault: str = "none") -> Path:
    """Four aMussels that are candidates from the start and charged within a minute."""
    (tmp_path / "four.csv").write_text(
        "id,north,east,battery\n1,2,3,0.75\n2,4,8,0.74\n3,9,5,0.70\n4,8,9,0.72\n"
    )
    data = loader.resolve(loader.load(POOL_FILE))
    data |= {"theta": 600, "duration_s": duration_s}
    data["fleet"] |= {"count": 4, "start": str(tmp_path / "four.csv")}
    data["apad"] |= {"start_m": [6, 6], "generation": generation, "fault": fault}
    path = tmp_path / "scenario.yaml"
    loader.write_resolved(path, loader.from_data(data, "four"))
    return path


def node(scenario: Path, master: Master, stack: ExitStack, **options: Any) -> subprocess.Popen[bytes]:
    child = start_apad_node(scenario, master.uri, scenario.parent / "apad.log", **options)
    stack.callback(stop_apad_node, child)
    return child


def line_of(stream: IO[str]) -> str:
    readable, _, _ = select.select([stream], [], [], PATIENCE_S)
    assert readable, "it said nothing"
    return stream.readline()


def said_by_rostopic(tmp_path: Path, master: Master, stack: ExitStack, *words: str) -> IO[str]:
    """The output of ROS' own command, which runs until the test's end."""
    program = subprocess.Popen(
        ["/usr/bin/rostopic", *words],
        env=loopback_environment(tmp_path / "ros", master.uri) | {"PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        text=True,
    )
    stack.callback(program.communicate)
    stack.callback(program.kill)
    assert program.stdout is not None
    return program.stdout


@contextmanager
def latched(environment: dict[str, str], topic: str, kind: str, message: str) -> Iterator[None]:
    """A word of rostopic's that stays, however late its hearer connects: `pub -1` is gone after three seconds."""
    command = ["/usr/bin/rostopic", "pub", "--latch", topic, kind, message]
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) as publisher:
        try:
            yield
        finally:
            publisher.kill()


def told(child: subprocess.Popen[str]) -> dict[str, Any]:
    said, errors = child.communicate(timeout=PATIENCE_S)
    assert said, errors
    result: dict[str, Any] = json.loads(said.splitlines()[-1])
    return result


def about_when(decisions: list[list[Any]]) -> list[list[Any]]:
    """The decisions without their times, in the order of what belongs together."""
    return [decision[1:] for decision in decisions]


def test_a_flight_over_ros_decides_as_one_in_virtual_time(
    tmp_path: Path, master: Master, stack: ExitStack, start: Callable[..., subprocess.Popen[str]]
) -> None:
    """To the second: each docking, plan and release at the same tick. Only the aPad's battery, which generation A does not
    stamp, may be a tick old."""
    scenario = four(tmp_path, 220)
    node(scenario, master, stack)
    over_ros = told(start("legacy_flight", str(scenario), "ros", "max"))
    virtual = told(start("legacy_flight", str(scenario), "asap"))
    closed = [data["agent"] for _, kind, data in virtual["decisions"] if kind == "dock" and data["closed"]]
    assert len(closed) == 4 and virtual["services"] == 4
    assert over_ros["decisions"] == virtual["decisions"]
    assert over_ros["planned_m"] == pytest.approx(virtual["planned_m"], abs=1e-6)
    # How far within the victory radius a leg is driven is a matter of when the arrival is heard.
    radius_m = loader.load(scenario).mission.victory_radius_m
    assert over_ros["cost_m"] == pytest.approx(virtual["cost_m"], abs=8 * radius_m)
    assert over_ros["services"] == virtual["services"]
    assert over_ros["dropped"] == over_ros["vehicle_dropped"] == {}


def test_a_flight_over_generation_b_makes_the_same_decisions(
    tmp_path: Path, master: Master, stack: ExitStack, start: Callable[..., subprocess.Popen[str]]
) -> None:
    """Its words have no stamps, so one may be heard a tick late: 2 s and 2 m in the flight are allowed."""
    scenario = four(tmp_path, 216, "b")
    node(scenario, master, stack)
    over_ros = told(start("legacy_flight", str(scenario), "ros", "max"))
    virtual = told(start("legacy_flight", str(scenario), "asap"))
    assert virtual["services"] == 4
    assert about_when(over_ros["decisions"]) == about_when(virtual["decisions"])
    late_s = [
        there[0] - here[0] for there, here in zip(over_ros["decisions"], virtual["decisions"], strict=True)
    ]
    assert all(0 <= it <= 2 for it in late_s)
    for key in ("planned_m", "cost_m"):
        assert over_ros[key] == pytest.approx(virtual[key], abs=2), key
    assert over_ros["services"] == virtual["services"]
    assert over_ros["dropped"] == over_ros["vehicle_dropped"] == {}


@pytest.mark.parametrize(("generation", "counts"), [("a", True), ("b", False)])
def test_a_charge_of_which_no_packet_came_counts_by_the_docks_own_service(
    generation: str, counts: bool, tmp_path: Path
) -> None:
    """Generation A's service names who is in its docks. B has none, so there the vehicle's report stands alone."""
    path, out = tmp_path / "silent.yaml", tmp_path / "run"
    loader.write_resolved(path, silent_in_its_dock(generation))
    command = [sys.executable, "-m", "apad_bridge.commands.main", "run", str(path), "--speed", "500"]
    done = subprocess.run(
        [*command, "--json", "--out", str(out)], capture_output=True, text=True, timeout=PATIENCE_S, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    lines = lines_in(out / "journal.jsonl")
    assert [it["full"] for it in lines if it["kind"] == "released"] == [counts]
    summary = json.loads(done.stdout)
    doubts = [cause for cause in summary["causes"] if "the aMussel is not heard in it" in cause]
    assert (summary["services"], len(doubts)) == (int(counts), int(not counts))
    assert [it["reason"] for it in lines if it["kind"] == "docks_disagree"] == doubts


def test_the_vehicles_own_eyes_dock_simulated_amussels_that_a_camera_shows_them(tmp_path: Path) -> None:
    """Same plan, slots and order as in virtual time, where a docking takes what the scenario says and not what it takes."""
    path = four(tmp_path, 450, "b")
    data = loader.resolve(loader.load(path))
    servo = {
        "search_yaw_rate_rad_s": 0.2,
        "max_yaw_rate_rad_s": 0.3,
        "max_surge_m_s": 0.15,
        "surge_stdev": 0.2,
        "search_s": 120,
    }
    data["mission"]["docking"] |= {"profile": "camera", "timeout_s": 150, "servo": servo}
    data["mission"] |= {"batch": 2, "silence_timeout_s": 400}
    data["apad"]["drift_m_s"] = [0.01, -0.02]
    loader.write_resolved(path, loader.from_data(data, "camera"))
    flights = {}
    for name, options in (("ros", ["--speed", "500"]), ("asap", ["--time", "asap"])):
        out = tmp_path / name
        command = [sys.executable, "-m", "apad_bridge.commands.main", "run", str(path), *options]
        command += ["--hosting", "one_process", "--json", "--out", str(out)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, cwd=ROOT)
        assert done.returncode == 0, done.stderr
        flights[name] = (json.loads(done.stdout), lines_in(out / "journal.jsonl"))

    def decided(name: str) -> list[Any]:
        _, journal = flights[name]
        steps = [
            (step["agent"], step["dock"])
            for step in next(line for line in journal if line["kind"] == "plan")["steps"]
        ]
        docks = [(line["agent"], line["dock"], line["closed"]) for line in journal if line["kind"] == "dock"]
        return [steps, docks[:2]]

    steps, docks = decided("ros")
    assert docks == [(agent, slot, True) for agent, slot in steps] and len(docks) == 2
    assert decided("asap") == [steps, docks]
    ros, _ = flights["ros"]
    assert ros["first_cause"] is None and ros["dropped"] == {}
    legs = {
        name: [line["metres"] for line in journal if line["kind"] == "leg"][:2]
        for name, (_, journal) in flights.items()
    }
    # Where the vehicle ends up after a docking by eye is its own business: a metre a docking.
    assert legs["ros"] == pytest.approx(legs["asap"], abs=1.0)


def test_a_release_without_an_answer_is_heard_by_its_silence(
    tmp_path: Path, master: Master, stack: ExitStack, start: Callable[..., subprocess.Popen[str]]
) -> None:
    scenario = four(tmp_path, 160, fault="release_silent")
    node(scenario, master, stack)
    over_ros = told(start("legacy_flight", str(scenario), "ros", "max"))
    virtual = told(start("legacy_flight", str(scenario), "asap"))
    first = [
        next(at_s for at_s, kind, data in flown["decisions"] if kind == "dock" and not data["closed"])
        for flown in (virtual, over_ros)
    ]
    assert first[1] == first[0] + 2
    assert over_ros["services"] == virtual["services"] == 1


def test_a_node_that_died_is_named_and_the_flight_ends(
    tmp_path: Path, master: Master, stack: ExitStack, start: Callable[..., subprocess.Popen[str]]
) -> None:
    scenario = four(tmp_path, 10_000)
    vehicle = node(scenario, master, stack)
    flight = start("legacy_flight", str(scenario), "ros", "100", "10.0")
    assert flight.stderr is not None
    assert line_of(flight.stderr) == "flying\n"
    kill_9(vehicle.pid)
    assert "the node of /apad1 did not say within 10 s" in told(flight)["failed"]


def test_without_an_apad_it_says_what_is_missing_and_with_a_strange_one_what_differs(
    tmp_path: Path, master: Master, start: Callable[..., subprocess.Popen[str]], stack: ExitStack
) -> None:
    scenario = str(four(tmp_path, 100))
    failed = told(start("legacy_flight", scenario, "ros", "max", "0.2"))["failed"]
    for missing in (
        "nobody publishes /apad1/position",
        "no message from its action server",
        "no subscriber on /apad1/action_server/goal",
    ):
        assert missing in failed
    words = ("pub", "--latch", "/apad1/position", "std_msgs/String", "data: here")
    assert "latching" in line_of(said_by_rostopic(tmp_path, master, stack, *words))
    failed = told(start("legacy_flight", scenario, "ros"))["failed"]
    assert "/apad1/position is std_msgs/String (md5 992ce8a1687cec8c8bd883ec73ca41d1) there" in failed
    assert "auv_msgs/NavSts (md5 d1c2e3fd518b63978e72fa7409f4ba71) here" in failed


def test_a_second_fleet_with_the_same_ids_is_refused_unless_the_first_is_dead(
    start: Callable[..., subprocess.Popen[str]],
) -> None:
    def opened(*arguments: str) -> tuple[subprocess.Popen[str], str]:
        gateway = start("open_a_gateway", *arguments)
        assert gateway.stdout is not None
        return gateway, line_of(gateway.stdout)

    first, word = opened("musselbed", "1", "12")
    assert word.startswith("open")
    _, word = opened("another", "12", "5")
    assert word.startswith("node /musselbed already has /amussel12/")
    _, word = opened("musselbed", "100", "5")
    assert word.startswith("a node named /musselbed runs on this master already")
    _, word = opened("another", "13", "5")
    assert word.startswith("open")
    os.kill(first.pid, signal.SIGKILL)
    first.wait(PATIENCE_S)
    _, word = opened("musselbed", "1", "12")
    assert word.startswith("open")


def test_an_amussel_answers_for_its_battery_with_what_it_reported(
    tmp_path: Path, master: Master, start: Callable[..., subprocess.Popen[str]]
) -> None:
    gateway = start("open_a_gateway", "musselbed", "7", "2")
    assert gateway.stdout is not None
    assert line_of(gateway.stdout).startswith("open")
    environment = loopback_environment(tmp_path / "ros", master.uri)
    environment["PYTHONPATH"] = str(Path(sys.prefix) / "share" / "musselbed" / "ros")

    def asked(service: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = ["/usr/bin/rosservice", "call", service, *arguments]
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)

    answer = asked("/amussel7/charge_info").stdout.splitlines()
    assert {"battery_level: 75.0", "x: 1.5", "y: -2.5", "z: 3.0", 'type: "consumer"'} <= set(answer)
    assert asked("/amussel7/get_position").stdout.splitlines() == ["x: 1.5", "y: -2.5", "z: 3.0"]
    assert asked("/amussel7/get_sensory_reading").stdout.splitlines() == ["current: []"]
    assert asked("/amussel7/send_energy", "1").stdout.splitlines() == ["done: False"]
    assert "amussel8 has not been heard yet" in asked("/amussel8/get_battery_level").stderr

    # One tick was made: what comes after is its report again, with its stamp.
    command = ["/usr/bin/rostopic", "echo", "-n", "5", "-p", "/amussel7/position"]
    echo = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    header, *rows = (line.split(",") for line in echo.stdout.splitlines())
    repeated = [dict(zip(header, row, strict=True)) for row in rows]
    fields = ("field.header.stamp", "field.position.north", "field.position.depth")
    assert [tuple(it[field] for field in fields) for it in repeated] == [("1000000000", "1.5", "3.0")] * 5
    sequence = [int(it["field.header.seq"]) for it in repeated]
    assert sequence == list(range(sequence[0], sequence[0] + 5))


def test_a_node_that_cannot_come_up_leaves_nothing_and_says_why(tmp_path: Path, master: Master) -> None:
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("name: 7\n")
    with pytest.raises(APadNodeFailed, match=r"ended with status 2: .*wrong\.yaml"):
        start_apad_node(wrong, master.uri, tmp_path / "apad.log")
    with pytest.raises(APadNodeFailed, match="no ROS master answers"):
        start_apad_node(wrong, "http://127.0.0.1:1/", tmp_path / "apad.log")


def test_a_laboratorys_words_are_heard_and_told_by_its_own_names(
    tmp_path: Path, master: Master, start: Callable[..., subprocess.Popen[str]]
) -> None:
    """With ROS's own tools at the other ends; one alert is of a type that nobody here chose."""
    names = tmp_path / "lab.yaml"
    shipped = (ROOT / "launch_scripts" / "interfaces" / "strings.yaml").read_text()
    names.write_text(shipped.replace("hear:", "hear:\n  - {what: clear, topic: /stamped, id: point.x}"))
    program = start("hear_a_laboratory", str(names))
    assert program.stdout is not None and line_of(program.stdout) == "ready\n"
    environment = loopback_environment(tmp_path / "ros", master.uri)

    def tool(*words: str) -> str:
        command = [f"/usr/bin/{words[0]}", *words[1:]]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "data: True" in tool("rostopic", "echo", "-n", "1", "/amussel3/wifi_status")
    with latched(environment, "/base/docked_alert", "std_msgs/String", "data: 'amussel17, dock 3'"):
        assert json.loads(line_of(program.stdout)) == ["DockReport", "17", "2", "True"]
    with latched(environment, "/stamped", "geometry_msgs/PointStamped", "{point: {x: 4.0}}"):
        assert json.loads(line_of(program.stdout)) == ["ClearanceMessage", "clear", "4"]
    said, _ = program.communicate("", timeout=PATIENCE_S)
    assert json.loads(said.splitlines()[-1]) == {}


def test_after_a_masters_restart_everything_is_registered_again(
    tmp_path: Path, stack: ExitStack, start_on: Callable[..., subprocess.Popen[str]]
) -> None:
    port = free_port()
    uri = f"http://127.0.0.1:{port}/"
    environment = loopback_environment(tmp_path / "ros", uri)

    def restart() -> subprocess.Popen[bytes]:
        """Debian's own rosmaster, which nothing of ours can mend; it is up when it answers."""
        running = subprocess.Popen(
            ["/usr/bin/rosmaster", "--core", "-p", str(port)], env=environment, stdout=subprocess.DEVNULL
        )
        stack.callback(running.wait)
        stack.callback(running.kill)
        until_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                Graph.read(uri)
                return running
            except Unreachable:
                assert time.monotonic() < until_s and running.poll() is None
                running_pause.wait(0.05)

    running_pause = threading.Event()
    master = restart()
    watcher = start_on(uri, "watch_a_master")
    assert watcher.stdout is not None and line_of(watcher.stdout) == "ready\n"
    before = Graph.read(uri)
    with standing_still(master.pid):  # it takes connections, and answers none
        assert json.loads(line_of(watcher.stdout))[0] == "master_gone"
    assert json.loads(line_of(watcher.stdout))[0] == "master_back"
    master.kill()
    assert json.loads(line_of(watcher.stdout))[0] == "master_gone"
    master = restart()
    kind, data = json.loads(line_of(watcher.stdout))
    after = Graph.read(uri)
    assert kind == "master_back" and data["registered"] > 10
    for part in ("publishers", "subscribers", "services"):
        ours = {name for name, nodes in getattr(before, part).items() if "/watcher" in nodes}
        assert ours and ours <= set(getattr(after, part))
    with latched(environment, "/words", "std_msgs/String", "data: again"):
        assert json.loads(line_of(watcher.stdout)) == ["heard", "again"]
    with standing_still(master.pid):  # the node ends without it
        watcher.communicate("", timeout=PATIENCE_S)
        assert watcher.returncode == 0


@pytest.mark.parametrize("topic", ["/orders", "/words"])
def test_a_reader_whose_connection_ended_is_called_back(
    tmp_path: Path,
    master: Master,
    stack: ExitStack,
    start_on: Callable[..., subprocess.Popen[str]],
    topic: str,
) -> None:
    """rospy's own reader, as vehicles have it, gives a connection up that ends, and never connects again by itself."""
    loser = start_on(master.uri, "lose_readers")
    assert loser.stdin is not None and loser.stdout is not None and line_of(loser.stdout) == "ready\n"
    heard = said_by_rostopic(tmp_path, master, stack, "echo", topic)
    for losses in range(3):
        while f'data: "{losses}"' not in line_of(heard):
            pass
        loser.stdin.write("\n")
        loser.stdin.flush()


def test_a_dock_made_by_anothers_planner_reaches_the_aMussels_charge_edge(
    tmp_path: Path, master: Master, stack: ExitStack
) -> None:
    """A fleet alone beside an aPad of generation B in real time; the generation is taken from the graph."""
    path = four(tmp_path, 600, "b")
    data = loader.resolve(loader.load(path))
    data["apad"]["generation"] = "auto"
    loader.write_resolved(tmp_path / "auto.yaml", loader.from_data(data, "auto"))
    environment = loopback_environment(tmp_path / "ros", master.uri)
    environment["PYTHONPATH"] = str(Path(sys.prefix) / "share" / "musselbed" / "ros")

    def process(*words: str) -> subprocess.Popen[str]:
        child = subprocess.Popen(
            words, env=environment, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        stack.callback(child.communicate)
        stack.callback(child.kill)
        return child

    module = (sys.executable, "-m")
    apad = process(
        *module, "apad_bridge.ros.simulated_node.apad_node", "--scenario", str(path), "--time", "wall"
    )
    assert apad.stdout is not None and line_of(apad.stdout) == "ready\n"
    out = tmp_path / "fleet"
    hosted = ("--hosting", "one_process", "--out", str(out))
    fleet = process(*module, "apad_bridge.commands.main", "fleet", str(tmp_path / "auto.yaml"), *hosted)
    alert = "{agent: 3, dock: 2, closed: true}"
    process("/usr/bin/rostopic", "pub", "/musselbed/dock_by_hand", "musselbed_msgs/DockAlert", alert)
    journal, until_s, pause = out / "journal.jsonl", time.monotonic() + PATIENCE_S, threading.Event()
    felt: list[Any] = []
    while not felt:
        assert time.monotonic() < until_s and fleet.poll() is None
        pause.wait(0.05)  # files announce nothing
        lines = lines_in(journal) if journal.exists() else []
        felt = [line for line in lines if line["kind"] == "stimulus" and line["id"] == 3]
    # A contact closed, at slot 2 of an aPad that heads north from (6, 6): astern.
    assert felt[0]["wire"] == [0, 5_600_000, 6_000_000]
    fleet.send_signal(signal.SIGINT)
    fleet.wait(PATIENCE_S)
