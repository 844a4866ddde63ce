"""The two models of a study's missions: event-driven, or the whole mission tick by tick."""

from __future__ import annotations

from enum import StrEnum

from agents.mussel.outputs import Truth
from apad_bridge.events.run_events import EndReason
from apad_bridge.mission.policy.plan_checks import StrategyFailed
from apad_bridge.planning.registry import Trust
from apad_bridge.runs.in_memory import MemoryRecorder, open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.studies.event_driven import fly_event_driven
from apad_bridge.studies.mission_figures import FigureMeter, Figures
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.world.apad.in_process import InProcessVehicle


class Model(StrEnum):
    """`event-driven`: the ticks between events are skipped. `mission`: every tick is flown, for any scenario."""

    EVENT_DRIVEN = "event-driven"
    MISSION = "mission"


def fly(scenario: Scenario, model: Model, trust: Trust | None = None) -> Figures:
    """Flies the scenario's mission; StrategyFailed when its strategy ended it. ValueError for a string that is no model.

    Strategies in files are executed with `trust` alone.
    """
    fly_it = fly_event_driven if Model(model) is Model.EVENT_DRIVEN else fly_each_tick
    figures = fly_it(scenario, trust)
    if figures.end_reason is EndReason.STRATEGY_FAILED:
        raise StrategyFailed(figures.ended_by)
    return figures


class _FigureRecorder(MemoryRecorder):
    def __init__(self, scenario: Scenario, meter: FigureMeter) -> None:
        super().__init__(scenario)
        self._figures = meter

    def truths(self, truths: list[Truth]) -> None:
        super().truths(truths)
        for truth in truths:
            self._figures.take(truth)


def fly_each_tick(scenario: Scenario, trust: Trust | None = None) -> Figures:
    """Flies the mission of `musselbed run --time asap`, with the aMussels in this process."""
    meter = FigureMeter(scenario)
    vehicles: list[InProcessVehicle] = []

    def keep_vehicle(context: FlightContext) -> FlightContext:
        assert isinstance(context.vehicle, InProcessVehicle)
        vehicles.append(context.vehicle)
        return context

    flight, _ = open_flight(
        scenario, join=keep_vehicle, recorder_of=lambda it: _FigureRecorder(it, meter), trust=trust
    )
    flight.run()
    return meter.figures(flight.now_ms, flight.supervisor.mission.state, vehicles[0].apad.battery.ledger)
