"""Tests the layouts: their aPads and aMussels, the topics' names, and that each plotted field is one of the messages."""

from __future__ import annotations

import ast
import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from agents.time_scale import TimeScale
from apad_bridge.assembly.division import members
from apad_bridge.commands.main import main
from apad_bridge.records.bag import BagWriter
from apad_bridge.records.bag_messages import typestore
from apad_bridge.ros_names.names import below_apad, in_full
from apad_bridge.ros_names.names_table import SECTIONS, NameKind
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.viewers.layouts.kinds import KINDS
from apad_bridge.viewers.layouts.layout_content import LayoutFleet, hexadecimal, layout_fleet

LAUNCH = Path(__file__).parents[4] / "launch_scripts"
SHIPPED = LAUNCH / "layouts"
BATTERY, FLEET_TRUTH = "sensor_msgs/msg/BatteryState", "musselbed_msgs/msg/FleetTruth"


@pytest.fixture(scope="module")
def bay() -> Scenario:
    return load(LAUNCH / "scenarios" / "bay-120.yaml")


@pytest.fixture(scope="module")
def bay_fleet(bay: Scenario) -> LayoutFleet:
    return layout_fleet(bay, starts_of(bay))


@pytest.fixture(scope="module")
def pool() -> LayoutFleet:
    return of_scenario("pool-12")


def of_scenario(name: str, namespace: str = "") -> LayoutFleet:
    scenario = load(LAUNCH / "scenarios" / f"{name}.yaml")
    return layout_fleet(scenario, starts_of(scenario), namespace)


def rviz(fleet: LayoutFleet) -> Any:
    return yaml.safe_load(KINDS["rviz"].write(fleet))["Visualization Manager"]


def foxglove(fleet: LayoutFleet) -> Any:
    return json.loads(KINDS["foxglove"].write(fleet))


@pytest.mark.parametrize("kind", KINDS)
def test_the_shipped_layouts_are_up_to_date(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["layout", kind, str(LAUNCH / "scenarios" / "pool-12.yaml")]) == 0
    assert capsys.readouterr().out == (SHIPPED / f"musselbed{KINDS[kind].ending}").read_text()


@pytest.mark.parametrize("scenario", ["pool-12", "bay-120"])
def test_rqt_finds_one_topic_for_each_field(scenario: str) -> None:
    """rqt_py_common's topic_helpers take the first topic, in the master's order, that a field's name begins with."""
    fleet = of_scenario(scenario)
    names = [row.name for section in SECTIONS for row in section.rows if row.kind is NameKind.TOPIC]
    on_graph = {
        topic.replace("{apad}", apad.name).replace("{id}", str(agent_id))
        for apad in fleet.apads
        for agent_id in apad.ids
        for name in names
        for topic in (in_full("", name), in_full("", below_apad(name, apad.name)))
    }
    for name in (name for plot in rqt_plots(fleet) for name in plot):
        (topic,) = (it for it in on_graph if name == it or name.startswith(f"{it}/"))
        assert topic_and_field(name)[0] == topic


def rviz_topics(fleet: LayoutFleet) -> list[str]:
    topics = (it.get("Topic") or it.get("Marker Topic") for it in rviz(fleet)["Displays"])
    return [it for it in topics if it is not None]


def rqt_plots(fleet: LayoutFleet) -> list[list[str]]:
    """The topics of each plot; values are Python's repr, as rqt evaluates them."""
    perspective = json.loads(KINDS["rqt"].write(fleet))
    manager = perspective["groups"]["pluginmanager"]
    running = ast.literal_eval(manager["keys"]["running-plugins"]["repr"])
    places = ((plugin.replace("/", "__"), number) for plugin, its in running.items() for number in its)
    assert {f"plugin__{plugin}__{number}" for plugin, number in places} == manager["groups"].keys()
    return [
        ast.literal_eval(group["groups"]["plugin"]["keys"]["topics"]["repr"])
        for name, group in manager["groups"].items()
        if name.startswith("plugin__rqt_plot")
    ]


def foxglove_paths(fleet: LayoutFleet) -> dict[str, list[str]]:
    """The paths that the plots of each tab read; panels of the layout and configurations match one to one."""
    data = foxglove(fleet)
    panels = data["configById"]
    tabs = {tab["title"]: leaves(tab["layout"]) for tab in panels["Tab!plots"]["tabs"]}
    named = [*leaves(data["layout"]), *(leaf for tab in tabs.values() for leaf in tab)]
    assert Counter(named) == Counter(panels.keys())
    return {
        title: [path["value"] for leaf in tab for path in panels[leaf]["paths"]]
        for title, tab in tabs.items()
    }


def leaves(node: Any) -> list[str]:
    return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]


def battery_ids(names: list[str]) -> list[int]:
    """The ids of the aMussels whose batteries are among these names."""
    found = (re.fullmatch(r".*/amussel(\d+)/battery_state[./]percentage", name) for name in names)
    return [int(it[1]) for it in found if it]


def test_each_aPad_is_shown_with_whom_it_serves_and_one_by_itself_keeps_its_names(
    bay: Scenario, bay_fleet: LayoutFleet
) -> None:
    parts, paths, plots = members(bay, starts_of(bay)), foxglove_paths(bay_fleet), rqt_plots(bay_fleet)
    assert len(parts) == 5
    for part, plotted in zip(parts, plots[:5], strict=True):
        name, ids = f"/musselbed/{part.name}/apad", list(part.scenario.fleet.ids)
        assert battery_ids(paths[part.name]) == battery_ids(plotted) == ids
        assert (
            f"{name}/battery_state.percentage" in paths[part.name] and f"{name}/battery_fraction" in plotted
        )
    topics = [f"/musselbed/{part.name}/{it}" for part in parts for it in ("markers", "plan", "apad/path")]
    assert rviz_topics(bay_fleet) == topics
    alone = layout_fleet(parts[1].scenario, parts[1].starts)
    assert [it.ids for it in alone.apads] == [parts[1].scenario.fleet.ids]
    assert rviz_topics(alone)[0] == "/musselbed/apad2/markers"


