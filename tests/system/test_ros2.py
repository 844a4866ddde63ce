"""A run on ROS 2, as a judge reads it that shares no code with the room: `judge_ros2.py`, by rclpy's own classes."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from journals import lines_in
from patient import PATIENCE_S
from scenario_files import POOL_FILE

from apad_bridge.commands.main import main
from apad_bridge.ros2.ros2_process import ENVIRONMENT

pytestmark = pytest.mark.system
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
JUDGE = Path(__file__).with_name("judge_ros2.py")
WITH_ROS2 = pytest.mark.skipif(
    not (ENVIRONMENT / "installed").exists(), reason="ROS 2 is not installed: launch_scripts/install --ros2"
)
IDS = range(1, 13)
POSE, POSE_COV = "geometry_msgs/PoseStamped", "geometry_msgs/PoseWithCovarianceStamped"
TF, FIX, BATTERY = "tf2_msgs/TFMessage", "sensor_msgs/NavSatFix", "sensor_msgs/BatteryState"
HASH_OF_TF = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
"""As ROS 2 Jazzy states it for tf2_msgs/msg/TFMessage."""


@pytest.fixture
def environment() -> dict[str, str]:
    """A domain that no other test of this machine has at the time."""
    domain = str(1 + os.getpid() % 100)
    return {**os.environ, "ROS_DOMAIN_ID": domain, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


@contextmanager
def shown(run: Path, environment: dict[str, str]) -> Iterator[None]:
    """The command, while it publishes the run."""
    process = subprocess.Popen(
        [*MUSSELBED, "ros2", str(run), "--json"], env=environment, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    try:
        assert json.loads(process.stdout.readline()) == {"node": "/musselbed_apad1"}
        yield
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0


def judged(environment: dict[str, str], seconds: float, topics: dict[str, str]) -> Any:
    words = [f"{topic}={kind}" for topic, kind in topics.items()]
    done = subprocess.run(
        [str(ENVIRONMENT / "bin" / "python"), "-I", str(JUDGE), str(seconds), *words],
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S + seconds,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@WITH_ROS2
def test_a_run_that_has_ended_is_read_as_its_journal_has_it(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    run = tmp_path / "run"
    assert main(["run", str(POOL_FILE), "--time", "asap", "--out", str(run)]) == 0
    lines = lines_in(run / "journal.jsonl")
    newest = {(it["kind"], it.get("id")): it for it in lines if it["kind"] in ("belief", "apad", "truth")}
    apad = newest["apad", None]
    topics = {
        "/apad1/odometry": "nav_msgs/Odometry",
        "/apad1/path": "nav_msgs/Path",
        "/apad1/events": "std_msgs/String",
        "/apad1/markers": "visualization_msgs/MarkerArray",
        "/apad1/battery_state": BATTERY,
        "/diagnostics": "diagnostic_msgs/DiagnosticArray",
        "/clock": "rosgraph_msgs/Clock",
        "/tf": TF,
        "/tf_static": TF,
        **{f"/amussel{it}/belief/pose": POSE_COV for it in IDS},
        **{f"/amussel{it}/truth/pose": POSE for it in IDS},
        **{f"/amussel{it}/battery_state": BATTERY for it in IDS},
        **{f"/amussel{it}/fix": FIX for it in IDS},
    }
    with shown(run, environment):
        seen = judged(environment, 5.0, topics)
    assert [topic for topic, messages in seen["came"].items() if not messages] == []
    came = {topic: messages[-1][1] for topic, messages in seen["came"].items()}
    kept = {it for it, told in seen["qos"].items() if "TRANSIENT_LOCAL" in told}
    assert kept == {"/apad1/path", "/apad1/events", "/tf_static"}
    assert all(told.startswith("RELIABLE") for told in seen["qos"].values())
    assert seen["qos"]["/tf"].endswith(HASH_OF_TF)

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
    assert_one_tree([*came["/tf"], *came["/tf_static"]])
    stamps = [it[1][0]["stamp"] for it in seen["came"]["/tf"]]
    assert stamps == sorted(set(stamps)), "a time came twice"
    assert json.loads(came["/apad1/events"]["data"])["kind"] == "end"
    assert {it["ns"] for it in came["/apad1/markers"]["markers"]} >= {"amussels", "labels", "apad"}
    assert len(came["/diagnostics"]["status"]) == 1 + len(IDS)
    assert came["/clock"]["clock"]["sec"] >= lines[-1]["t"] // 1000


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


def test_without_an_installation_one_line_says_how(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("apad_bridge.ros2.ros2_process.ENVIRONMENT", tmp_path)
    assert main(["ros2", str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        "musselbed ros2: ROS 2 is not installed for musselbed: run launch_scripts/install --ros2\n"
    )
