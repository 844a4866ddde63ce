"""Two fleets with the same ids on roslaunch's one master, each in a group with a namespace, seen by ROS's own tools."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from layout_topics import named_topics
from programs import ROOT, begun, done, lines_of, wait_until
from rosbags.rosbag1 import Reader
from scenario_files import write_scenario

from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.ros.system.master import loopback_environment
from apad_bridge.ros.system.route import free_port
from apad_bridge.ros.types.messages import generated_folder
from apad_bridge.ros_names.names_table import SECTIONS, NameKind
from apad_bridge.scenario.loader import load, with_overrides
from apad_bridge.scenario.starts import starts_of
from apad_bridge.viewers.layouts.kinds import KINDS
from apad_bridge.viewers.layouts.layout_content import layout_fleet

pytestmark = pytest.mark.system
LAUNCH = ROOT / "launch_scripts"
SPACES = {"basin": "basin", "lab/harbour": "harbour"}
"""Each with the folder of its run. The aPad of the first, of generation A, has a global name; the other's is relative."""

LAUNCHED = """
<launch>
  <arg name="scenario" value="{folder}/relative.yaml"/>
  <arg name="agents" value="3"/>
  <arg name="theta" value="600"/>
  <arg name="required" value="false"/>
  <group ns="basin">
    <include file="{launch}/fly.launch" pass_all_args="true">
      <arg name="scenario" value="{folder}/global.yaml"/>
      <arg name="speed" value="20"/>
      <arg name="options" value="--seed 3 --out basin"/>
    </include>
  </group>
  <group ns="lab/harbour">
    <include file="{launch}/fly.launch" pass_all_args="true">
      <arg name="generation" value="b"/>
      <arg name="own_clock" value="false"/>
      <arg name="options" value="--seed 3 --out harbour"/>
    </include>
  </group>
</launch>
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    uri = f"http://127.0.0.1:{free_port()}"
    return loopback_environment(tmp_path / "ros", uri) | {
        "ROS_PACKAGE_PATH": f"{LAUNCH}:{generated_folder()}",
        "PYTHONPATH": str(generated_folder()),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PWD": str(tmp_path),
        "PYTHONUNBUFFERED": "1",
    }


@contextmanager
def launched(folder: Path, environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    starts = ["id,north,east,battery", *(f"{n},{13 + n / 2},11,0.6" for n in (1, 2, 3))]
    (folder / "three.csv").write_text("\n".join(starts) + "\n")
    for name, apad in (("relative", "apad1"), ("global", "/apad1")):
        write_scenario(
            folder / f"{name}.yaml",
            duration_s=36_000,
            theta=600,
            fleet={"count": 3, "start": str(folder / "three.csv")},
            mission={"batch": 2, "docking": {"dock_s": 3, "undock_s": 1}},
            board={"float_timeout_s": 432000},
            apad={"name": apad},
        )
    (folder / "two.launch").write_text(LAUNCHED.format(launch=LAUNCH, folder=folder))
    command = ("roslaunch", "-p", environment["ROS_MASTER_URI"].rpartition(":")[2], folder / "two.launch")
    there: dict[str, Any] = {"env": environment, "cwd": folder}
    with (
        (folder / "roslaunch.log").open("w") as log,
        begun(*command, **there, stdout=log, stderr=log) as child,
    ):
        yield child


def graph_of(uri: str, child: subprocess.Popen[str]) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Nodes by topics and services, and types by topics, once both fleets are on the graph."""
    found: dict[str, list[str]] = {}

    def both() -> Graph | None:
        try:
            graph = Graph.read(uri)
        except Unreachable:
            return None
        # What a supervisor offers last.
        return (
            graph
            if all(f"/{space}/musselbed/apad1/give_back" in graph.services for space in SPACES)
            else None
        )

    graph = wait_until(both, child, why="they never came to be on one graph")
    for part in (graph.publishers, graph.subscribers, graph.services):
        for name, nodes in part.items():
            found.setdefault(name, []).extend(nodes)
    return found, graph.types


def charged(run: Path) -> int:
    """Counts the aMussels that have charged."""
    return len({it["id"] for it in lines_of(run, "truth") if it["state"] == "CHARGING"})


def tool(environment: dict[str, str], *command: str | int) -> str:
    return done(f"/usr/bin/{command[0]}", *command[1:], env=environment).stdout


OF_ROSPY = re.compile(r".*/(?:get_loggers|set_logger_level|tf2_frames)|/rosout(?:_agg)?")
TOLD, BARE = "/(?:goal|feedback|result)", "/(?:status|cancel)"
"""The topics of an action: those with a type of its own, and those without."""


