"""Opens the link to a scenario's aPad, of whichever generation."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import rosgraph
import rospy

from agents.time_scale import MissionMs
from apad_bridge.assembly.stacks import part_of, stack_of, stacks, unloadable
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.records.samples import TruthSample
from apad_bridge.ros.links.legacy_link import OpenedAPad, OpenLink
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.run_options import APadKind, RunOptions
from apad_bridge.scenario.schema import LIMITS, Scenario
from apad_bridge.vehicle.capabilities import Capabilities
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.link_errors import VehicleNotReady
from apad_bridge.vehicle.stack import Stack


# Recognises the generation of a live aPad by what its nodes offer on the graph.
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


READY_S = 15.0
_AFLOAT_M = 0.1
"""A body less deep than this floats."""
TruthsAt = Callable[[MissionMs], list[TruthSample]]


def reports_contact(scenario: Scenario) -> bool:
    """True unless the aPad's stack does not report what its docks hold.

    The scenario names the generation, or the graph shows exactly one at this moment.
    """
    if (generation := scenario.apad.generation) is not Generation.AUTO:
        return _capabilities(generation, scenario).reports_contact
    try:
        offered = offered_generations(
            Graph.read_within(rosgraph.get_master_uri(), READY_S), scenario.apad.name
        )
    except Unreachable:
        return True
    return len(offered) != 1 or _capabilities(offered.pop(), scenario).reports_contact


def _capabilities(generation: Generation, scenario: Scenario) -> Capabilities:
    return stack_of(generation).capabilities(scenario.apad.docks)


def open_apad(
    scenario: Scenario,
    options: RunOptions,
    gate: Gate,
    docked: Mapping[int, int],
    now_ms: int,
    truths_at: TruthsAt,
) -> OpenedAPad:
    """Opens the link of the scenario's generation, or of the one on the graph. VehicleNotReady for none or several.

    `truths_at` is the world's: docks and the virtual camera read it, and no mission does.
    """
    ours, generation = options.apad is APadKind.SIM, scenario.apad.generation
    if generation is Generation.AUTO and not ours:
        generation = live_generation(scenario.apad.name, READY_S)

    def sight(at_ms: int) -> Mapping[int, tuple[float, float]]:
        return {
            it.agent_id: (it.north_m, it.east_m)
            for it in truths_at(MissionMs(at_ms))
            if it.depth_m < _AFLOAT_M and not it.docked
        }

    if scenario.apad.docks > LIMITS[generation].docks:
        raise VehicleNotReady(
            f"{scenario.apad.name} is of generation {generation.name}, which can name {LIMITS[generation].docks} docks, "
            f"and apad.docks is {scenario.apad.docks}: lower it"
        )
    open_link: OpenLink = part_of(stack_of(generation).generation, "ros.link", "open_link")
    return open_link(scenario, gate, sight, docked, now_ms, our_clock=ours)
