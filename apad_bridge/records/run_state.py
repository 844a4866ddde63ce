"""A run's state by its events: one fold, of which the page, the report, consoles and a resumed supervisor are views."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

from agents.mussel.outputs import Truth
from agents.time_scale import MissionMs
from apad_bridge.events.event import Event
from apad_bridge.events.fleet import (
    BeliefChanged,
    CapacityLearned,
    PresenceChanged,
    ProcessDied,
    TruthChanged,
)
from apad_bridge.events.guards import Drifting, StopChanged, StopEnded, StopKind, StopState
from apad_bridge.events.mission import (
    AMusselReleased,
    MissionChanged,
    PlanMade,
    PrimitiveChanged,
    PrimitivePhase,
)
from apad_bridge.events.run import RunEnded
from apad_bridge.events.vehicle import APadMoved
from apad_bridge.records.journal import Entry
from apad_bridge.records.summary import FailureCounts, Interruptions
from apad_bridge.records.truth_lines import truth_of
from apad_bridge.records.uptime import UptimeMeter
from apad_bridge.scenario.firmware_config import charge_models, works_on_secondary
from apad_bridge.scenario.schema import Scenario

_STEP_OF = {"collect": "collect", "redeploy": "deploy"}
"""The kind of a plan's steps in the mission's state, by what the plan is for."""


@dataclass(slots=True)
class PlanView:
    """The newest plan: its steps as (agent, dock), and the number of unfinished steps.

    `places_m` are the steps' places, (north, east), of a plan to redeploy; an aMussel's place in a collection is its own.
    """

    what: str
    strategy: str
    steps: tuple[tuple[int, int], ...]
    left: int
    places_m: tuple[tuple[float, float] | None, ...] = ()


class StopView(NamedTuple):
    """A stop: who ordered it, which of the two it is, and the mission times of the states that it came to."""

    number: int
    mode: StopKind
    by: str
    states: tuple[tuple[StopState, int], ...]
    reason: str | None


class RunState:
    """The state of one aPad's run after the events that it was given, in the journal's order."""

    def __init__(self, scenario: Scenario) -> None:
        self._scale = scenario.time_scale
        self.meter = UptimeMeter(
            self._scale, charge_models(scenario), secondary_in_use=works_on_secondary(scenario.board)
        )
        self.failures = FailureCounts()
        self.interruptions = Interruptions()
        self.services: Counter[int] = Counter()
        """The number of services of each aMussel."""
        self.truths: dict[int, Truth] = {}
        self.beliefs: dict[int, BeliefChanged] = {}
        self.capacities: dict[int, tuple[float, float]] = {}
        """The interval of what is believed to be left of each aMussel's capacity."""
        self.gone: set[int] = set()
        """The aMussels whose process stayed dead."""
        self.apad: APadMoved | None = None
        self.docks: tuple[int | None, ...] = (None,) * scenario.apad.docks
        self.mission: MissionChanged | None = None
        self.primitive = ""
        self.plan: PlanView | None = None
        self.stops: dict[int, StopView] = {}
        """The stops that nobody's `continue` has ended, by number."""
        self.refused_stop: StopView | None = None
        """A stop that was refused since, so that it changed nothing."""
        self.drift: Entry | None = None
        """The newest drift, while the thrusters are off."""
        self.ended_by: str | None = None

    @property
    def phase(self) -> str:
        return "" if self.mission is None else self.mission.phase

    @property
    def cost_m(self) -> float:
        return 0.0 if self.mission is None else self.mission.snapshot.cost_m

    @property
    def stop(self) -> StopView | None:
        """The newest stop in force."""
        return self.stops[max(self.stops)] if self.stops else None

    def apply(self, at_ms: MissionMs, event: Event) -> None:
        """Takes the next event. ValueError, of truths of one aMussel whose time goes back."""
        self.failures.take(at_ms, event)
        self.interruptions.take(at_ms, event)
        match event:
            case TruthChanged():
                self.take_truth(truth_of(event))
            case BeliefChanged():
                self.beliefs[event.id] = event
            case CapacityLearned():
                self.capacities[event.id] = (event.low, event.high)
            case ProcessDied(gave_up=str()):
                self.gone.add(event.id)
                self.meter.ended(event.id, event.agent_ms)
            case PresenceChanged():
                self.meter.set_presence(event.id, event.is_, self._scale.agent_ms(at_ms))
            case APadMoved():
                self.apad = event
                self.docks = tuple(None if it < 0 else it for it in event.docks)
            case MissionChanged():
                self._take_mission(event)
            case PlanMade():
                self._take_plan(event)
            case PrimitiveChanged():
                self._take_primitive(event)
            case AMusselReleased(full=True):
                self.services[event.agent] += 1
            case StopChanged():
                self._take_stop(at_ms, event)
            case StopEnded():
                self.refused_stop = None
                self.stops = {number: it for number, it in self.stops.items() if number > event.number}
                self._forget_drift()
            case Drifting() if self.stops:
                self.drift = Entry(at_ms, event)
            case RunEnded():
                self.ended_by = event.reason

    def take_truth(self, truth: Truth) -> None:
        """Takes the next truth of its aMussel, as its event would; ValueError when time goes back."""
        self.meter.take(truth)
        self.truths[truth.agent_id] = truth

    def _take_mission(self, changed: MissionChanged) -> None:
        self.mission = changed
        if self.plan is not None:
            kind = _STEP_OF.get(self.plan.what)
            self.plan.left = sum(step.kind == kind for step in changed.snapshot.plan)

    def _take_plan(self, plan: PlanMade) -> None:
        steps = tuple((step["agent"], step["dock"]) for step in plan.steps)
        rows = () if self.mission is None else self.mission.snapshot.homes
        homes = {agent_id: (north_m, east_m) for agent_id, north_m, east_m in rows}
        places_m = () if plan.what == "collect" else tuple(homes.get(agent_id) for agent_id, _ in steps)
        self.plan = PlanView(plan.what, plan.strategy, steps, len(steps), places_m)

    def _take_stop(self, at_ms: MissionMs, event: StopChanged) -> None:
        before = self.stops.get(event.number)
        stop = StopView(
            event.number,
            event.mode,
            event.by,
            (*(before.states if before else ()), (event.state, at_ms)),
            event.reason or (before.reason if before else None),
        )
        if event.state is StopState.REFUSED:
            self.refused_stop = stop
            self.stops.pop(event.number, None)
        else:
            self.refused_stop = None
            self.stops[event.number] = stop
        self._forget_drift()

    def _forget_drift(self) -> None:
        if self.stop is None or self.stop.mode is StopKind.HOLD:
            self.drift = None

    def _take_primitive(self, event: PrimitiveChanged) -> None:
        text = _primitive_text(event)
        if event.phase is PrimitivePhase.STARTED:
            self.primitive = text
        elif text == self.primitive:  # not if another has replaced it, as a go-to replaces holding
            self.primitive = ""


def _primitive_text(event: PrimitiveChanged) -> str:
    if event.agent is not None and event.dock is not None:
        return f"{event.name} aMussel {event.agent}, dock {event.dock + 1}"
    if event.north_m is not None and event.east_m is not None:
        return f"{event.name} {event.north_m:.1f} m north, {event.east_m:.1f} m east"
    return event.name