def patterns() -> dict[str, str]:
    """Patterns of types by the pattern of a name in the table; those of an action's topics are the action's."""
    found = {}
    for row in (row for section in SECTIONS for row in section.rows):
        name, kind = (
            re.escape(row.name).replace(r"\{apad\}", "apad1").replace(r"\{id\}", r"\d+"),
            re.escape(row.type),
        )
        match row.kind:
            case NameKind.ACTION:
                found |= {name + TOLD: f"{kind}Action.*", name + BARE: ".*"}
            case NameKind.SERVICE:
                found[name] = ".*"
            case NameKind.TOPIC:
                found[name] = kind
    return found


def check_against_table(graph: dict[str, list[str]], types: dict[str, str]) -> set[str]:
    """That the table has every name, in a namespace unless it is global, with its type; the patterns that were met."""
    known, met = patterns(), set()
    for name, nodes in graph.items():
        if OF_ROSPY.fullmatch(name):
            continue
        space = next((it for it in SPACES if name.startswith(f"/{it}/")), None)
        of_global_apad = name.startswith("/apad1/")
        bare = name[1:] if of_global_apad else name.removeprefix(f"/{space}/")
        row = next((it for it in known if re.fullmatch(it, bare)), "")
        assert row, f"{name} is not in the table"
        assert (space is None) == (bare.startswith("/") or of_global_apad), name
        assert types.get(name, "*") == "*" or re.fullmatch(known[row], types[name]), (name, types[name])
        assert space is None or all(node.startswith(f"/{space}/") for node in nodes), (name, nodes)
        met.add(row)
    return met


def test_two_fleets_with_the_same_ids_side_by_side(tmp_path: Path, environment: dict[str, str]) -> None:
    with launched(tmp_path, environment) as child:
        graph, types = graph_of(environment["ROS_MASTER_URI"], child)
        met = check_against_table(graph, types)
        assert {"musselbed/beliefs", r"amussel\d+/battery_level", "/battery_alert", "/clock"} <= met
        assert sorted({*graph["/basin/amussel3/fix"], *graph["/lab/harbour/amussel3/fix"]}) == [
            "/basin/musselbed_1",
            "/lab/harbour/musselbed_1",
        ]
        assert "/basin/musselbed_1" in graph["/apad1/position"] and "/basin/apad1/position" not in graph
        assert "/lab/harbour/musselbed_1" in graph["/lab/harbour/apad1/position"]
        few = with_overrides(load(tmp_path / "relative.yaml"), agents=3)
        for space in SPACES:
            for kind in KINDS.values():
                named = named_topics(kind.write(layout_fleet(few, starts_of(few), f"/{space}"))) - {
                    "/musselbed/apad"
                }
                assert any(name.startswith(f"/{space}/") for name in named) and named <= graph.keys()
            believed = tool(environment, "rostopic", "echo", "-n", "1", f"/{space}/musselbed/beliefs")
            assert believed.count("state:") == 3
            answer = tool(environment, "rosservice", "call", f"/{space}/amussel3/charge_info")
            assert "consumer" in answer
        # In the namespace of a fleet a tool needs no more than the plain names.
        inside = environment | {"ROS_NAMESPACE": "lab/harbour"}
        assert "north" in tool(inside, "rostopic", "echo", "-n", "1", "apad1/position")
        frames = tool(environment, "rostopic", "echo", "-n", "10", "/tf")
        assert {"apad1/base_link", "lab/harbour/apad1/base_link"} <= set(
            re.findall(r'child_frame_id: "(.*)"', frames)
        )
        # Docked by whole names: a contact that is told to another namespace charges nobody here.
        wait_until(lambda: all(charged(tmp_path / folder) >= 2 for folder in SPACES.values()), child)
        for space in SPACES:
            assert "success: True" in tool(
                environment, "rosservice", "call", f"/{space}/musselbed/apad1/abort"
            )
        log, clean = tmp_path / "roslaunch.log", "process has finished cleanly"
        wait_until(lambda: log.read_text().count(clean) == len(SPACES), child)
    for space, folder in SPACES.items():
        summary = json.loads((tmp_path / folder / "summary.json").read_text())
        assert summary["ended_by"].startswith("a call: abort by node ") and summary["agents"] == 3
        assert json.loads((tmp_path / folder / "run.json").read_text())["namespace"] == space
        with Reader(tmp_path / folder / "run.bag") as bag:
            assert "/musselbed/beliefs" in {it.topic for it in bag.connections}
