"""A run on ROS 2, as a judge reads it that shares no code with the room: `judge_ros2.py`, by rclpy's own classes."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from journals import Line
from killing import gone, kill_9, standing_still
from patient import PATIENCE_S
from programs import MUSSELBED, begun, children, line_of, lines_of, wait_until
from scenario_files import POOL_FILE, write_scenario

from apad_bridge.ros2.ros2_process import ENVIRONMENT

pytestmark = pytest.mark.system
JUDGE = Path(__file__).with_name("judge_ros2.py")
WITH_ROS2 = pytest.mark.skipif(
    not (ENVIRONMENT / "installed").exists(), reason="ROS 2 is not installed: launch_scripts/install --ros2"
)
IDS = range(1, 13)
POSE, POSE_COV = "geometry_msgs/PoseStamped", "geometry_msgs/PoseWithCovarianceStamped"
ODOMETRY, CLOCK = "nav_msgs/Odometry", "rosgraph_msgs/Clock"
TF, FIX, BATTERY = "tf2_msgs/TFMessage", "sensor_msgs/NavSatFix", "sensor_msgs/BatteryState"
HASH_OF_TF = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
"""As ROS 2 Jazzy states it for tf2_msgs/msg/TFMessage."""


@pytest.fixture
def environment() -> dict[str, str]:
    """A domain that no other test of this machine has at the time."""
    domain = str(1 + os.getpid() % 100)
    return {**os.environ, "ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


@contextmanager
def publishing(run: Path, environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """The command, while it publishes the run."""
    with begun(*MUSSELBED, "ros2", run, "--json", env=environment) as process:
        assert json.loads(line_of(process)) == {"node": "/musselbed_apad1"}
        yield process


@contextmanager
def shown(run: Path, environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    """The same, to its end in order."""
    with publishing(run, environment) as process:
        yield process
    assert process.returncode == 0


def reading(environment: dict[str, str], topics: dict[str, str], seconds: str = "-") -> subprocess.Popen[str]:
    """The judge, to which each of the topics is offered."""
    process = subprocess.Popen(
        [str(ENVIRONMENT / "bin" / "python"), "-I", str(JUDGE), seconds, *map("=".join, topics.items())],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "reading\n"
    return process


def judged(reader: subprocess.Popen[str], seconds: float = 0.0) -> Any:
    """All that came to the judge, who may read on for so long. One that reads until its input's end ends now."""
    told, _ = reader.communicate(timeout=PATIENCE_S + seconds)
    assert reader.returncode == 0
    return json.loads(told)


TOPICS = {
    "/apad1/odometry": ODOMETRY,
    "/apad1/path": "nav_msgs/Path",
    "/apad1/events": "std_msgs/String",
    "/apad1/markers": "visualization_msgs/MarkerArray",
    "/apad1/battery_state": BATTERY,
    "/diagnostics": "diagnostic_msgs/DiagnosticArray",
    "/clock": CLOCK,
    "/tf": TF,
    "/tf_static": TF,
    **{f"/amussel{it}/belief/pose": POSE_COV for it in IDS},
    **{f"/amussel{it}/truth/pose": POSE for it in IDS},
    **{f"/amussel{it}/battery_state": BATTERY for it in IDS},
    **{f"/amussel{it}/fix": FIX for it in IDS},
}
FOLLOWED = {it: kind for it, kind in TOPICS.items() if kind in (BATTERY, ODOMETRY, CLOCK)}


def assert_offered(seen: dict[str, Any]) -> None:
    """The topics of an ended run, as they are offered: what is kept, its hash, one tree of frames, and no time twice."""
    kept = {it for it, told in seen["qos"].items() if "TRANSIENT_LOCAL" in told}
    assert kept == {"/apad1/path", "/apad1/events", "/tf_static"}
    assert all(told.startswith("RELIABLE") for told in seen["qos"].values())
    assert seen["qos"]["/tf"].endswith(HASH_OF_TF)
    came = {topic: messages[-1][1] for topic, messages in seen["came"].items()}
    assert_one_tree([*came["/tf"], *came["/tf_static"]])
    stamps = [it[1][0]["stamp"] for it in seen["came"]["/tf"]]
    assert stamps == sorted(set(stamps)), "a time came twice"
    assert {it["ns"] for it in came["/apad1/markers"]["markers"]} >= {"amussels", "labels", "apad"}
    assert len(came["/diagnostics"]["status"]) == 1 + len(IDS)


