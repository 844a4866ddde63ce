"""A run's state by its events: one fold, of which the page, the report, consoles and a resumed supervisor are views."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

from agents.mussel.outputs import Truth
from agents.time_scale import MissionMs
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import (
    BeliefChanged,
    CapacityLearned,
    FaultBegan,
    FaultEnded,
    HandedOn,
    PresenceChanged,
    ProcessDied,
    TookOn,
    TruthChanged,
)
from apad_bridge.events.guard_events import Drifting, StopChanged, StopEnded, StopKind, StopState
from apad_bridge.events.mission_events import (
    PRE_EMPTED,
    AMusselReleased,
    DockSwitched,
    MissionChanged,
    MissionState,
    PlanMade,
    PrimitiveChanged,
    PrimitivePhase,
)
from apad_bridge.events.person_events import Overridden, Steering
from apad_bridge.events.run_events import RunEnded
from apad_bridge.events.vehicle_events import APadMoved
from apad_bridge.mission.facts import SampleSource
from apad_bridge.records.failure_counts import FailureCounts, Interruptions
from apad_bridge.records.journal import Entry, JournalContents
from apad_bridge.records.truth_lines import truth_of
from apad_bridge.records.uptime import UptimeMeter
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.commands import PRIMITIVE_NAMES, Hold
from apad_bridge.vehicle.guards.stops import NO_STOPS, StopRecord
from apad_bridge.vehicle.outcomes import PrimitiveFailed, after_report
from apad_bridge.world.roster import PresenceChange

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


class RunState:
    """The state of one aPad's run after the events that it was given, in the journal's order."""

    def __init__(self, scenario: Scenario) -> None:
        self._scale = scenario.time_scale
        self.meter = UptimeMeter.for_scenario(scenario)
        self.counts: Counter[type[Event]] = Counter()
        """The number of events of each kind."""
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
        self.last_ms = MissionMs(0)
        """The newest mission time of an event."""
        self.phase = ""
        """The mission's; empty before it began."""
        self.mission = MissionState()
        """The newest state in the journal, with the docks that closed or opened since."""
        self.battery_at_start: float | None = None
        """The charge of the aPad's battery when it was first heard."""
        self.first_failure: PrimitiveFailed | None = None
        """The failure that the docking port has latched. The journal does not keep the primitive's id: it is 0."""
        self.steering = Steering.PERSON
        """The party that took the aPad from the mission last."""
        self.faults: list[tuple[MissionMs, FaultBegan]] = []
        """The faults that have begun and not ended, in the order in which they began."""
        self.presences: dict[int, PresenceChange] = {}
        """The newest change of each aMussel to real, retired or simulated."""
        self.boards: dict[int, SampleSource] = {}
        """The board that each of these aMussels uploads from."""
        self.handovers: list[TookOn | HandedOn] = []
        """The aMussels that came from other aPads, or went to them, in order."""
        self.primitive = ""
        self.plan: PlanView | None = None
        self.stops = NO_STOPS
        self.refused_stop: StopRecord | None = None
        """A stop that was refused since, so that it changed nothing."""
        self.drift: Entry | None = None
        """The newest drift, while the thrusters are off."""
        self.ended_by: str | None = None

    @classmethod
    def of(cls, scenario: Scenario, journal: JournalContents) -> RunState:
        """The state after all events of a journal."""
        state = cls(scenario)
        for at_ms, event in journal.entries:
            state.apply(at_ms, event)
        return state

    def apply(self, at_ms: MissionMs, event: Event) -> None:
        """Takes the next event. ValueError, of truths of one aMussel whose time goes back."""
        self.last_ms = max(self.last_ms, at_ms)
        self.counts[type(event)] += 1
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
                self.presences[event.id] = PresenceChange(at_ms, event.id, event.is_, event.by)
                self.boards[event.id] = SampleSource.after(event, at_ms)
                self.meter.set_presence(event.id, event.is_, self._scale.agent_ms(at_ms))
            case APadMoved():
                self.apad = event
                if self.battery_at_start is None:
                    self.battery_at_start = event.battery
                self.docks = tuple(None if it < 0 else it for it in event.docks)
            case MissionChanged():
                self._take_mission(event)
            case PlanMade():
                self._take_plan(event)
            case PrimitiveChanged():
                self._take_primitive(at_ms, event)
            case DockSwitched():
                docked = after_report(self.mission.docked, event.dock, event.agent, closed=event.closed)
                self.mission = replace(self.mission, docked=docked)
            case AMusselReleased(full=True):
                self.services[event.agent] += 1
            case StopChanged() | StopEnded():
                self._take_stop(at_ms, event)
            case Drifting() if self.stops.in_force is not None:
                self.drift = Entry(at_ms, event)
            case Overridden(taken=True, by=Steering() as party):
                self.steering = party
            case FaultBegan(refused=None, until_ms=int() as until_ms) if until_ms > at_ms:
                self.faults.append((at_ms, event))
            case FaultEnded():
                self.faults = [it for it in self.faults if not _is_over(it[1], event, at_ms)]
            case TookOn() | HandedOn():
                self.handovers.append(event)
            case RunEnded():
                self.ended_by = event.reason

    def take_truth(self, truth: Truth) -> None:
        """Takes the next truth of its aMussel, as its event would; ValueError when time goes back."""
        self.meter.take(truth)
        self.truths[truth.agent_id] = truth

    def _take_mission(self, changed: MissionChanged) -> None:
        self.phase, self.mission = changed.phase, changed.snapshot
        if self.plan is not None:
            kind = _STEP_OF.get(self.plan.what)
            self.plan.left = sum(step.kind == kind for step in changed.snapshot.plan)

    def _take_plan(self, plan: PlanMade) -> None:
        steps = tuple((step["agent"], step["dock"]) for step in plan.steps)
        homes = {agent_id: (north_m, east_m) for agent_id, north_m, east_m in self.mission.homes}
        places_m = () if plan.what == "collect" else tuple(homes.get(agent_id) for agent_id, _ in steps)
        self.plan = PlanView(plan.what, plan.strategy, steps, len(steps), places_m)

    def _take_stop(self, at_ms: MissionMs, event: StopChanged | StopEnded) -> None:
        self.stops = self.stops.after(at_ms, event)
        is_refused = isinstance(event, StopChanged) and event.state is StopState.REFUSED
        self.refused_stop = self.stops.newest if is_refused else None
        if self.stops.in_force is None or self.stops.in_force.kind is StopKind.HOLD:
            self.drift = None

    def _take_primitive(self, at_ms: MissionMs, event: PrimitiveChanged) -> None:
        if event.phase is PrimitivePhase.SUCCEEDED and event.name != PRIMITIVE_NAMES[Hold]:
            self.first_failure = None
        elif event.phase is PrimitivePhase.FAILED and event.reason != PRE_EMPTED:
            self.first_failure = self.first_failure or PrimitiveFailed(at_ms, 0, event.reason or "")
        text = _primitive_text(event)
        if event.phase is PrimitivePhase.STARTED:
            self.primitive = text
        elif text == self.primitive:  # not if another has replaced it, as a go-to replaces holding
            self.primitive = ""


def _is_over(fault: FaultBegan, ended: FaultEnded, at_ms: int) -> bool:
    is_same = (fault.fault, fault.id) == (ended.fault, ended.id)
    return is_same and fault.until_ms is not None and fault.until_ms <= at_ms


def _primitive_text(event: PrimitiveChanged) -> str:
    if event.agent is not None and event.dock is not None:
        return f"{event.name} aMussel {event.agent}, dock {event.dock + 1}"
    if event.north_m is not None and event.east_m is not None:
        return f"{event.name} {event.north_m:.1f} m north, {event.east_m:.1f} m east"
    return event.name
