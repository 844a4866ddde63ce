"""A fleet without a mission and a mission without a fleet, two processes on somebody's master that follow its /clock."""

import itertools
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from graphs import lines_of, served_pool, somebodys_graph, wait_until
from journals import lines_in
from killing import kill_supervisor
from patient import PATIENT_MUSSELBED
from rosbags.rosbag1 import Reader

from apad_bridge.records.bag_messages import typestore
from apad_bridge.ros.types.messages import generated_folder

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
PATIENCE_S = 240.0
SPEED = 4
"""Patience with the aPad's answers is mission time, and a busy machine needs more of it than at a higher speed."""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return served_pool(tmp_path / "split.yaml", 4, 130)


@pytest.fixture(scope="module")
def graph(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """Somebody's master with an aPad on it and a /clock `SPEED` times as fast as the wall's; gives the environment.

    Fleets without a mission leave its aPad as it was, so the mission of a later test finds empty docks.
    """
    folder = tmp_path_factory.mktemp("graph")
    with somebodys_graph(served_pool(folder / "split.yaml", 4, 130), folder, SPEED) as environment:
        yield environment


def start(
    part: str, scenario: Path, out: Path, environment: dict[str, str], *more: str
) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*PATIENT_MUSSELBED, part, str(scenario), "--time", "ros", "--out", str(out), "--json", *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=ROOT,
    )


def with_first_id(scenario: Path, first_id: int, duration_s: float = 36_000) -> Path:
    data = yaml.safe_load(scenario.read_text())
    data["fleet"]["first_id"] = first_id
    data["duration_s"] = duration_s
    path = scenario.with_name(f"split-{first_id}.yaml")
    path.write_text(yaml.safe_dump(data))
    return path


