"""Which generation an aPad is of: as the scenario says, or as the live graph shows."""

from __future__ import annotations

import time

import rosgraph
import rospy

from apad_bridge.doctor.graph import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.ros_names.names import of_apad
from apad_bridge.scenario.schema import Generation
from apad_bridge.vehicle.errors import VehicleNotReady


def offered_generations(graph: Graph, name: str) -> set[Generation]:
    """What the nodes below the aPad's namespace `name` offer, which is itself below that of this process."""
    offered = set()
    if graph.subscribers.get(_goal(name)):
        offered.add(Generation.A)
    if graph.services.get(_go_to(name)):
        offered.add(Generation.B)
    return offered


def _goal(name: str) -> str:
    return f"{rospy.resolve_name(of_apad(name, 'action_server'))}/goal"


def _go_to(name: str) -> str:
    return str(rospy.resolve_name(of_apad(name, "commander/primitive/go2point")))


def live_generation(name: str, timeout_s: float) -> Generation:
    """Waits up to `timeout_s` wall seconds for either. VehicleNotReady, in one line, when neither comes, or both."""
    until_s, whole = time.monotonic() + timeout_s, rospy.resolve_name(name)
    while True:
        try:
            offered = offered_generations(Graph.read(rosgraph.get_master_uri()), name)
        except Unreachable as error:
            raise VehicleNotReady(str(error)) from None
        if len(offered) == 1:
            return offered.pop()
        if offered:
            raise VehicleNotReady(
                f"{whole} offers an action_server and commander/primitive services, which are two generations: "
                f"choose one by --generation, or by apad.generation in the scenario"
            )
        if time.monotonic() > until_s:
            raise VehicleNotReady(
                f"{whole} is not there after {timeout_s:g} s: nobody listens to {_goal(name)} "
                f"(generation A) and nobody offers {_go_to(name)} (generation B); is apad.name right?"
            )
        # A graph is only told when asked.
        time.sleep(0.1)