def assert_end(messages: dict[str, list[Any]], lines: list[Line]) -> None:
    """The latest message of each topic has the journal's latest values."""
    assert [topic for topic, each in messages.items() if not each] == []
    came = {topic: each[-1][1] for topic, each in messages.items()}
    newest = {(it["kind"], it.get("id")): it for it in lines if it["kind"] in ("belief", "apad", "truth")}
    apad = newest["apad", None]
    at = came["/apad1/odometry"]["pose"]["pose"]
    assert (at["position"]["x"], at["position"]["y"]) == (apad["east_m"], apad["north_m"])
    turned = 2 * math.atan2(at["orientation"]["z"], at["orientation"]["w"])
    assert math.cos(turned - (math.pi / 2 - apad["heading_rad"])) == pytest.approx(1.0)
    assert came["/apad1/battery_state"]["percentage"] == pytest.approx(apad["battery"], abs=1e-6)
    for agent_id in IDS:
        belief, truth = newest["belief", agent_id], newest["truth", agent_id]
        east_m, north_m = (
            (apad["east_m"], apad["north_m"])
            if agent_id in apad["docks"]
            else (belief["east_m"], belief["north_m"])
        )
        place = came[f"/amussel{agent_id}/belief/pose"]["pose"]["pose"]["position"]
        assert (place["x"], place["y"]) == (east_m, north_m)
        battery = came[f"/amussel{agent_id}/battery_state"]
        assert battery["percentage"] == pytest.approx(belief["charge"], abs=1e-6)
        assert battery["current"] is None
        fix = came[f"/amussel{agent_id}/fix"]
        assert fix["altitude"] is None
        assert (fix["latitude"], fix["longitude"]) == pytest.approx(degrees(north_m, east_m), abs=2e-8)
        if not truth["docked"]:
            true = came[f"/amussel{agent_id}/truth/pose"]["pose"]["position"]
            assert (true["x"], true["y"]) == (truth["east_um"] / 1e6, truth["north_um"] / 1e6)
            assert true["z"] <= 0.0
    assert json.loads(came["/apad1/events"]["data"])["kind"] == "end"
    assert came["/clock"]["clock"]["sec"] >= lines[-1]["t"] // 1000


@contextmanager
def flown(folder: Path, speed: str, count: int, **changes: Any) -> Iterator[subprocess.Popen[str]]:
    """A flight over ROS 1 whose processes start; its run is `folder`/run."""
    fleet = {"count": count, "hosting": "one_process", "start": {"charge": [0.5, 0.75]}}
    scenario = write_scenario(folder / "live.yaml", duration_s=14_400, fleet=fleet, **changes)
    fly = ("run", scenario, "--speed", speed, "--out", folder / "run")
    with (folder / "said").open("w") as said, begun(*MUSSELBED, *fly, stdout=said, stderr=said) as process:
        wait_until((folder / "run" / "scenario.yaml").exists, process)
        yield process


def pass_time(run: Path, seconds: float, flight: subprocess.Popen[str]) -> tuple[float, float]:
    """The wall's times between which so much mission time passed."""
    began_s, until_ms = time.monotonic(), lines_of(run)[-1]["t"] + 1000 * seconds
    wait_until(lambda: lines_of(run)[-1]["t"] >= until_ms, flight)
    return began_s, time.monotonic()


