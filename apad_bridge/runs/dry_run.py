"""Makes the first plan of a mission, and commands neither the vehicle nor an aMussel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from agents.hosting.in_process import InProcessHost
from apad_bridge.assembly import parts
from apad_bridge.assembly.water import fleet_of
from apad_bridge.records.event_kinds import EventKind
from apad_bridge.runs.in_memory import MemoryRecorder
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.core import TICK_MS
from apad_bridge.supervisor.loop import Flight
from apad_bridge.vehicle.commands import VehicleCommand
from apad_bridge.vehicle.link import InProcessVehicle, VehicleLink


class _UncommandedVehicle:
    """A vehicle that reports its state and is never commanded."""

    def __init__(self, vehicle: VehicleLink) -> None:
        self.advance = vehicle.advance
        self.close = vehicle.close

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        pass


def without_commands(context: FlightContext) -> FlightContext:
    """The same context, but neither the vehicle nor a real aMussel is commanded."""
    relay = None if context.relay is None else context.relay.without_outlets()
    return replace(context, vehicle=_UncommandedVehicle(context.vehicle), relay=relay)


def first_plan(scenario: Scenario, starts: Sequence[Start]) -> dict[str, Any] | None:
    """The journal's `plan` event of the first plan, with its time `t` in mission milliseconds; None if there is no plan."""
    initial_states = parts.initial_states(scenario, starts)
    fleet = fleet_of(
        scenario,
        InProcessHost(parts.fleet_config(scenario), initial_states),
        dict.fromkeys(initial_states, 0),
    )
    vehicle = _UncommandedVehicle(InProcessVehicle(parts.simulated_apad(scenario)))
    recorder = _FirstPlanRecorder(scenario)
    flight = Flight(parts.supervisor(scenario), FlightContext(vehicle, AsFastAsPossible(), fleet), recorder)
    while recorder.plan is None and not flight.supervisor.has_ended:
        flight.tick(flight.now_ms)
        flight.now_ms += TICK_MS
    return recorder.plan


class _FirstPlanRecorder(MemoryRecorder):
    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.plan: dict[str, Any] | None = None

    def event(self, at_ms: int, kind: str, **data: Any) -> None:
        if kind == EventKind.PLAN and self.plan is None:
            self.plan = {"t": at_ms, **data}
