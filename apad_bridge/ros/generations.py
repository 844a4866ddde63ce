"""Which generation an aPad is of: as the scenario says, or as the live graph shows."""

from __future__ import annotations

import time

import rosgraph

from apad_bridge.diagnosis.graph import Graph
from apad_bridge.diagnosis.network import Unreachable
from apad_bridge.ros.vehicle_not_ready import VehicleNotReady
from apad_bridge.scenario.schema import Generation


def offered_generations(graph: Graph, name: str) -> set[Generation]:
    """What the nodes below the namespace `name` (without slashes) offer."""
    offered = set()
    if graph.subscribers.get(f"/{name}/action_server/goal"):
        offered.add(Generation.A)
    if graph.services.get(f"/{name}/commander/primitive/go2point"):
        offered.add(Generation.B)
    return offered


def live_generation(name: str, timeout_s: float) -> Generation:
    """Waits up to `timeout_s` wall seconds for either. VehicleNotReady, in one line, when neither comes, or both."""
    until_s = time.monotonic() + timeout_s
    while True:
        try:
            offered = offered_generations(Graph.read(rosgraph.get_master_uri()), name)
        except Unreachable as error:
            raise VehicleNotReady(str(error)) from None
        if len(offered) == 1:
            return offered.pop()
        if offered:
            raise VehicleNotReady(
                f"/{name} offers an action_server and commander/primitive services, which are two generations: "
                f"choose one by --generation, or by apad.generation in the scenario"
            )
        if time.monotonic() > until_s:
            raise VehicleNotReady(
                f"/{name} is not there after {timeout_s:g} s: nobody listens to /{name}/action_server/goal (generation A) "
                f"and nobody offers /{name}/commander/primitive/go2point (generation B); is apad.name right?"
            )
        # A graph is only told when asked.
        time.sleep(0.1)
