"""A fleet without a mission and a mission without a fleet, two processes on somebody's master that follow its /clock."""

import itertools
import json
import signal
import subprocess
from pathlib import Path
from typing import Any
from xmlrpc.client import ServerProxy

import pytest
from graphs import echoed, served_pool, somebodys_graph
from killing import kill_supervisor
from patient import PATIENT_MUSSELBED
from programs import MUSSELBED, Begin, ended_well, left_full, lines_of, musselbed, wait_until
from rosbags.rosbag1 import Reader
from scenario_files import write_scenario

from apad_bridge.records.bag_messages import typestore
from apad_bridge.ros.types.messages import generated_folder

pytestmark = pytest.mark.system

SPEED = 4
"""Patience with the aPad's answers is mission time, and a busy machine needs more of it than at a higher speed."""
LONG_S = 36_000
SHADOW = "/musselbed_shadow"


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return served_pool(tmp_path / "split.yaml", 4, LONG_S)


def start(
    begin: Begin, part: str, scenario: Path, out: Path, environment: dict[str, str], *more: str
) -> subprocess.Popen[str]:
    words = (part, scenario, "--time", "ros", "--out", out, "--json", *more)
    return begin(*PATIENT_MUSSELBED, *words, env=environment)


def echoed_s(time: str, environment: dict[str, str]) -> float:
    """The next time on a topic, by the field's name."""
    paths = {"PYTHONPATH": str(generated_folder()), "ROS_PACKAGE_PATH": str(generated_folder())}
    stamp = echoed(environment | paths, time)
    return float(stamp["secs"] + stamp["nsecs"] / 1e9)


def recorded(bag: Path) -> list[tuple[str, int, int]]:
    """(topic, mission ms, ms of the header's stamp) of each message but those of the time before a master was there."""
    rows = []
    with Reader(bag) as reader:
        for connection, stamp_ns, data in reader.messages():
            message: Any = typestore().deserialize_ros1(data, connection.msgtype)
            header = message.header.stamp
            mission_ms = stamp_ns // 1_000_000
            assert getattr(message, "mission_time_ms", mission_ms) == mission_ms
            rows.append((connection.topic, mission_ms, header.sec * 1000 + header.nanosec // 1_000_000))
    return [row for row in rows if row[2]]


class Observer:
    """The nodes of the shadow's name by what they publish, subscribe to and serve, as the master has them."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.seen: list[set[str]] = [set(), set(), set()]
        self._uri = environment["ROS_MASTER_URI"]

    def look(self) -> None:
        with ServerProxy(self._uri) as master:
            _, _, state = master.getSystemState("/observer")  # type: ignore[misc]
        for names, found in zip(state, self.seen, strict=True):  # type: ignore[arg-type]
            found |= {name for name, nodes in names if any(it.startswith(SHADOW) for it in nodes)}


def test_they_serve_each_other_over_topics_and_a_shadow_hears_the_mission_and_is_heard_by_nobody(
    scenario: Path, tmp_path: Path, begin: Begin
) -> None:
    """Beside an aPad of generation B, which reports no docks: the fleet feels them by the mission's word."""
    write_scenario(scenario, scenario, apad={"generation": "b"})
    fleet_run, run = tmp_path / "fleet-run", tmp_path / "mission-run"
    with somebodys_graph(scenario, tmp_path, SPEED) as graph:
        observer = Observer(graph)
        shadow = begin(*MUSSELBED, "shadow", scenario, "--json", env=graph)
        assert shadow.stderr is not None and any("listening" in line for line in shadow.stderr)
        fleet = start(begin, "fleet", scenario, fleet_run, graph)
        mission = start(begin, "mission", scenario, run, graph)

        def states(state: str) -> set[int]:
            return {it["id"] for it in lines_of(fleet_run, "truth") if it["state"] == state}

        wait_until(lambda: lines_of(fleet_run, "belief"), fleet, mission)
        clock = "/clock/clock"
        for topic in ("/amussel1/position", "/musselbed/beliefs"):
            before_s, stamp_s, after_s = (
                echoed_s(it, graph) for it in (clock, f"{topic}/header/stamp", clock)
            )
            # A position repeats the report of the last tick: less than two ticks before `before_s`.
            assert before_s - 2.0 <= stamp_s <= after_s, f"the stamp of {topic} is not that of the master"
        wait_until(
            lambda: observer.look() or (left_full(run) and states("CHARGING") == {1, 2, 3, 4}), fleet, mission
        )
        musselbed("abort", run, env=graph)
        summary = json.loads(ended_well(mission)[0])
        fleet.send_signal(signal.SIGINT)
        assert json.loads(ended_well(fleet, 130)[0])["cost_m"] == 0.0
        told = json.loads(ended_well(shadow)[0])
    assert summary["services"] == len(left_full(run))
    assert summary["uptime_paper"] is None  # a mission alone knows no truth
    # Every dock that the mission made, it made by what it heard on /musselbed/heard: the aMussels had surfaced first.
    assert states("CHARGING") <= states("FLOATING")
    # Ears alone: rospy itself serves the two services of a node's own log.
    published, heard, served = observer.seen
    assert published == set() and all(it.startswith(SHADOW) for it in served)
    assert {"/apad1/position", "/musselbed/heard", "/musselbed/mission"} <= heard
    theirs = [it for it in told["decisions"] if it["theirs"]["kind"] == "collect"]
    # In this order. On a busy machine a docking may fail, and the mission decides for that aMussel again later.
    decided = iter([it["theirs"]["agent_id"] for it in theirs])
    assert all(it["agent"] in decided for it in lines_of(run, "dock") if it["closed"]), theirs
    assert told["agreed"] >= 1 and any(it["estimate"] is not None for it in theirs)


def test_on_a_real_aPad_nothing_moves_again_without_a_person_s_word(
    scenario: Path, tmp_path: Path, begin: Begin
) -> None:
    out = tmp_path / "run"
    with somebodys_graph(scenario, tmp_path, SPEED) as graph:
        run = start(begin, "run", scenario, out, graph, "--apad", "ros")
        # So that the first chunks of its bag are whole.
        wait_until(lambda: lines_of(out, "dock") and lines_of(out)[-1]["t"] >= 30_000, run)
        kill_supervisor(out)
        refused = musselbed("resume", out, "--json", code=2, env=graph, stdin=subprocess.DEVNULL)
        assert "--confirm-motion" in refused.stderr
        resumed = begin(*MUSSELBED, "resume", out, "--json", "--confirm-motion", env=graph)

        def has_served_since() -> bool:
            after = itertools.dropwhile(lambda it: it["kind"] != "resumed", lines_of(out))
            return any(it["kind"] == "released" and it["full"] for it in after)

        wait_until(has_served_since, resumed, run)
        musselbed("abort", out, env=graph)
        ended_well(resumed)
        said, _ = ended_well(run)
    assert json.loads(said)["services"] == len(left_full(out)) > 0
    # Mission time is the bags' own, and the headers have the master's /clock, which began before the run.
    before, after = recorded(out / "run.bag"), recorded(out / "run-1.bag")
    assert before and after
    for rows in (before, after):
        assert all(stamp_ms > mission_ms for _, mission_ms, stamp_ms in rows)
        assert [row[2] for row in rows] == sorted(row[2] for row in rows)
    assert before[-1][1] < after[0][1] and before[-1][2] < after[0][2]