@WITH_ROS2
def test_a_live_flight_is_read_as_its_journal_has_it_and_flies_on_whoever_dies_beside_it(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    run = tmp_path / "run"
    with flown(tmp_path, "2", len(IDS)) as flight:
        with publishing(run, environment) as early:
            reader = reading(environment, FOLLOWED)
            stopped = reading(environment, FOLLOWED)
            stood_still_s = lose_readers(run, flight, stopped, environment)
            (program,) = children(early.pid)
            kill_9(early.pid)
            assert gone(program), "the process on ROS 2 outlives its command"
        with publishing(run, environment) as second:
            kill_9(*children(second.pid))
            _, told = second.communicate(timeout=PATIENCE_S)
        assert second.returncode == 3
        assert told.startswith("musselbed ros2: the process that publishes on ROS 2 takes nothing any more: ")
        killed_s = time.monotonic()
        with shown(run, environment):
            pass_time(run, 10, flight)
            flight.send_signal(signal.SIGINT)
            assert flight.wait(PATIENCE_S) == 130
            assert_end(judged(reading(environment, TOPICS, "5"))["came"], lines_of(run))
    with shown(run, environment):
        seen = judged(reading(environment, TOPICS, "5"))
    assert_end(seen["came"], lines_of(run))
    assert_offered(seen)

    assert lines_of(run)[-1]["kind"] == "end"
    for came in (judged(reader)["came"], judged(stopped)["came"]):
        arrivals_s = [at_s for at_s, _ in came["/apad1/odometry"]]
        assert any(it < stood_still_s[0] for it in arrivals_s) and arrivals_s[-1] > killed_s
    # A flight that waits for a reader is as late as that one stands still.
    summary = json.loads((run / "summary.json").read_text())
    assert summary["latest_tick_s"] < stood_still_s[1] - stood_still_s[0]


def lose_readers(
    run: Path, flight: subprocess.Popen[str], stopped: subprocess.Popen[str], environment: dict[str, str]
) -> tuple[float, float]:
    """Kills a reader, and stops another; the wall's times between which that one stood still."""
    killed = reading(environment, TOPICS)
    pass_time(run, 5, flight)
    kill_9(killed.pid)
    killed.communicate()
    with standing_still(stopped.pid):
        stood_still_s = pass_time(run, 30, flight)
        # Another reader goes on reading beside it.
        assert all(judged(reading(environment, FOLLOWED, "3"))["came"].values())
    pass_time(run, 5, flight)
    return stood_still_s


def degrees(north_m: float, east_m: float) -> tuple[float, float]:
    """Latitude and longitude near the pool's origin, by the radii of WGS-84 there; good to a millimetre in the pool."""
    origin = yaml.safe_load(POOL_FILE.read_text())["area"]["origin"]
    latitude = math.radians(origin["latitude_deg"])
    a, e2 = 6378137.0, 0.00669437999014
    w2 = 1 - e2 * math.sin(latitude) ** 2
    to_north, to_east = a * (1 - e2) / w2**1.5, a / math.sqrt(w2) * math.cos(latitude)
    return (
        origin["latitude_deg"] + math.degrees(north_m / to_north),
        origin["longitude_deg"] + math.degrees(east_m / to_east),
    )


def assert_one_tree(transforms: list[dict[str, Any]]) -> None:
    """Each frame has one parent, and all hang on the world; NED points down."""
    children = [it["child"] for it in transforms]
    assert len(children) == len(set(children)) == len(IDS) + 2
    assert {it["parent"] for it in transforms} == {"musselbed/enu"}
    ned = next(it for it in transforms if it["child"] == "musselbed/ned")
    assert ned["numbers"][3:] == pytest.approx([math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0])


@pytest.mark.viewers
@WITH_ROS2
def test_of_120_aMussels_no_state_is_read_in_part_for_ten_minutes(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    """At theta 1, by the wall's time: each state has all 120. Its lateness is the machine's, and is printed."""
    run = tmp_path / "run"
    places = [f"/amussel{it}/truth/pose" for it in range(1, 121)]
    with flown(tmp_path, "1", len(places), theta=1) as flight, shown(run, environment) as command:
        processes = (command.pid, *children(command.pid))
        began = [processor_s(it) for it in processes]
        reader = reading(environment, {**dict.fromkeys(places, POSE), "/apad1/odometry": ODOMETRY}, "600")
        came = judged(reader, 600.0)["came"]
        used = [processor_s(it) - before for it, before in zip(processes, began, strict=True)]
        peaks_mb = [peak_mb(it) for it in processes]
        flight.send_signal(signal.SIGINT)
        assert flight.wait(PATIENCE_S) == 130
    first_s, last_s = came["/apad1/odometry"][0][0], came["/apad1/odometry"][-1][0]
    states = {stamp_s(it) for _, it in came["/apad1/odometry"][1:-1]}
    lost = sum(len(states - {stamp_s(it) for _, it in came[topic]}) for topic in places)
    late_s = sorted(at_s - stamp_s(it) for each in came.values() for at_s, it in each)
    late_s = [it - late_s[0] for it in late_s]
    summary = json.loads((run / "summary.json").read_text())
    print(
        f"{len(states)} states of {len(places)} in {last_s - first_s:.0f} s; {lost} messages lost; late by "
        f"{late_s[len(late_s) // 2]:.3f} s in the median, at most {late_s[-1]:.3f} s; the command used "
        f"{used[0]:.1f} s of a processor and {peaks_mb[0]:.0f} MB, the process on ROS 2 {used[1]:.1f} s and "
        f"{peaks_mb[1]:.0f} MB; the flight's latest tick was {summary['latest_tick_s']:.3f} s late"
    )
    assert states and lost == 0


def stamp_s(message: dict[str, Any]) -> float:
    stamp = message["header"]["stamp"]
    return float(stamp["sec"] + stamp["nanosec"] / 1e9)


def processor_s(pid: int) -> float:
    """Used so far, by proc(5)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def peak_mb(pid: int) -> float:
    (line,) = (it for it in Path(f"/proc/{pid}/status").read_text().splitlines() if it.startswith("VmHWM"))
    return int(line.split()[1]) / 1024
