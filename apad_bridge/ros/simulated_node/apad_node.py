"""The simulated aPad as a ROS 1 node of the scenario's generation, A if it names none, in a process of its own.

    python -m apad_bridge.ros.simulated_node.apad_node --scenario RESOLVED.yaml [--apad NAME] [--held DOCK:ID,...]
        [--time clock|wall]

A thin shell around the simulated vehicle of a generation. It follows /clock and has no time of its own; or, to stand in for
a real vehicle on somebody's master, it follows the wall clock. When it has handled all that is due by a /clock of T, it
publishes `stateRef` stamped T, last, to confirm that T was handled. It prints `ready` when it is on the graph, ends on
SIGTERM, SIGINT or SIGHUP with status 130, and ends by itself when /clock was silent for `--orphan-s` wall seconds.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rospy

from agents.hosting import interrupts
from agents.hosting.started import outlive_starter
from apad_bridge.assembly.division import with_apad
from apad_bridge.assembly.stacks import part_of, stack_of
from apad_bridge.ros.system.node import start_node
from apad_bridge.ros.types.messages import MessagesUnusable, use_generated_messages
from apad_bridge.ros_names.names import beside_others, is_one_of_several, plain
from apad_bridge.scenario.choices import OWN_GENERATIONS
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import load, with_overrides
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.clock import StopSign
from apad_bridge.vehicle.link_errors import VehicleNotReady

if TYPE_CHECKING:
    from apad_bridge.ros.simulated_node.legacy_server import LegacyServer

_WALL_STEP_S = 0.05
"""The period of its fastest topic, for steps on the wall clock."""


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m apad_bridge.ros.simulated_node.apad_node", description=__doc__
    )
    parser.add_argument("--scenario", type=Path, required=True)
    parser.add_argument("--apad", metavar="NAME", help="which of the scenario's aPads (default: the first)")
    parser.add_argument("--generation", choices=sorted(OWN_GENERATIONS), help="instead of the scenario's")
    parser.add_argument("--held", type=held_by, default={}, help="the aMussels that its docks hold")
    parser.add_argument("--time", choices=["clock", "wall"], default="clock")
    parser.add_argument("--xmlrpc-port", type=int, default=0)
    parser.add_argument("--orphan-s", type=float, default=600.0)
    arguments = parser.parse_args()
    try:
        whole = with_overrides(load(arguments.scenario), generation=arguments.generation)
        scenario = with_apad(whole, arguments.apad or whole.apad.name)
    except ScenarioError as wrong:
        print(f"musselbed: {wrong}", file=sys.stderr)
        return 2
    try:
        use_generated_messages()
    except MessagesUnusable as wrong:
        print(f"musselbed: {wrong}", file=sys.stderr)
        return 1
    follows_clock = arguments.time == "clock"
    try:
        with interrupts.interruptible():  # rospy waits for its master for ever
            node = _on_graph(whole, scenario, arguments.xmlrpc_port, arguments.held)
            if follows_clock:
                node.follow_clock()
    except VehicleNotReady as wrong:
        print(f"musselbed: {wrong}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        rospy.signal_shutdown("asked to end while it started")
        return interrupts.INTERRUPTED
    outlive_starter()
    stop = StopSign()
    with interrupts.received_by(stop.set):
        print("ready", flush=True)
        while not follows_clock and not stop.wait(_WALL_STEP_S) and not rospy.is_shutdown():
            node.advance_to(time.time_ns() // 1_000_000)
        while not stop.wait(1.0) and not rospy.is_shutdown():
            if time.monotonic() - node.clock_arrived_s > arguments.orphan_s:
                print(
                    f"musselbed: no /clock for {arguments.orphan_s:g} s: the aPad's node ends",
                    file=sys.stderr,
                )
                break
    rospy.signal_shutdown("asked to end")
    return interrupts.INTERRUPTED if stop.is_set() else 0


def held_by(text: str) -> dict[int, int]:
    """The aMussels by dock index, from `DOCK:ID,...`; ValueError for another text."""
    return {int(dock): int(held) for dock, held in (it.split(":") for it in text.split(",") if it)}


def _on_graph(
    whole: Scenario, scenario: Scenario, xmlrpc_port: int, held: dict[int, int]
) -> LegacyServer[Any]:
    # Its own supervisor publishes the changes of its docks.
    remappings = beside_others(scenario.apad.name) if is_one_of_several(whole) else []
    start_node(f"{plain(scenario.apad.name)}_simulated", remappings, xmlrpc_port=xmlrpc_port)
    server: type[LegacyServer[Any]] = part_of(
        stack_of(scenario.apad.generation).generation, "ros.server", "Server"
    )
    return server.of_scenario(scenario, held)


if __name__ == "__main__":
    sys.exit(main())
