"""Recognises the generation of a live aPad by what its nodes offer on the graph."""

from __future__ import annotations

import time

import rosgraph
import rospy

from apad_bridge.assembly.stacks import stack_of, stacks, unloadable
from apad_bridge.doctor.graph import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.errors import VehicleNotReady
from apad_bridge.vehicle.stack import Stack


def offered_generations(graph: Graph, name: str) -> set[Generation]:
    """The generations offered below the aPad's namespace `name`, which is itself below that of this process."""
    return {
        stack.generation
        for stack in stacks()
        if all(graph.subscribers.get(goal) for goal in _goals(stack, name))
        and all(graph.services.get(service) for service in _services(stack, name))
    }


def _goals(stack: Stack, name: str) -> list[str]:
    # A package's stack has names that are not in our table.
    return [rospy.resolve_name(f"{name}/{action}/goal") for action in stack.recognised_actions]


def _services(stack: Stack, name: str) -> list[str]:
    return [rospy.resolve_name(f"{name}/{service}") for service in stack.recognised_services]


def _absence(stack: Stack, name: str) -> str:
    lines = [f"no subscriber on {goal}" for goal in _goals(stack, name)]
    lines += [f"nobody offers {service}" for service in _services(stack, name)]
    return f"{', '.join(lines)} (generation {stack.generation.name})"


def live_generation(name: str, timeout_s: float) -> Generation:
    """Waits up to `timeout_s` wall seconds for one. VehicleNotReady, in one line, when none comes, or several."""
    until_s, whole = time.monotonic() + timeout_s, rospy.resolve_name(name)
    while True:
        try:
            left_s = max(0.0, until_s - time.monotonic())
            offered = offered_generations(Graph.read_within(rosgraph.get_master_uri(), left_s), name)
        except Unreachable as error:
            raise VehicleNotReady(str(error)) from None
        if len(offered) == 1:
            return offered.pop()
        if offered:
            interfaces = " and ".join(stack_of(generation).known_by for generation in sorted(offered))
            raise VehicleNotReady(
                f"{whole} offers {interfaces}, which are {'two' if len(offered) == 2 else len(offered)} generations: "
                f"choose one by --generation, or by apad.generation in the scenario"
            )
        if time.monotonic() > until_s:
            absences = " and ".join(_absence(stack, name) for stack in stacks())
            broken = "".join(f"; {line}" for line in unloadable().values())
            raise VehicleNotReady(
                f"{whole} is not there after {timeout_s:g} s: {absences}; is apad.name right?{broken}"
            )
        # The master publishes no changes of the graph: it has to be asked.
        time.sleep(0.1)
