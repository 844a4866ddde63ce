"""ROS's own tools read the fleet from standard messages; the shipped layouts name topics that are there."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
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
One = Callable[[str], dict[str, Any]]


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


@pytest.fixture
def one(environment: dict[str, str]) -> One:
    """The next message on a topic, as rostopic prints it."""

    return partial(echoed, environment)


def test_a_battery_and_a_fix(one: One) -> None:
    battery = one("/amussel1/battery_state")
    # 75 % of the way from 3600 to 4200 mV
    assert (battery["voltage"], battery["percentage"]) == pytest.approx((4.05, 0.75))
    assert (battery["power_supply_status"], battery["location"]) == (2, "amussel1")
    apad = one("/musselbed/apad/battery_state")
    assert (apad["voltage"], apad["percentage"], apad["header"]["frame_id"]) == (15.0, 0.5, "apad1/base_link")
    fix = one("/amussel1/fix")
    # A degree of latitude is 111 111 m within 0.5 % there; one of longitude that times cos 43.93 degrees, 0.7202.
    assert fix["latitude"] - 43.9330937 == pytest.approx(10 / 111_111, rel=0.005)
    assert fix["longitude"] - 15.4443468 == pytest.approx(20 / (111_111 * 0.7202), rel=0.005)
    # Known variances, in the message's order: east, north, up.
    assert one("/amussel3/fix")["position_covariance"] == [9.0, 0.5, 0.0, 0.5, 4.0, 0.0, 0.0, 0.0, 0.0]


def test_how_sure_beliefs_are_and_what_a_forecast_cannot_foretell(one: One) -> None:
    first, sure = one("/musselbed/beliefs")["agents"]
    assert (first["id"], first["charge"], first["mode_probabilities"]) == (1, 0.75, [])
    assert (first["charge_deviation"], first["north_deviation"]) == ("nan", "nan")
    assert (sure["id"], sure["north_deviation"], sure["east_deviation"]) == (3, 2.0, 3.0)
    assert (sure["charge_low"], sure["charge_high"]) == pytest.approx((0.4804, 0.5196), abs=1e-4)
    assert (sure["mode_probabilities"][0], sure["clock_offset_ms"], sure["learned_from"]) == (1.0, 250.0, 3)
    marked = [it for it in one("/musselbed/markers")["markers"] if it["ns"] == "place_95"]
    assert [it["id"] for it in marked] == [3] and marked[0]["scale"]["x"] > 2 * 2.4 * 3
    told = one("/musselbed/forecast")
    assert (told["next_pickup_s"], told["batch_full_s"]) == (200.0, "nan")
    assert (told["mission_end_s"], told["apad_fraction_at_end"]) == (1860.0, 0.62)


def test_frames_have_z_up_and_the_plan_leads_from_the_aPad_to_its_aMussel(one: One) -> None:
    transforms = {it["child_frame_id"]: it for it in one("/tf")["transforms"]}
    assert transforms.keys() == {"amussel1/base_link", "amussel3/base_link", "apad1/base_link"}
    # Packets have a depth, positive down: 3 m. Nothing was heard of the depth of aMussel 3.
    depths = {name: it["transform"]["translation"]["z"] for name, it in transforms.items()}
    assert (depths["amussel1/base_link"], depths["amussel3/base_link"]) == (-3.0, 0.0)
    apad = transforms["apad1/base_link"]
    assert apad["header"]["frame_id"] == "musselbed/enu"
    # North 1, east 2 is x 2, y 1; heading east is along x: no turn.
    assert apad["transform"]["translation"] == {"x": 2.0, "y": 1.0, "z": 0.0}
    assert apad["transform"]["rotation"] == pytest.approx({"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0})
    (ned,) = one("/tf_static")["transforms"]
    assert ned["child_frame_id"] == "musselbed/ned"
    points = [it["pose"]["position"] for it in one("/musselbed/plan")["poses"]]
    assert points == [{"x": 2.0, "y": 1.0, "z": 0.0}, {"x": 20.0, "y": 10.0, "z": 0.0}]
    assert one("/musselbed/apad/path")["poses"]


def test_diagnostics_name_who_is_silent_and_who_wants_charging(one: One) -> None:
    told = {it["name"]: (it["level"], it["message"]) for it in one("/diagnostics")["status"]}
    assert told["musselbed: aMussel 1"] == (1, "wants charging: 75 %")
    assert told["musselbed: aMussel 2"] == (3, "no report yet")
    assert told["musselbed: mission"][1] == "idle wait" and told["musselbed: aPad"][0] == 0


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
