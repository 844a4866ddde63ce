"""The messages of a run, read by rosbags; values by hand: x east, y north, z up, angles anticlockwise from east."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from pytest import approx

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


def marked(story: Any) -> None:
    story.apad(5000, 1.0, 2.0, EAST_RAD, docks=(9, 7))
    story.belief(5000, 7)
    story.belief(5000, 8, place_cov=[4.0, 0.0, 9.0], mode="IDLE")


def diagnosed(story: Any) -> None:
    story.apad(300_000, 1.0, 2.0, docks=(7,))
    story.belief(300_000, 7, charge=0.9)
    story.poll()


NAN, UNTURNED = approx(math.nan, nan_ok=True), (0.0, 0.0, 0.0, 1.0)
NORTH_DEG, EAST_DEG = 1 / 111_111, 1 / (111_111 * 0.7202)
"""A degree of latitude is 111 111 m within 0.5 % there; one of longitude that times cos 43.93 degrees."""
ORIGIN_DEG = 43.9330937, 15.4443468


def plain(value: Any) -> Any:
    """A part of a message as numbers and texts."""
    if hasattr(value, "w"):
        return quaternion(value)
    return vector(value) if hasattr(value, "x") else value.tolist() if hasattr(value, "tolist") else value


MESSAGES: dict[str, tuple[Callable[[Any], object], str, dict[str, Any]]] = {
    # 75 % and 50 % of the way from 3.6 to 4.2 V.
    "an aMussel's battery": (
        lambda it: it.belief(5500, 7, charge=0.75, secondary=0.5, heard=4500),
        "/amussel7/battery_state",
        {
            "voltage": approx(4.05),
            "percentage": approx(0.75),
            "cell_voltage": approx([4.05, 3.9]),
            "location": "amussel7",
        }
        | dict.fromkeys(("temperature", "current", "charge", "capacity", "design_capacity"), NAN)
        | {"power_supply_status": 2, "power_supply_health": 1, "power_supply_technology": 3, "present": True}
        | {"header.frame_id": "amussel7/base_link"}
        | {"header.stamp.sec": 4, "header.stamp.nanosec": 500_000_000},
    ),
    "an aMussel's place in degrees": (
        lambda it: it.belief(5000, 7, north_m=10.0, east_m=20.0, reported={"depth_m": 3.0}),
        "/amussel7/fix",
        {"altitude": NAN, "status.status": 0, "status.service": 1, "position_covariance_type": 0}
        | {"latitude": (10 * NORTH_DEG, 0), "longitude": (20 * EAST_DEG, 1)},
    ),
    "a place in degrees that is known to some metres": (
        lambda it: it.belief(5000, 8, place_cov=[4.0, 0.5, 9.0], mode="IDLE"),
        "/amussel8/fix",
        {
            "position_covariance_type": 3,
            "position_covariance.0": 9.0,
            "header.frame_id": "amussel8/base_link",
        },
    ),
    "a belief": (
        lambda it: it.belief(5000, 7, north_m=10.0, east_m=20.0, reported={"depth_m": 3.0}),
        "/amussel7/belief/pose",
        {"header.frame_id": "musselbed/enu", "pose.pose.position": (20.0, 10.0, -3.0)}
        | {"pose.pose.orientation": UNTURNED, "pose.covariance.0": 0.0},
    ),
    "a belief that is known to some metres": (
        lambda it: it.belief(5000, 8, place_cov=[4.0, 0.5, 9.0], mode="IDLE"),
        "/amussel8/belief/pose",
        {"pose.covariance.0": 9.0},
    ),
    "the truth of a simulated aMussel": (
        lambda it: it.truth(5000, 4, depth=[150_000, 3_000_000], buoyancy="SINK"),
        "/amussel4/truth/pose",
        {"pose.position": (2.5, 1.5, -3.0), "header.frame_id": "musselbed/enu", "header.stamp.sec": 5},
    ),
    # North is a quarter turn from x.
    "the aPad's way": (
        lambda it: (it.apad(1000, 2.0, 3.0, 0.2), it.apad(2000, 4.0, 4.0, 0.0)),
        "/apad1/odometry",
        {"header.frame_id": "musselbed/enu", "child_frame_id": "apad1/base_link"}
        | {"pose.pose.position": (4.0, 4.0, 0.0), "pose.pose.orientation": approx((0.0, 0.0, HALF, HALF))}
        | {"twist.twist.linear": approx((2.0, -1.0, 0.0)), "twist.twist.angular": approx((0.0, 0.0, 0.2))},
    ),
    "the aPad's battery": (
        lambda it: it.apad(2000, 4.0, 4.0, 0.0),
        "/apad1/battery_state",
        {
            "voltage": approx(15.5),
            "percentage": approx(0.9),
            "location": "apad1",
            "header.frame_id": "apad1/base_link",
        }
        | {"power_supply_status": 2, "power_supply_health": 0, "header.stamp.sec": 2},
    ),
    "the aPad's place in degrees": (
        lambda it: it.apad(2000, 4.0, 4.0, 0.0),
        "/apad1/fix",
        {"latitude": (4 * NORTH_DEG, 0), "position_covariance_type": 0},
    ),
    **{
        f"frames are one tree with z up: {child}": (
            lambda it: (
                it.belief(5000, 7, reported={"depth_m": 3.0}),
                it.apad(5000, 1.0, 2.0, EAST_RAD),
            ),
            "/tf",
            {f"transforms.{n}.header.frame_id": "musselbed/enu", f"transforms.{n}.child_frame_id": child}
            | {f"transforms.{n}.header.stamp.sec": 5, f"transforms.{n}.transform.translation": place}
            | {f"transforms.{n}.transform.rotation": turned},
        )
        for n, child, place, turned in (
            (0, "amussel7/base_link", (20.0, 10.0, -3.0), UNTURNED),
            (1, "apad1/base_link", (2.0, 1.0, 0.0), approx(UNTURNED)),
        )
    },
    "the screen is cleared before the markers": (
        marked,
        "/apad1/markers",
        {
            "markers.0.action": 3,
            "markers.0.pose.orientation.w": 1.0,
            "markers.0.header.frame_id": "musselbed/enu",
        },
    ),
    "a ball is an aMussel": (
        marked,
        "/apad1/markers",
        {"markers.1.ns": "amussels", "markers.1.id": 7, "markers.1.type": 2, "markers.1.action": 0}
        | {"markers.1.pose.position": (2.0, 1.0, 0.0), "markers.1.scale": (0.5, 0.5, 0.5)}
        | {
            "markers.1.color.r": approx(0.0),
            "markers.1.color.g": approx(0.8),
            "markers.1.color.b": approx(0.9),
            "markers.1.color.a": approx(1.0),
        },
    ),
    "a text is its label": (
        marked,
        "/apad1/markers",
        {"markers.2.text": "7: 75 %", "markers.2.scale.z": 0.6},
    ),
    "the aPad's diagnosis": (
        diagnosed,
        "/diagnostics",
        {"header.stamp.sec": 300, "status.0.name": "musselbed: aPad apad1", "status.0.hardware_id": "apad1"}
        | {"status.0.level": 0, "status.0.values": {"services": "0", "docks": "7 - - -", "primitive": ""}},
    ),
    "the diagnosis of an aMussel that has reported nothing": (
        diagnosed,
        "/diagnostics",
        {"status.1.level": 3, "status.1.message": "no report yet", "status.1.values": {}},
    ),
    "the diagnosis of an aMussel": (
        diagnosed,
        "/diagnostics",
        {"status.7.name": "musselbed: aMussel 7", "status.7.level": 0, "status.7.message": "90 %"}
        | {"status.7.values": {"state": "ACTIVE", "primary": "0.9", "secondary": "1.0"}},
    ),
    "the first failure": (
        lambda it: (
            diagnosed(it),
            setattr(it.run.state, "first_failure", SimpleNamespace(reason="no position")),
        ),
        "/diagnostics",
        {"status.0.level": 2, "status.0.message": "first failure: no position"},
    ),
    "the phase": (
        lambda it: (diagnosed(it), setattr(it.run.state, "phase", "go to aMussel")),
        "/diagnostics",
        {"status.0.message": "go to aMussel"},
    ),
    "the end": (
        lambda it: (
            diagnosed(it),
            it.write(301_000, "end", reason="mission time", end_reason="mission time"),
        ),
        "/diagnostics",
        {"status.0.message": "mission time"},
    ),
}


@pytest.mark.parametrize(("write", "topic", "told"), MESSAGES.values(), ids=MESSAGES)
def test_a_message(
    story: Any,
    state: Callable[[], dict[str, Any]],
    write: Callable[[Any], object],
    topic: str,
    told: dict[str, Any],
) -> None:
    """Of degrees, the row has those from the origin's, and which of the two."""
    write(story)
    message = state()[topic]
    for path, wanted in told.items():
        value = message
        for name in path.split("."):
            value = value[int(name)] if name.isdigit() else getattr(value, name)
        if name == "values":
            value = {it.key: it.value for it in value}
        if name in ("latitude", "longitude"):
            assert value - ORIGIN_DEG[wanted[1]] == approx(wanted[0], rel=0.005), path
        else:
            assert plain(value) == wanted, path


