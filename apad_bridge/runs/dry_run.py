"""Makes the first plan of a mission, and commands neither the vehicle nor an aMussel."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from apad_bridge.events.mission import PlanMade
from apad_bridge.planning.registry import Trust
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.vehicle.commands import VehicleCommand
from apad_bridge.vehicle.link import Cleared, VehicleLink


class _UncommandedVehicle:
    """A vehicle that reports its state and is never commanded."""

    def __init__(self, vehicle: VehicleLink) -> None:
        self.advance = vehicle.advance
        self.close = vehicle.close

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        pass


def without_commands(context: FlightContext) -> FlightContext:
    """The same context, but neither the vehicle nor a real aMussel is commanded."""
    relay = context.relay.without_outlets()
    return replace(context, vehicle=_UncommandedVehicle(context.vehicle), relay=relay)


def first_plan(scenario: Scenario, trust: Trust | None = None) -> dict[str, Any] | None:
    """The journal's `plan` event of the first plan, with its time `t` in mission milliseconds; None if there is no plan.

    Strategies in files are executed with `trust` alone.
    """
    flight, recorder = open_flight(scenario, join=without_commands, trust=trust)
    plan: dict[str, Any] | None = None
    while plan is None and not flight.supervisor.has_ended:
        flight.step()
        events = recorder.events
        plan = next(({"t": at_ms, **data} for at_ms, kind, data in events if kind == PlanMade.kind), None)
        recorder.events.clear()
    return plan
