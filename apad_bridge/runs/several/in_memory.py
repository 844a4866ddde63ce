"""Opens the flights of one aPad, or of several, in virtual time and in this process, without files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from apad_bridge.assembly.division import Member
from apad_bridge.assembly.fleet_parts import shared_sea
from apad_bridge.planning.registry import Trust
from apad_bridge.records.summary import uptime_figures
from apad_bridge.runs.in_memory import MemoryRecorder, mission_figures, open_flight
from apad_bridge.runs.several.assignment import Assignment
from apad_bridge.runs.several.lockstep import Exchange, LockstepRunner, MemberFlight
from apad_bridge.scenario.another_apad import Sharing
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.context import FlightContext


@dataclass(frozen=True, slots=True)
class OpenedLockstep:
    """A runner that is ready to `run`, and each aPad's recorder."""

    runner: LockstepRunner
    assignment: Assignment
    recorders: dict[str, MemoryRecorder]
    flights: dict[str, MemberFlight]

    def figures(self) -> dict[str, dict[str, Any]]:
        """The figures of `uptime_figures` and of the mission, by aPad."""
        figures_of = {}
        for name, it in self.flights.items():
            state = it.flight.supervisor.mission.state
            recorder = self.recorders[name]
            figures = uptime_figures(recorder.meter, it.flight.now_ms, battery_min=recorder.battery_min)
            figures_of[name] = {**figures, **mission_figures(state)}
        return figures_of


def open_lockstep(
    members: Sequence[Member],
    sharing: Sharing,
    recorder_of: Callable[[Scenario], MemoryRecorder] = MemoryRecorder,
    trust: Trust | None = None,
) -> OpenedLockstep:
    """Opens the flights of several aPads that reach each other, or the one flight of a single aPad."""
    served = {member.name: member.scenario.fleet.ids for member in members}
    exchange, assignment = Exchange(served), Assignment(served)
    recorders, flights = {}, {}
    is_alone, sea = len(members) == 1, shared_sea(members[0].scenario, len(members))
    for member in members:
        join = partial(exchange.join, member.name, sharing)
        flight, recorders[member.name] = open_flight(
            member.scenario,
            join=_unchanged if is_alone else join,
            recorder_of=recorder_of,
            sea=sea,
            trust=trust,
        )
        flights[member.name] = MemberFlight(member.scenario.apad.start_m, flight, recorders[member.name])
    runner = LockstepRunner(flights, exchange, assignment if sharing.transfers and not is_alone else None)
    return OpenedLockstep(runner, assignment, recorders, flights)


def _unchanged(context: FlightContext) -> FlightContext:
    return context
