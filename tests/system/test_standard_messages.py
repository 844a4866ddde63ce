"""ROS's own tools read the fleet from standard messages; the shipped layouts name topics that are there."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from graphs import echoed, served_pool
from layout_topics import TYPES, named_topics
from programs import MUSSELBED, Begin, begun, code_here, done, ended_well, line_of, lines_of, wait_until
from rosbags.highlevel import AnyReader
from scenario_files import POOL_FILE

from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.ros.types.messages import generated_folder
from apad_bridge.scenario.loader import load, with_overrides
from apad_bridge.scenario.starts import starts_of
from apad_bridge.viewers.layouts.kinds import KINDS
from apad_bridge.viewers.layouts.layout_content import layout_fleet

pytestmark = pytest.mark.system
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """Of a tool beside a node that shows a fleet of three. It finds our definitions where the installation laid them."""
    home = tmp_path_factory.mktemp("ros")
    master = start_master(home, timeout_s=120, orphan_s=0)
    environment = loopback_environment(home, master.uri)
    inside = environment | {"PYTHONPATH": str(HERE.parents[1])}
    command = (sys.executable, HERE / "show_standard_topics.py")
    with begun(*command, env=inside, stdin=subprocess.PIPE, ends_by=signal.SIGTERM) as node:
        assert line_of(node) == "showing"
        yield environment | dict.fromkeys(("PYTHONPATH", "ROS_PACKAGE_PATH"), str(generated_folder()))
    master.stop()


def rounded(*values: float) -> list[float]:
    return [round(it, 4) for it in values]


def places(transforms: list[dict[str, Any]]) -> dict[str, tuple[str, list[float], list[float]]]:
    """The parent, the place and the turn of each frame."""
    return {
        it["child_frame_id"]: (
            it["header"]["frame_id"],
            rounded(*it["transform"]["translation"].values()),
            rounded(*it["transform"]["rotation"].values()),
        )
        for it in transforms
    }


def of_belief(it: dict[str, Any]) -> list[Any]:
    charges = f"{it['charge']:.2f} {float(it['charge_deviation']):.2f}"
    return [charges, it["north_deviation"], it["east_deviation"], it["learned_from"]]


ENU, NO_TURN, RIGHT_ANGLE = "musselbed/enu", [0.0, 0.0, 0.0, 1.0], round(0.5**0.5, 4)
SHOWN: dict[str, tuple[str, Callable[[dict[str, Any]], Any], Any]] = {
    # 75 % of the way from 3600 to 4200 mV
    "an aMussel's battery": (
        "/amussel1/battery_state",
        lambda it: [*rounded(it["voltage"], it["percentage"]), it["power_supply_status"], it["location"]],
        [4.05, 0.75, 2, "amussel1"],
    ),
    "the aPad's battery": (
        "/musselbed/apad/battery_state",
        lambda it: (it["voltage"], it["percentage"], it["header"]["frame_id"]),
        (15.0, 0.5, "apad1/base_link"),
    ),
    # A degree of latitude is 111 111 m within 0.5 % there; one of longitude that times cos 43.93 degrees, 0.7202.
    "a fix": (
        "/amussel1/fix",
        lambda it: [
            (it["latitude"] - 43.9330937) * 111_111,
            (it["longitude"] - 15.4443468) * 111_111 * 0.7202,
        ],
        pytest.approx([10, 20], rel=0.005),
    ),
    # Known variances, in the message's order: east, north, up.
    "a fix with variances": (
        "/amussel3/fix",
        lambda it: it["position_covariance"],
        [9.0, 0.5, 0.0, 0.5, 4.0, 0.0, 0.0, 0.0, 0.0],
    ),
    "how sure beliefs are": (
        "/musselbed/beliefs",
        lambda it: [(one["id"], of_belief(one)) for one in it["agents"]],
        [(1, ["0.75 nan", "nan", "nan", 1]), (3, ["0.50 0.01", 2.0, 3.0, 3])],
    ),
    "within what a charge lies, and by what clock": (
        "/musselbed/beliefs",
        lambda it: [
            *rounded(it["agents"][1]["charge_low"], it["agents"][1]["charge_high"]),
            it["agents"][1]["mode_probabilities"][0],
            it["agents"][1]["clock_offset_ms"],
            it["agents"][0]["mode_probabilities"],
        ],
        [0.4804, 0.5196, 1.0, 250.0, []],
    ),
    "an ellipse of the sure one alone": (
        "/musselbed/markers",
        lambda it: [(m["id"], m["scale"]["x"] > 2 * 2.4 * 3) for m in it["markers"] if m["ns"] == "place_95"],
        [(3, True)],
    ),
    "what a forecast foretells and what it cannot": (
        "/musselbed/forecast",
        lambda it: (
            [it[f"{name}"] for name in ("next_pickup_s", "batch_full_s", "mission_end_s")]
            + rounded(it["apad_fraction_at_end"])
        ),
        [200.0, "nan", 1860.0, 0.62],
    ),
    # Packets have a depth, positive down: 3 m. Nothing was heard of the depth of aMussel 3. North 1, east 2 is x 2, y 1;
    # heading east is along x: no turn.
    "frames with z up": (
        "/tf",
        lambda it: places(it["transforms"]),
        {
            "amussel1/base_link": (ENU, [20.0, 10.0, -3.0], NO_TURN),
            "amussel3/base_link": (ENU, [20.0, 10.0, 0.0], NO_TURN),
            "apad1/base_link": (ENU, [2.0, 1.0, 0.0], NO_TURN),
        },
    ),
    "the frame with z down": (
        "/tf_static",
        lambda it: places(it["transforms"]),
        {"musselbed/ned": (ENU, [0.0] * 3, [RIGHT_ANGLE, RIGHT_ANGLE, 0.0, 0.0])},
    ),
    "the plan from the aPad to its aMussel": (
        "/musselbed/plan",
        lambda it: [list(one["pose"]["position"].values()) for one in it["poses"]],
        [[2.0, 1.0, 0.0], [20.0, 10.0, 0.0]],
    ),
    "the aPad's way": ("/musselbed/apad/path", lambda it: bool(it["poses"]), True),
    "who is silent, and who wants charging": (
        "/diagnostics",
        lambda it: (
            {
                one["name"].removeprefix("musselbed: "): (one["level"], one["message"])
                for one in it["status"]
            }.items()
            >= {
                "aMussel 1": (1, "wants charging: 75 %"),
                "aMussel 2": (3, "no report yet"),
            }.items()
            and {one["name"]: one["level"] for one in it["status"]}["musselbed: aPad"] == 0
        ),
        True,
    ),
}
"""What is read in the next message on a topic, as rostopic prints it."""


@pytest.mark.parametrize("name", SHOWN)
def test_ros_tools_read(name: str, environment: dict[str, str]) -> None:
    topic, read, wanted = SHOWN[name]
    assert read(echoed(environment, topic)) == wanted


def frames_in(message: Any) -> Iterator[str]:
    """Every frame that a message names, in its own header and in those of its parts, but for an empty one."""
    if isinstance(message, list):
        for part in message:
            yield from frames_in(part)
    for name, value in vars(message).items() if hasattr(message, "__msgtype__") else ():
        if name in ("frame_id", "child_frame_id") and value:
            yield value
        yield from frames_in(value)


def read_frames(bag: Path) -> tuple[dict[str, str], dict[str, set[str]]]:
    """The parent of each frame of TF, and the frames that each topic names."""
    parents, named = dict[str, str](), dict[str, set[str]]()
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            message: Any = reader.deserialize(data, connection.msgtype)
            named.setdefault(connection.topic, set()).update(frames_in(message))
            if connection.topic in ("/tf", "/tf_static"):
                for it in message.transforms:
                    assert parents.setdefault(it.child_frame_id, it.header.frame_id) == it.header.frame_id
    return parents, named


@pytest.mark.parametrize(("generation", "namespace"), [("a", ""), ("b", "basin")])
def test_tf_has_every_frame_that_a_flight_or_its_bag_names(
    generation: str, namespace: str, tmp_path: Path, begin: Begin
) -> None:
    """By the transforms on the graph, followed to their root, which is the fixed frame of the layouts."""
    run, recorded = tmp_path / "run", tmp_path / "all.bag"
    scenario = served_pool(tmp_path / "frames.yaml", 6.0, 3600)
    asked = ("run", scenario, "--speed", 10, "--generation", generation, "--out", run)
    flight = begin(*MUSSELBED, *asked, env={**os.environ, "ROS_NAMESPACE": f"/{namespace}"})
    wait_until(lambda: lines_of(run), flight)
    uri = json.loads((run / "run.json").read_text())["master_uri"]
    record = ("/usr/bin/rosbag", "record", "-a", "-O", recorded)
    recorder = begin(*record, env=loopback_environment(tmp_path / "ros", uri), start_new_session=True)
    wait_until(lambda: lines_of(run, "released"), flight)
    os.killpg(recorder.pid, signal.SIGINT)
    recorder.communicate()
    flight.send_signal(signal.SIGINT)
    ended_well(flight, 130)
    parents, named = read_frames(recorded)
    own, of_bag = read_frames(run / "run.bag")
    assert own == {} and set().union(*of_bag.values()) == {"musselbed/ned"}
    world = f"{namespace}/musselbed/enu".strip("/")
    in_bag = {topic: {f"{namespace}/{it}".strip("/") for it in names} for topic, names in of_bag.items()}
    assert named.keys() > {f"/{namespace}/apad1/position".replace("//", "/"), "/tf", "/tf_static"}
    # The legacy stack's broadcast names an aMussel there, and no frame.
    for topic, names in [*named.items(), *in_bag.items()]:
        for name in names if topic != "/battery_alert" else ():
            root = name
            while root in parents:
                root = parents[root]
            assert root == world, f"{topic} names {name}"


def test_what_two_rosbags_recorded_becomes_one_bag(
    environment: dict[str, str], tmp_path: Path, begin: Begin, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = [tmp_path / "apad.bag", tmp_path / "station.bag"]
    topics = {"/diagnostics": "diagnostic_msgs/DiagnosticArray", "/musselbed/plan": "nav_msgs/Path"}
    record = ("/usr/bin/rosbag", "record", "--limit", 50, *topics, "-O")
    for it in [begin(*record, bag, env=environment) for bag in bags]:
        ended_well(it)

    def info(bag: Path) -> Any:
        return yaml.safe_load(done("/usr/bin/rosbag", "info", "--yaml", bag, env=environment).stdout)

    assert {it["topic"]: (it["type"], it["messages"]) for it in info(bags[0])["topics"]} == {
        topic: (kind, 50) for topic, kind in topics.items()
    }
    out = tmp_path / "whole.bag"
    assert code_here("logs", "merge", *bags, "--out", out, "--json") == 0
    told = json.loads(capsys.readouterr().out)
    (clock,) = told["clock"]
    assert abs(clock["offset_s"]) < 0.5  # one machine, one clock
    messages = told["messages"]
    assert messages["both"] > 0
    assert messages["merged"] == messages["first"] + messages["second"] - messages["both"]
    assert info(out)["messages"] == messages["merged"]


def test_layouts_name_topics_that_are_there(environment: dict[str, str]) -> None:
    two = with_overrides(load(POOL_FILE), agents=2)
    listed = done("/usr/bin/rostopic", "list", "-p", "-v", env=environment).stdout.splitlines()
    topics = {row[1]: row[2].strip("[]") for row in (it.split() for it in listed if it.startswith(" * "))}
    for kind, layout in KINDS.items():
        text = layout.write(layout_fleet(two, starts_of(two)))
        assert "musselbed/enu" in text or kind not in ("rviz", "foxglove")
        named = named_topics(text)
        assert len(named) >= 3
        assert {it: topics[it] for it in named} == {it: TYPES[it.rpartition("/")[2]] for it in named}
