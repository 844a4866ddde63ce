"""The link to the aPad of a scenario, of whichever generation, and what shows it simulated aMussels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import rosgraph

from apad_bridge.assembly import parts
from apad_bridge.doctor.graph import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.records.samples import TruthSample
from apad_bridge.ros.links.generation_a import GenerationALink
from apad_bridge.ros.links.generation_b import GenerationBLink
from apad_bridge.ros.links.generations import live_generation, offered_generations
from apad_bridge.ros.links.virtual_camera import VirtualCamera
from apad_bridge.scenario.run_options import APadKind, RunOptions
from apad_bridge.scenario.schema import DockingProfile, Generation, Scenario

READY_S = 15.0
_AFLOAT_M = 0.1
"""A body less deep than this floats."""
APadLink = GenerationALink | GenerationBLink
TruthsAt = Callable[[int], list[TruthSample]]


def is_of_generation_b(scenario: Scenario) -> bool:
    """Whether the aPad is met as one of generation B: by the scenario, else by what is on the graph at this moment."""
    generation = scenario.apad.generation
    if generation is not Generation.AUTO:
        return generation is Generation.B
    try:
        offered = offered_generations(Graph.read(rosgraph.get_master_uri()), scenario.apad.name)
    except Unreachable:
        return False
    return offered == {Generation.B}


@dataclass(frozen=True, slots=True)
class OpenedAPad:
    link: APadLink
    watch: Callable[[int], None] | None = None
    """To be called after each tick with the mission time: shows the camera who floats."""


def open_apad(
    scenario: Scenario, options: RunOptions, docked: Mapping[int, int], now_ms: int, truths_at: TruthsAt
) -> OpenedAPad:
    """Of the scenario's generation, or of the one that is on the graph. VehicleNotReady when that is none, or both.

    `truths_at` is the world's: what a vehicle's docks and camera meet, and no mission.
    """
    ours, name = options.apad is APadKind.SIM, scenario.apad.name
    generation = scenario.apad.generation
    if generation is Generation.AUTO:
        generation = Generation.A if ours else live_generation(name, READY_S)
    battery = scenario.apad.battery
    battery_v, ids = (battery.empty_v, battery.full_v), parts.agent_ids(scenario)

    def sight(at_ms: int) -> Mapping[int, tuple[float, float]]:
        return {
            it.agent_id: (it.north_m, it.east_m)
            for it in truths_at(at_ms)
            if it.depth_m < _AFLOAT_M and not it.docked
        }

    if generation is Generation.A:
        return OpenedAPad(
            GenerationALink(name, ids, battery_v, our_clock=ours, docked=docked, now_ms=now_ms, sight=sight)
        )

    docking = scenario.mission.docking
    simulated_ids = [it for it in ids if docking.profile_of(it) is not DockingProfile.VISUAL]
    seen_ids = [it for it in ids if docking.profile_of(it) is DockingProfile.CAMERA]
    camera = VirtualCamera(name) if seen_ids else None
    link = GenerationBLink(
        name,
        simulated_ids,
        battery_v,
        docking,
        parts.misses(scenario),
        our_clock=ours,
        sight=sight,
        camera=camera,
        docked=docked,
        now_ms=now_ms,
    )
    if camera is None:
        return OpenedAPad(link)
    shown = frozenset(seen_ids)

    def watch(at_ms: int) -> None:
        camera.show({agent_id: place_m for agent_id, place_m in sight(at_ms).items() if agent_id in shown})

    return OpenedAPad(link, watch)