def test_only_what_is_known_of_an_aMussel_is_told(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    story.belief(5000, 7)
    story.truth(5000, 4)
    came = state()
    assert "/amussel7/truth/pose" not in came and "/amussel4/belief/pose" not in came
    assert [it.hardware_id for it in came["/diagnostics"].status[1:]] == [
        f"amussel{it}" for it in range(1, 13)
    ]


def test_values_that_a_vehicle_does_not_tell(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    place = {"north_m": 0.0, "east_m": 0.0, "heading_rad": 0.0, "primitive": "none", "docks": [-1] * 4}
    story.write(1000, "apad", voltage_v=None, battery=0.5, **place)
    assert math.isnan(state()["/apad1/battery_state"].voltage)
    story.write(2000, "apad", voltage_v=None, battery=None, **place)
    assert "/apad1/battery_state" not in state()


def test_paths_come_when_they_change_and_are_kept(story: Any, pool: Any, read: Read) -> None:
    """Each row has what is written, and the paths that come because of it."""
    topics = RunTopics(pool, story.run)
    plan = {
        "what": "collect",
        "strategy": "greedy",
        "costs": COSTS,
        "beliefs": [],
        "steps": [{"agent": 7, "dock": 0}],
    }
    begin, place = (0.0, 0.0, 0.0), (4.0, 3.0, 0.0)
    told: list[tuple[Callable[[], object], dict[str, list[tuple[float, ...]]]]] = [
        (lambda: story.apad(1000, 0.0, 0.0), {"path": [begin] * 2, "plan": []}),
        (lambda: story.belief(2000, 7, north_m=3.0, east_m=4.0), {}),
        (lambda: story.write(3000, "plan", **plan), {"plan": [begin, place]}),
        (
            lambda: story.apad(4000, 1.0, 0.0),
            {"path": [begin, (0.0, 1.0, 0.0), (0.0, 1.0, 0.0)], "plan": [(0.0, 1.0, 0.0), place]},
        ),
    ]
    for write, paths in told:
        write()
        story.poll()
        kept = [it for it in topics.state() if it.kind == "nav_msgs/Path"]
        assert all(it.kept == 1 for it in kept)
        came = {it.topic: [vector(pose.pose.position) for pose in read(it).poses] for it in kept}
        assert came == {f"/apad1/{name}": places for name, places in paths.items()}


def test_one_frame_is_fixed(story: Any, pool: Any, read: Read) -> None:
    """Half a turn about the axis between x and y: x becomes y, y becomes x, z its opposite."""
    fixed = RunTopics(pool, story.run).fixed_frames()
    (ned,) = read(fixed).transforms
    assert (fixed.topic, fixed.kept) == ("/tf_static", 1)
    assert (ned.header.frame_id, ned.child_frame_id) == ("musselbed/enu", "musselbed/ned")
    assert quaternion(ned.transform.rotation) == approx((HALF, HALF, 0.0, 0.0))


def test_markers_come_in_layers(story: Any, state: Callable[[], dict[str, Any]]) -> None:
    marked(story)
    _, *markers = state()["/apad1/markers"].markers
    assert [(it.ns, it.id, it.type, it.action) for it in markers] == [
        ("amussels", 7, 2, 0),
        ("labels", 7, 9, 0),
        ("amussels", 8, 2, 0),
        ("labels", 8, 9, 0),
        ("place_95", 8, 3, 0),
        ("apad", 0, 0, 0),
    ]


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


@pytest.mark.parametrize(
    ("has_wall_time", "stamps"),
    [(False, "stamps are mission time, by /clock"), (True, "stamps are the wall clock's")],
)
def test_names_stand_below_the_runs_namespace(
    begin: Callable[..., Any], pool: Any, has_wall_time: bool, stamps: str
) -> None:
    story = begin(namespace="lab/basin")
    for write in (
        lambda: story.apad(1000, 0.0, 0.0),
        lambda: story.belief(1000, 7),
        lambda: story.truth(1000, 7),
    ):
        write()
    story.poll()
    topics, story.run.has_wall_time = RunTopics(pool, story.run), has_wall_time
    assert (topics.node, topics.summary) == ("musselbed_apad1", f"apad1 and 12 aMussels; {stamps}")
    below = {
        *(f"amussel7/{leaf}" for leaf in ("battery_state", "fix", "belief/pose", "truth/pose")),
        *(f"apad1/{leaf}" for leaf in ("odometry", "fix", "battery_state", "path", "plan", "markers")),
    }
    names = {it.topic for it in topics.state()}
    assert names == {f"/lab/basin/{it}" for it in below} | {"/tf", "/diagnostics"}


def vector(it: Any) -> tuple[float, float, float]:
    return it.x, it.y, it.z


def quaternion(it: Any) -> tuple[float, float, float, float]:
    return it.x, it.y, it.z, it.w