def echoed_s(time: str, environment: dict[str, str]) -> float:
    """The next time on a topic, by the field's name."""
    paths = {"PYTHONPATH": str(generated_folder()), "ROS_PACKAGE_PATH": str(generated_folder())}
    command = ["/usr/bin/rostopic", "echo", "-n", "1", time]
    done = subprocess.run(
        command, env=environment | paths, capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    stamp = next(yaml.safe_load_all(done.stdout))
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


def wait_until_heard(run: Path, what: str = '"kind":"belief"') -> None:
    """Until its journal holds `what`: a belief means that it is on the graph. Files announce nothing, so it is polled."""
    journal, until_s, pause = run / "journal.jsonl", time.monotonic() + PATIENCE_S, threading.Event()
    while not (journal.exists() and what in journal.read_text()):
        assert time.monotonic() < until_s
        pause.wait(0.05)


def test_two_fleets_on_one_master_need_disjoint_ids(
    scenario: Path, graph: dict[str, str], tmp_path: Path
) -> None:
    # It is still there when the last of the others has been refused.
    first = start("fleet", with_first_id(scenario, 1), tmp_path / "first", graph)
    wait_until_heard(tmp_path / "first")
    for first_id, why in (
        (1, "musselbed_fleet_1 runs on this master already"),
        (4, "already has /amussel4/"),
    ):
        second = start("fleet", with_first_id(scenario, first_id), tmp_path / f"second-{first_id}", graph)
        said, mistakes = second.communicate(timeout=PATIENCE_S)
        assert second.returncode == 3, said
        assert why in mistakes
        assert len(mistakes.strip().splitlines()) == 1
    clock = "/clock/clock"
    for topic in ("/amussel1/position", "/musselbed/beliefs"):
        before_s, stamp_s, after_s = (echoed_s(it, graph) for it in (clock, f"{topic}/header/stamp", clock))
        # A position repeats the report of the last tick: less than two ticks before `before_s`.
        assert before_s - 2.0 <= stamp_s <= after_s, f"the stamp of {topic} is that of the master"
    heard_ms = round(1000 * stamp_s)
    disjoint = start("fleet", with_first_id(scenario, 5, 20), tmp_path / "disjoint", graph)
    _, mistakes = disjoint.communicate(timeout=PATIENCE_S)
    assert disjoint.returncode == 0, mistakes
    assert any(it["kind"] == "belief" for it in lines_of(tmp_path / "disjoint"))
    first.send_signal(signal.SIGINT)
    first.communicate(timeout=PATIENCE_S)
    assert first.returncode == 130
    rows = recorded(tmp_path / "first" / "run.bag")
    assert [topic for topic, _, stamp_ms in rows if stamp_ms == heard_ms].count("/musselbed/beliefs") == 1


def test_they_serve_each_other_over_topics(scenario: Path, graph: dict[str, str], tmp_path: Path) -> None:
    serve_each_other(scenario, graph, tmp_path)


def test_a_fleet_feels_the_docks_of_an_aPad_that_does_not_report_them(scenario: Path, tmp_path: Path) -> None:
    data = yaml.safe_load(scenario.read_text())
    data["apad"]["generation"] = "b"
    scenario.write_text(yaml.safe_dump(data))
    with somebodys_graph(scenario, tmp_path, SPEED) as graph:
        serve_each_other(scenario, graph, tmp_path)


def serve_each_other(scenario: Path, graph: dict[str, str], tmp_path: Path) -> None:
    fleet_run, mission_run = tmp_path / "fleet-run", tmp_path / "mission-run"
    # On a busy machine one process lags behind the other, and a docking takes more than one try.
    scenario.write_text(scenario.read_text().replace("duration_s: 130", "duration_s: 3600"))
    fleet = start("fleet", scenario, fleet_run, graph)
    mission = start("mission", scenario, mission_run, graph)

    def served() -> list[int]:
        return [it["agent"] for it in lines_of(mission_run) if it["kind"] == "released" and it["full"]]

    def charged() -> set[int]:
        truths = (it for it in lines_of(fleet_run) if it["kind"] == "truth")
        return {it["id"] for it in truths if it["state"] == "CHARGING"}

    wait_until(lambda: bool(served()) and charged() == {1, 2, 3, 4}, fleet, mission)
    abort = [*MUSSELBED, "abort", str(mission_run)]
    assert subprocess.run(abort, env=graph, cwd=ROOT, timeout=PATIENCE_S).returncode == 0
    said, mistakes = mission.communicate(timeout=PATIENCE_S)
    assert mission.returncode == 0, mistakes
    fleet.send_signal(signal.SIGINT)
    fleet_said, fleet_mistakes = fleet.communicate(timeout=PATIENCE_S)
    assert fleet.returncode == 130, fleet_mistakes

    summary = json.loads(said)
    assert summary["services"] == len(served())
    assert summary["uptime_paper"] is None  # a mission alone knows no truth
    assert json.loads(fleet_said)["cost_m"] == 0.0
    # Every dock that the mission made, it made by what it heard on /musselbed/heard: the aMussels had surfaced first.
    truths = [it for it in lines_of(fleet_run) if it["kind"] == "truth"]
    assert charged() <= {it["id"] for it in truths if it["state"] == "FLOATING"}


def test_on_a_real_aPad_nothing_moves_again_without_a_person_s_word(scenario: Path, tmp_path: Path) -> None:
    data = yaml.safe_load(scenario.read_text())
    data["duration_s"] = 36_000  # the master's time goes on while nobody supervises
    scenario.write_text(yaml.safe_dump(data))
    with somebodys_graph(scenario, tmp_path, SPEED) as graph:
        resume_after_a_kill(scenario, graph, tmp_path / "run")


def has_served_since(run: Path, kind: str) -> bool:
    """True if a full aMussel was released after the journal's first line of this kind."""
    after = itertools.dropwhile(lambda it: it["kind"] != kind, lines_of(run))
    return any(it["kind"] == "released" and it["full"] for it in after)


def resume_after_a_kill(scenario: Path, graph: dict[str, str], out: Path) -> None:
    run = start("run", scenario, out, graph, "--apad", "ros")
    wait_until_heard(out, '"kind":"dock"')
    wait_until_heard(out, '{"t":30000,')  # so that the first chunks of its bag are whole
    kill_supervisor(out)
    resume = [*MUSSELBED, "resume", str(out), "--json"]
    refused = subprocess.run(
        resume,
        capture_output=True,
        text=True,
        env=graph,
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        timeout=PATIENCE_S,
    )
    assert refused.returncode == 2
    assert "--confirm-motion" in refused.stderr
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [*resume, "--confirm-motion"], stdout=pipe, stderr=pipe, text=True, env=graph, cwd=ROOT
    ) as resumed:
        wait_until(lambda: has_served_since(out, "resumed"), resumed, run)
        abort = [*MUSSELBED, "abort", str(out)]
        assert subprocess.run(abort, env=graph, cwd=ROOT, timeout=PATIENCE_S).returncode == 0
        _, mistakes = resumed.communicate(timeout=PATIENCE_S)
    assert resumed.returncode == 0, mistakes
    said, mistakes = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 0, mistakes
    released = [line for line in lines_in(out / "journal.jsonl") if line["kind"] == "released"]
    assert json.loads(said)["services"] == sum(line["full"] for line in released) > 0
    # Mission time is the bags' own, and the headers have the master's /clock, which began before the run.
    before, after = recorded(out / "run.bag"), recorded(out / "run-1.bag")
    assert before and after
    for rows in (before, after):
        assert all(stamp_ms > mission_ms for _, mission_ms, stamp_ms in rows)
        assert [row[2] for row in rows] == sorted(row[2] for row in rows)
    assert before[-1][1] < after[0][1] and before[-1][2] < after[0][2]
