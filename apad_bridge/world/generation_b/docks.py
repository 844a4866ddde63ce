"""Dock occupancy of a generation B aPad. The stack reports none, so the bench keeps it.

The bench holds a simulated aMussel at its dock, beside the aPad, and carries it along. It only notes a real
aMussel.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from apad_bridge.scenario.choices import PAPER_DOCKS
from apad_bridge.scenario.lab_interface.lab_messages import DockReport
from apad_bridge.vehicle.commands import CloseDock, CommandFailed, DockOpened, OpenDock, PoseReported
from apad_bridge.vehicle.generation_b.stack import dock_places
from apad_bridge.vehicle.vehicle_link import Carried, LetGo, LinkFact
from apad_bridge.world.apad.dock_mechanisms import MISSED, Docks, Misses
from apad_bridge.world.contacts import FloatingPlaces, why_out_of_reach

REACH_M = 1.5
"""A docking that names no aMussel catches none beyond this distance."""


class BenchDocks:
    """`misses` decides which dockings fail, `sight` gives the places of floating simulated aMussels.

    `docked` are the agents by dock index that are known to be held already, as after a resume.
    """

    def __init__(
        self,
        simulated_ids: Iterable[int],
        misses: Misses,
        sight: FloatingPlaces = lambda now_ms: {},
        docked: Mapping[int, int] = MappingProxyType({}),
        dock_count: int = PAPER_DOCKS,
    ) -> None:
        self._places = places = dock_places(dock_count)
        self._simulated = sorted(simulated_ids)
        self._docks = Docks(places.count)
        self.dropped: Counter[str] = Counter()
        self._misses = misses
        self._sight = sight
        for dock_index, agent_id in docked.items():
            self._docks.close(CloseDock(0, dock_index, agent_id), 0)

    def serve(self, simulated_ids: Iterable[int]) -> None:
        """From now on these aMussels are simulated, whichever fleet they belong to."""
        self._simulated = sorted(simulated_ids)

    @property
    def held(self) -> Mapping[int, int]:
        """Agents by dock index; a live view."""
        return self._docks.docked

    def holds(self, agent_id: int) -> bool:
        return agent_id in self._docks.docked.values()

    def refusal(self, command: CloseDock) -> str | None:
        return self._docks.refusal(command)

    def is_out_of_reach(self, command: CloseDock, pose: PoseReported | None, now_ms: int) -> bool:
        """A simulated aMussel is known to float elsewhere than at the closed dock."""
        there_m = self._sight(now_ms).get(command.agent_id)
        return (
            there_m is not None
            and pose is not None
            and math.dist(self._place_m(command.dock_index, pose), there_m) > REACH_M
        )

    def close(self, command: CloseDock, pose: PoseReported | None, now_ms: int) -> list[LinkFact]:
        """Makes the contact, or fails as `misses`, the distance or the docks require."""
        refusal_reason = self._docks.refusal(command)
        is_simulated = command.agent_id in self._simulated
        if refusal_reason is None and is_simulated:
            refusal_reason = why_out_of_reach(self._sight, command.agent_id, pose, now_ms)
        place_m = (0.0, 0.0) if pose is None else (pose.north_m, pose.east_m)
        if refusal_reason is None and is_simulated and self._misses.misses(command.agent_id, place_m, now_ms):
            refusal_reason = MISSED
        if refusal_reason is not None:
            return [CommandFailed(now_ms, command.command_id, refusal_reason)]
        facts: list[LinkFact] = [self._docks.close(command, now_ms)]
        if is_simulated and pose is not None:
            facts.append(self._carried(command.dock_index, command.agent_id, pose, now_ms))
        return facts

    def open(self, command: OpenDock, now_ms: int) -> list[LinkFact]:
        fact = self._docks.open(command, now_ms)
        if isinstance(fact, DockOpened) and command.agent_id in self._simulated:
            return [fact, LetGo(now_ms, command.agent_id)]
        return [fact]

    def apply_report(self, report: DockReport, pose: PoseReported | None) -> list[LinkFact]:
        """Applies a report that others docked or undocked an aMussel, found by its id or else by place and dock."""
        agent_id = report.agent_id
        dock_index = report.dock_index if report.dock_index in self._places.indices else None
        if not report.closed:
            if agent_id is None and dock_index is not None:
                agent_id = self.held.get(dock_index)
            found = next((it for it, holder in self.held.items() if holder == agent_id), None)
            if agent_id is None or found is None:
                self.dropped["a release by others: of nothing that is held"] += 1
                return []
            return self.open(OpenDock(0, found, agent_id), report.at_ms)
        if agent_id is None and pose is not None:
            agent_id = self._caught(dock_index, pose, report.at_ms)
        if agent_id is None:
            self.dropped["a docking by others: no simulated aMussel was near"] += 1
            return []
        if self.holds(agent_id):
            return []
        if dock_index is None or dock_index in self.held:
            dock_index = next((it for it in self._places.indices if it not in self.held), None)
        if dock_index is None:
            self.dropped["a docking by others: all docks are taken"] += 1
            return []
        closed: list[LinkFact] = [self._docks.close(CloseDock(0, dock_index, agent_id), report.at_ms)]
        if agent_id in self._simulated and pose is not None:
            closed.append(self._carried(dock_index, agent_id, pose, report.at_ms))
        return closed

    def _caught(self, dock_index: int | None, pose: PoseReported, now_ms: int) -> int | None:
        """The free simulated aMussel nearest to the closed dock, if one is within reach."""
        place_m = (pose.north_m, pose.east_m) if dock_index is None else self._place_m(dock_index, pose)
        near = [
            (math.dist(place_m, there_m), agent_id)
            for agent_id, there_m in self._sight(now_ms).items()
            if agent_id in self._simulated and not self.holds(agent_id)
        ]
        distance_m, agent_id = min(near, default=(math.inf, 0))
        return agent_id if distance_m <= REACH_M else None

    def places(self, pose: PoseReported | None, now_ms: int) -> list[LinkFact]:
        if pose is None:
            return []
        held = sorted(self._docks.docked.items())
        return [
            self._carried(dock_index, agent_id, pose, now_ms)
            for dock_index, agent_id in held
            if agent_id in self._simulated
        ]

    def _carried(self, dock_index: int, agent_id: int, pose: PoseReported, now_ms: int) -> Carried:
        return Carried(now_ms, agent_id, *self._place_m(dock_index, pose))

    def _place_m(self, dock_index: int, pose: PoseReported) -> tuple[float, float]:
        return self._places.place_m(dock_index, pose.north_m, pose.east_m, pose.heading_rad)