def test_an_aPad_of_a_global_name(pool: LayoutFleet) -> None:
    data = resolve(load(LAUNCH / "scenarios" / "pool-12.yaml"))
    data["apad"]["name"] = "/lab/boat"
    scenario = from_data(data, "pool-12")
    fleet = layout_fleet(scenario, starts_of(scenario))
    assert rviz_topics(fleet) == rviz_topics(pool), "what is of the bench does not depend on the aPad's name"
    assert foxglove_paths(fleet).keys() == {"/lab/boat", "run.bag"}


def test_a_namespace_comes_before_all_names_but_those_of_a_bag() -> None:
    fleet = of_scenario("pool-12", "/bay/north")
    paths = foxglove_paths(fleet)
    for names, begins in (
        (rviz_topics(fleet), "/bay/north/musselbed/"),
        ([*rqt_plots(fleet)[0], *paths["apad1"]], "/bay/north/"),
        (paths["run.bag"], "/musselbed/"),
    ):
        assert names and [it for it in names if not it.startswith(begins)] == []
    summary = foxglove(fleet)["configById"]["DiagnosticSummary!fleet"]
    assert summary["topicToRender"] == "/diagnostics"


ALL_TYPES = get_typestore(Stores.ROS1_NOETIC)
ALL_TYPES.register({name: it for name, it in typestore().fielddefs.items() if name not in ALL_TYPES.types})


def field_type(type_name: str, path: str) -> str:
    """The basic type at the end of a path of fields, as `agents[0].charge`; KeyError when a message has no such field."""
    for step in re.sub(r"\[[^]]*\](\{[^}]*\})?", "", path).split("."):
        _, fields = ALL_TYPES.fielddefs[type_name]
        kind, detail = dict(fields)[step]
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (kind, detail), _ = detail
        type_name = detail if kind is Nodetype.NAME else detail[0]
    return type_name


TYPES = {
    "battery_state": BATTERY,
    "apad": "musselbed_msgs/msg/APadStatus",
    "truth": FLEET_TRUTH,
    "beliefs": "musselbed_msgs/msg/FleetBeliefs",
}


def topic_and_field(name: str) -> tuple[str, str]:
    """The topic and the field of a name, whichever sign the program puts between them."""
    found = re.fullmatch(r"(/.*/(?:battery_state|truth|beliefs|apad))[./](.*)", name)
    assert found is not None, name
    return found[1], found[2].replace("/", ".")


def test_every_field_that_is_plotted_is_a_number_in_its_message(pool: LayoutFleet) -> None:
    tabs = [*foxglove_paths(pool).values(), *rqt_plots(pool)]
    plotted = {topic_and_field(name) for tab in tabs for name in tab}
    fields = {(TYPES[topic.rpartition("/")[2]], re.sub(r"\d+", "N", field)) for topic, field in plotted}
    assert all(field_type(*it).startswith(("float", "uint")) for it in fields)
    assert len({field for _, field in fields}) == 4


def test_a_runs_bag_has_what_is_shown_of_it(pool: LayoutFleet, tmp_path: Path) -> None:
    BagWriter(tmp_path / "run.bag", TimeScale(30)).close()
    with Reader(tmp_path / "run.bag") as bag:
        in_bag = {connection.topic: connection.msgtype for connection in bag.connections}
    topics = {topic_and_field(name)[0] for name in foxglove_paths(pool)["run.bag"]}
    shown = {it: TYPES[it.rpartition("/")[2]] for it in topics}
    assert len(topics) == 2 and in_bag | shown == in_bag


def test_neighbours_have_colours_of_their_own() -> None:
    colours = {hexadecimal(number) for number in range(120)}
    assert len(colours) == 120 and all(re.fullmatch("#[0-9a-f]{6}", it) for it in colours)


def test_the_area_fits_into_rviz_on_the_same_grid_as_in_foxglove(bay_fleet: LayoutFleet) -> None:
    data = rviz(bay_fleet)
    view, grid = data["Views"]["Current"], data["Displays"][0]
    # The area is 60 m by 200 m, north first; RViz 1.14 draws on 1327 x 768 of a 1360 x 860 window, so the width decides.
    assert (view["X"], view["Y"]) == (100, 30)
    assert 0.8 * 1327 < view["Scale"] * 200 < 0.95 * 1327 and view["Scale"] * 60 < 0.95 * 768
    half_m = grid["Cell Size"] * grid["Plane Cell Count"] / 2
    for axis, to_m in (("X", 200), ("Y", 60)):
        middle_m = grid["Offset"][axis]
        assert middle_m % grid["Cell Size"] == 0 and middle_m - half_m <= 0 and middle_m + half_m >= to_m
    in_foxglove = foxglove(bay_fleet)["configById"]["3D!scene"]["layers"]["grid"]
    assert in_foxglove["size"] / in_foxglove["divisions"] == grid["Cell Size"] == 5
    assert in_foxglove["position"] == list(grid["Offset"].values())


def test_foxglove_hides_every_frame(bay_fleet: LayoutFleet) -> None:
    scene = foxglove(bay_fleet)["configById"]["3D!scene"]
    hidden = {name for name, how in scene["transforms"].items() if how == {"visible": False}}
    bodies = [*(f"amussel{n}/base_link" for n in range(1, 121)), *(f"apad{n}/base_link" for n in range(1, 6))]
    assert hidden == {f"frame:{it}" for it in ("musselbed/enu", "musselbed/ned", *bodies)}
