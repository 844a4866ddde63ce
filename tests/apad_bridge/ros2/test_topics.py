"""The messages of a run, read by rosbags; values by hand: x east, y north, z up, angles anticlockwise from east."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from apad_bridge.ros2.topics import RunTopics, TopicMessage

Read = Callable[[TopicMessage], Any]
EAST_RAD = math.pi / 2
COSTS = {"distance_m": 5.0, "demand": 1.0, "distance_cost": 5.0, "energy_cost": 1.0}
HALF = math.sqrt(0.5)


@pytest.fixture
def state(story: Any, pool: Any, read: Read) -> Callable[[], dict[str, Any]]:
    """Takes what the journal has, and gives the messages by topic."""
    topics = RunTopics(pool, story.run)

    def messages() -> dict[str, Any]:
        story.poll()
        return {it.topic: read(it) for it in topics.state()}

    return messages


def test_an_aMussels_battery(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    story.belief(5500, 7, charge=0.75, secondary=0.5, heard=4500)
    battery = state()["/amussel7/battery_state"]
    # 75 % and 50 % of the way from 3.6 to 4.2 V
    assert (battery.voltage, battery.percentage) == pytest.approx((4.05, 0.75))
    assert battery.cell_voltage.tolist() == pytest.approx([4.05, 3.9])
    unknown = ("temperature", "current", "charge", "capacity", "design_capacity")
    assert all(math.isnan(getattr(battery, it)) for it in unknown)
    assert (battery.power_supply_status, battery.power_supply_health) == (2, 1)
    assert (battery.power_supply_technology, battery.present, battery.location) == (3, True, "amussel7")
    assert (battery.header.frame_id, battery.header.stamp.sec) == ("amussel7/base_link", 4)
    assert battery.header.stamp.nanosec == 500_000_000


def test_an_aMussels_place(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    story.belief(5000, 7, north_m=10.0, east_m=20.0, reported={"depth_m": 3.0})
    story.belief(5000, 8, north_m=10.0, east_m=20.0, place_cov=[4.0, 0.5, 9.0], mode="IDLE")
    came = state()
    known, fix = came["/amussel8/fix"], came["/amussel7/fix"]
    # A degree of latitude is 111 111 m within 0.5 % there; one of longitude that times cos 43.93 degrees.
    assert fix.latitude - 43.9330937 == pytest.approx(10 / 111_111, rel=0.005)
    assert fix.longitude - 15.4443468 == pytest.approx(20 / (111_111 * 0.7202), rel=0.005)
    assert (math.isnan(fix.altitude), fix.status.status, fix.status.service) == (True, 0, 1)
    assert (fix.position_covariance_type, known.position_covariance_type) == (0, 3)
    assert (known.position_covariance[0], known.header.frame_id) == (9.0, "amussel8/base_link")

    believed, sure = came["/amussel7/belief/pose"], came["/amussel8/belief/pose"]
    assert believed.header.frame_id == "musselbed/enu"
    assert vector(believed.pose.pose.position) == (20.0, 10.0, -3.0)
    assert quaternion(believed.pose.pose.orientation) == (0.0, 0.0, 0.0, 1.0)
    assert (believed.pose.covariance[0], sure.pose.covariance[0]) == (0.0, 9.0)


def test_the_truth_of_a_simulated_aMussel(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    story.belief(5000, 7)
    story.truth(5000, 4, depth=[150_000, 3_000_000], buoyancy="SINK")
    came = state()
    assert "/amussel7/truth/pose" not in came and "/amussel4/belief/pose" not in came
    truth = came["/amussel4/truth/pose"]
    assert vector(truth.pose.position) == (2.5, 1.5, -3.0)
    assert (truth.header.frame_id, truth.header.stamp.sec) == ("musselbed/enu", 5)


def test_the_aPad(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    story.apad(1000, 2.0, 3.0, 0.2)
    story.apad(2000, 4.0, 4.0, 0.0)
    came = state()
    odometry = came["/apad1/odometry"]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("musselbed/enu", "apad1/base_link")
    assert vector(odometry.pose.pose.position) == (4.0, 4.0, 0.0)
    # North is a quarter turn from x.
    assert quaternion(odometry.pose.pose.orientation) == pytest.approx((0.0, 0.0, HALF, HALF))
    assert vector(odometry.twist.twist.linear) == pytest.approx((2.0, -1.0, 0.0))
    assert vector(odometry.twist.twist.angular) == pytest.approx((0.0, 0.0, 0.2))
    battery = came["/apad1/battery_state"]
    assert (battery.voltage, battery.percentage) == pytest.approx((15.5, 0.9))
    assert (battery.power_supply_status, battery.power_supply_health, battery.location) == (2, 0, "apad1")
    assert (battery.header.frame_id, battery.header.stamp.sec) == ("apad1/base_link", 2)
    assert came["/apad1/fix"].latitude - 43.9330937 == pytest.approx(4 / 111_111, rel=0.005)
    assert came["/apad1/fix"].position_covariance_type == 0


def test_values_that_a_vehicle_does_not_tell(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    place = {"north_m": 0.0, "east_m": 0.0, "heading_rad": 0.0, "primitive": "none", "docks": [-1] * 4}
    story.write(1000, "apad", voltage_v=None, battery=0.5, **place)
    assert math.isnan(state()["/apad1/battery_state"].voltage)
    story.write(2000, "apad", voltage_v=None, battery=None, **place)
    assert "/apad1/battery_state" not in state()


def test_paths_come_when_they_change_and_are_kept(story: Any, pool: Any, read: Read) -> None:
    topics = RunTopics(pool, story.run)

    def paths() -> dict[str, list[tuple[float, ...]]]:
        story.poll()
        kept = [it for it in topics.state() if it.kind == "nav_msgs/Path"]
        assert all(it.kept == 1 for it in kept)
        return {it.topic: [vector(pose.pose.position) for pose in read(it).poses] for it in kept}

    story.apad(1000, 0.0, 0.0)
    assert paths() == {"/apad1/path": [(0.0, 0.0, 0.0)] * 2, "/apad1/plan": []}
    story.belief(2000, 7, north_m=3.0, east_m=4.0)
    assert paths() == {}
    step = {"agent": 7, "dock": 0}
    told = {"what": "collect", "strategy": "greedy", "costs": COSTS, "beliefs": []}
    story.write(3000, "plan", steps=[step], **told)
    assert paths() == {"/apad1/plan": [(0.0, 0.0, 0.0), (4.0, 3.0, 0.0)]}
    story.apad(4000, 1.0, 0.0)
    assert paths() == {
        "/apad1/path": [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0)],
        "/apad1/plan": [(0.0, 1.0, 0.0), (4.0, 3.0, 0.0)],
    }


def test_frames_are_one_tree_with_z_up(story: Any, pool: Any, read: Read) -> None:
    story.belief(5000, 7, reported={"depth_m": 3.0})
    story.apad(5000, 1.0, 2.0, EAST_RAD)
    story.poll()
    topics = RunTopics(pool, story.run)
    (tf,) = (it for it in topics.state() if it.topic == "/tf")
    agent, apad = read(tf).transforms
    assert (agent.header.frame_id, agent.child_frame_id) == ("musselbed/enu", "amussel7/base_link")
    assert (vector(agent.transform.translation), quaternion(agent.transform.rotation)) == (
        (20.0, 10.0, -3.0),
        (0.0, 0.0, 0.0, 1.0),
    )
    assert (apad.child_frame_id, apad.header.stamp.sec) == ("apad1/base_link", 5)
    assert vector(apad.transform.translation) == (2.0, 1.0, 0.0)
    assert quaternion(apad.transform.rotation) == pytest.approx((0.0, 0.0, 0.0, 1.0))
    fixed = topics.fixed_frames()
    (ned,) = read(fixed).transforms
    assert (fixed.topic, fixed.kept) == ("/tf_static", 1)
    assert (ned.header.frame_id, ned.child_frame_id) == ("musselbed/enu", "musselbed/ned")
    # Half a turn about the axis between x and y: x becomes y, y becomes x, z its opposite.
    assert quaternion(ned.transform.rotation) == pytest.approx((HALF, HALF, 0.0, 0.0))


def test_markers_begin_with_a_clear_screen(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    story.apad(5000, 1.0, 2.0, EAST_RAD, docks=(9, 7))
    story.belief(5000, 7)
    story.belief(5000, 8, place_cov=[4.0, 0.0, 9.0], mode="IDLE")
    clear, *markers = state()["/apad1/markers"].markers
    assert (clear.action, clear.pose.orientation.w, clear.header.frame_id) == (3, 1.0, "musselbed/enu")
    assert [(it.ns, it.id, it.type) for it in markers] == [
        ("amussels", 7, 2),
        ("labels", 7, 9),
        ("amussels", 8, 2),
        ("labels", 8, 9),
        ("place_95", 8, 3),
        ("apad", 0, 0),
    ]
    assert {it.action for it in markers} == {0}
    ball, label, *_ = markers
    assert vector(ball.pose.position) == (2.0, 1.0, 0.0) and vector(ball.scale) == (0.5, 0.5, 0.5)
    assert (ball.color.r, ball.color.g, ball.color.b, ball.color.a) == pytest.approx((0.0, 0.8, 0.9, 1.0))
    assert (label.text, label.scale.z) == ("7: 75 %", 0.6)


def test_diagnostics(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    story.apad(300_000, 1.0, 2.0, docks=(7,))
    story.belief(300_000, 7, charge=0.9)
    came = state()["/diagnostics"]
    assert came.header.stamp.sec == 300
    apad, *amussels = came.status
    assert (apad.name, apad.hardware_id, apad.level) == ("musselbed: aPad apad1", "apad1", 0)
    values = {it.key: it.value for it in apad.values}
    assert values == {"services": "0", "docks": "7 - - -", "primitive": ""}
    assert [it.hardware_id for it in amussels] == [f"amussel{it}" for it in range(1, 13)]
    assert (amussels[0].level, amussels[0].message, amussels[0].values) == (3, "no report yet", [])
    assert (amussels[6].name, amussels[6].level, amussels[6].message) == ("musselbed: aMussel 7", 0, "90 %")
    values = {it.key: it.value for it in amussels[6].values}
    assert values == {"state": "ACTIVE", "primary": "0.9", "secondary": "1.0"}
    story.run.state.first_failure = SimpleNamespace(reason="no position")
    apad = state()["/diagnostics"].status[0]
    assert (apad.level, apad.message) == (2, "first failure: no position")
    story.run.state.first_failure = None
    story.run.state.phase = "go to aMussel"
    assert state()["/diagnostics"].status[0].message == "go to aMussel"
    story.write(301_000, "end", reason="mission time", end_reason="mission time")
    assert state()["/diagnostics"].status[0].message == "mission time"


def test_events_are_those_with_a_text(story: Any, pool: Any, read: Read) -> None:
    topics = RunTopics(pool, story.run)
    story.apad(1000, 0.0, 0.0)
    story.write(2000, "end", reason="mission time", end_reason="mission time")
    (event,) = topics.events(story.poll())
    assert (event.topic, event.kind, event.kept) == ("/apad1/events", "std_msgs/String", 100)
    told = json.loads(read(event).data)
    assert (told["t"], told["kind"], told["reason"]) == (2000, "end", "mission time")
    assert "mission time" in told["text"] and told["category"]


def test_the_clock_is_mission_time(story: Any, pool: Any, read: Read) -> None:
    story.belief(90_250, 7)
    story.poll()
    clock = RunTopics(pool, story.run).clock()
    assert (clock.topic, clock.kept) == ("/clock", 0)
    assert (read(clock).clock.sec, read(clock).clock.nanosec) == (90, 250_000_000)


def test_names_stand_below_the_runs_namespace(begin: Callable[..., Any], pool: Any) -> None:
    story = begin(namespace="lab/basin")
    story.apad(1000, 0.0, 0.0)
    story.belief(1000, 7)
    story.truth(1000, 7)
    story.poll()
    topics = RunTopics(pool, story.run)
    assert topics.node == "musselbed_apad1"
    assert topics.summary == "apad1 and 12 aMussels; stamps are mission time, by /clock"
    below = {
        *(f"amussel7/{leaf}" for leaf in ("battery_state", "fix", "belief/pose", "truth/pose")),
        *(f"apad1/{leaf}" for leaf in ("odometry", "fix", "battery_state", "path", "plan", "markers")),
    }
    assert {it.topic for it in topics.state()} == {f"/lab/basin/{it}" for it in below} | {
        "/tf",
        "/diagnostics",
    }
    story.run.has_wall_time = True
    assert topics.summary == "apad1 and 12 aMussels; stamps are the wall clock's"


def vector(it: Any) -> tuple[float, float, float]:
    return it.x, it.y, it.z


def quaternion(it: Any) -> tuple[float, float, float, float]:
    return it.x, it.y, it.z, it.w
