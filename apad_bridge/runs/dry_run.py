"""Makes the first plan of a mission, and commands neither the vehicle nor an aMussel."""

from __future__ import annotations

from dataclasses import replace

from agents.time_scale import MissionMs
from apad_bridge.events.mission_events import PlanMade
from apad_bridge.planning.registry import Trust
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.vehicle.commands import VehicleCommand
from apad_bridge.vehicle.vehicle_link import Cleared, VehicleLink


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


def first_plan(scenario: Scenario, trust: Trust | None = None) -> tuple[MissionMs, PlanMade] | None:
    """The first plan and its mission time; None if there is no plan.

    Strategies in files are executed with `trust` alone.
    """
    flight, recorder = open_flight(scenario, join=without_commands, trust=trust)
    plan: tuple[MissionMs, PlanMade] | None = None
    while plan is None and not flight.supervisor.has_ended:
        flight.step()
        plan = next(recorder.journal.events(PlanMade), None)
        recorder.journal.entries.clear()
    return plan
