"""Replays a run's journal forward once, and gives the run's state at each mission time on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from agents.mussel.outputs import Truth
from agents.time_scale import TimeScale
from agents.water.medium import PacketOutcome
from apad_bridge.events.event import Category
from apad_bridge.events.fleet import (
    AMusselSuspected,
    BeliefChanged,
    CapacityLearned,
    Presence,
    PresenceChanged,
    ProcessDied,
    TruthChanged,
)
from apad_bridge.events.guards import Drifting, StopChanged, StopEnded
from apad_bridge.events.mission import MissionChanged, PlanMade, PrimitiveChanged
from apad_bridge.events.persons import PersonOrdered
from apad_bridge.events.run import RunEnded
from apad_bridge.events.sound import PacketPassed, RangeMeasured
from apad_bridge.events.union import told_event
from apad_bridge.events.vehicle import APadMoved
from apad_bridge.records.journal import JournalContents, Line
from apad_bridge.records.summary import Interruptions
from apad_bridge.records.truth_lines import truth_of
from apad_bridge.records.uptime import UptimeMeter
from firmware_model.power.charge import ChargeModel

_STEP_OF = {"collect": "collect", "redeploy": "deploy"}
"""The kind of a plan's steps in the mission's state, by what the plan is for."""
_TOO_FAR = frozenset(it.name.lower() for it in (PacketOutcome.NOISE, PacketOutcome.OUT_OF_RANGE))


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
    """A stop: who ordered it, which of the two it is, and the mission times of the states that it came to.

    `number` is None in a journal of before stops had numbers.
    """

    number: int | None
    mode: str
    by: str
    states: tuple[tuple[str, int], ...]
    reason: str | None


@dataclass(slots=True)
class RunState:
    """The run's state at the time to which the history was last advanced."""

    truths: dict[int, Truth] = field(default_factory=dict)
    beliefs: dict[int, Line] = field(default_factory=dict)
    capacities: dict[int, tuple[float, float]] = field(default_factory=dict)
    """The interval of what is believed to be left of each aMussel's capacity."""
    gone: set[int] = field(default_factory=set)
    apad: Line | None = None
    docks: tuple[int | None, ...] = ()
    cost_m: float = 0.0
    phase: str = ""
    primitive: str = ""
    plan: PlanView | None = None
    homes_m: dict[int, tuple[float, float]] = field(default_factory=dict)
    stop: StopView | None = None
    """The newest stop that nobody's `continue` has ended."""
    refused_stop: StopView | None = None
    """A stop that was refused since, so that it changed nothing."""
    drift: Line | None = None
    """The newest drift, while the thrusters are off."""


class PacketView(NamedTuple):
    """An acoustic packet: when it began in mission time, how long it was sent in agent time, and what became of it.

    `heard` has (listener, outcome) for each listener that the sound reached; `far` counts those for which it was too weak
    and those beyond its range. `timeslot` is the one in which it began, None without timeslots.
    """

    at_ms: int
    lasted_ms: int
    sender: int
    what: str
    address: int | None
    unsent: str | None
    heard: tuple[tuple[int, str], ...]
    far: int
    timeslot: int | None


class SuspectView(NamedTuple):
    """An aMussel whose packets contradict physics: the mission time from which it is suspect, and the reason."""

    at_ms: int
    agent: int
    reason: str


class ToldEvent(NamedTuple):
    """An event for a person: its mission time, its category, a text, and the aMussel that it is about."""

    at_ms: int
    category: Category
    text: str
    agent: int | None


class History:
    """A run's history. `advance` takes all lines up to a mission time; `now` and `meter` are then as of that time."""

    def __init__(
        self,
        journal: JournalContents,
        scale: TimeScale,
        charge_of: Callable[[int], ChargeModel],
        dock_count: int,
        *,
        secondary_in_use: bool = False,
    ) -> None:
        self._lines: list[Line] = []
        self._next = 0
        self.end_ms = 0
        """The newest mission time of a line."""
        self.trace: list[tuple[int, float, float]] = []
        """The aPad's track as (mission ms, north, east), one for each line of it that was taken."""
        self.events: list[ToldEvent] = []
        """The events that a person may look for, among the lines that were taken."""
        self.plans: list[Line] = []
        """The lines of all plans that were taken, with the reasons that they state."""
        self.packets: list[PacketView] = []
        """The acoustic packets among the lines that were taken."""
        self.suspects: list[SuspectView] = []
        """The aMussels that became suspect, among the lines that were taken. A suspicion lasts until the run ends."""
        self._pinged: set[int] = set()
        """The aMussels that a person pinged and that have not answered yet."""
        self.ended_by: str | None = None
        self.add(journal)
        self._stops: list[StopView] = []
        """The stops that nobody's `continue` has ended, by their numbers."""
        self.now = RunState(docks=(None,) * dock_count)
        self.interruptions = Interruptions()
        self._scale = scale
        self.meter = UptimeMeter(scale, charge_of, secondary_in_use=secondary_in_use)
        self._handlers: dict[str, Callable[[Line], None]] = {
            TruthChanged.kind: self._take_truth,
            BeliefChanged.kind: self._take_belief,
            CapacityLearned.kind: self._take_capacity,
            AMusselSuspected.kind: self._take_suspect,
            ProcessDied.kind: self._take_death,
            PresenceChanged.kind: self._take_presence,
            APadMoved.kind: self._take_apad,
            MissionChanged.kind: self._take_mission,
            PlanMade.kind: self._take_plan,
            PacketPassed.kind: self._take_packet,
            PrimitiveChanged.kind: self._take_primitive,
            PersonOrdered.kind: self._take_operator,
            StopChanged.kind: self._take_stop,
            StopEnded.kind: self._take_continued,
            Drifting.kind: self._take_drift,
            RunEnded.kind: self._take_end,
        }

    def add(self, journal: JournalContents) -> None:
        """Adds further lines of the journal. One from before the time of the last `advance` is taken by the next."""
        # Sorted by time; lines of the same time stay in the order in which they became known.
        self._lines = sorted([*self._lines[self._next :], *journal.lines], key=lambda line: line["t"])
        self._next = 0
        self.end_ms = max(self.end_ms, journal.last_ms)

    def has_lines_until(self, at_ms: int) -> bool:
        """True when `advance` to this time would take a line."""
        return self._next < len(self._lines) and self._lines[self._next]["t"] <= at_ms

    def advance(self, now_ms: int) -> None:
        """Takes all lines up to a mission time."""
        while self.has_lines_until(now_ms):
            line = self._lines[self._next]
            self._next += 1
            self.interruptions.take(line["t"], line["kind"], line)
            handler = self._handlers.get(line["kind"])
            if handler is not None:
                handler(line)
            told = told_event(line)
            text = told.text() if told is not None else self._ping_text(line)
            if text is not None:
                category = Category.NEWS if told is None else told.category
                self.events.append(ToldEvent(line["t"], category, text, line.get("agent", line.get("id"))))

    def _ping_text(self, line: Line) -> str | None:
        """The answer to a person's ping; the aPad's own pings are routine."""
        if line["kind"] == PersonOrdered.kind and line["order"] == "ping":
            self._pinged.add(line["agent"])
        if line["kind"] != RangeMeasured.kind or line["id"] not in self._pinged:
            return None
        self._pinged.remove(line["id"])
        range_m = line["range_m"]
        return f"aMussel {line['id']} " + (
            "did not answer the ping" if range_m is None else f"is {range_m:.2f} m away"
        )

    def _take_truth(self, line: Line) -> None:
        truth = truth_of(line)
        self.meter.take(truth)
        self.now.truths[truth.agent_id] = truth

    def _take_belief(self, line: Line) -> None:
        self.now.beliefs[line["id"]] = line

    def _take_capacity(self, line: Line) -> None:
        self.now.capacities[line["id"]] = (line["low"], line["high"])

    def _take_suspect(self, line: Line) -> None:
        self.suspects.append(SuspectView(line["t"], line["id"], line["reason"]))

    def _take_death(self, line: Line) -> None:
        if line["gave_up"] is not None:
            self.now.gone.add(line["id"])
            self.meter.ended(line["id"], line["agent_ms"])

    def _take_presence(self, line: Line) -> None:
        self.meter.set_presence(line["id"], Presence(line["is"]), self._scale.agent_ms(line["t"]))

    def _take_apad(self, line: Line) -> None:
        self.now.apad = line
        self.trace.append((line["t"], line["north_m"], line["east_m"]))
        self.now.docks = tuple(None if agent_id < 0 else agent_id for agent_id in line["docks"])

    def _take_mission(self, line: Line) -> None:
        self.now.phase = line["phase"]
        self.now.cost_m = line["snapshot"]["cost_m"]
        self.now.homes_m = {
            agent_id: (north, east) for agent_id, north, east in line["snapshot"].get("homes", ())
        }
        if self.now.plan is not None:
            kind = _STEP_OF.get(self.now.plan.what)
            self.now.plan.left = sum(step[0] == kind for step in line["snapshot"]["plan"])

    def _take_plan(self, line: Line) -> None:
        steps = tuple((step["agent"], step["dock"]) for step in line["steps"])
        is_collection = line["what"] == "collect"
        places_m = () if is_collection else tuple(self.now.homes_m.get(agent_id) for agent_id, _ in steps)
        self.now.plan = PlanView(line["what"], line["strategy"], steps, len(steps), places_m)
        self.plans.append(line)

    def _take_packet(self, line: Line) -> None:
        heard = [(listener, outcome) for listener, outcome, *_ in line["heard"]]
        near = tuple((listener, outcome) for listener, outcome in heard if outcome not in _TOO_FAR)
        self.packets.append(
            PacketView(
                self._scale.mission_span(line["began_ms"]),
                line["lasted_ms"],
                line["from"],
                line["what"],
                line["address"],
                line["unsent"],
                near,
                len(heard) - len(near),
                line["timeslot"],
            )
        )

    def _take_stop(self, line: Line) -> None:
        now, number = self.now, line["number"]
        before = next((it for it in self._stops if it.number == number), None)
        stop = StopView(
            number,
            line["mode"],
            line["by"],
            (*(before.states if before else ()), (line["state"], line["t"])),
            line.get("reason") or (before.reason if before else None),
        )
        self._stops = [it for it in self._stops if it.number is not None and it.number != number]
        if line["state"] == "refused":
            now.refused_stop = stop
        else:
            now.refused_stop = None
            self._stops = sorted([*self._stops, stop], key=lambda it: it.number or 0)
        self._set_stop()

    def _take_continued(self, line: Line) -> None:
        self.now.refused_stop = None
        self._stops = [it for it in self._stops if (it.number or 0) > line["number"]]
        self._set_stop()

    def _set_stop(self) -> None:
        self.now.stop = self._stops[-1] if self._stops else None
        if self.now.stop is None or self.now.stop.mode == "hold":
            self.now.drift = None

    def _take_operator(self, line: Line) -> None:
        """A stop of before stops had numbers, whose only record is the person's order."""
        stop = self.now.stop
        if stop is not None and stop.number is not None:
            return
        if line["order"] == "stop":
            self._stops = [StopView(None, "hold", line["by"], (("ordered", line["t"]),), None)]
        elif line["order"] == "continue":
            self._stops = []
        self._set_stop()

    def _take_drift(self, line: Line) -> None:
        if self.now.stop is not None:
            self.now.drift = line

    def _take_end(self, line: Line) -> None:
        self.ended_by = line["reason"]

    def _take_primitive(self, line: Line) -> None:
        text = _primitive_text(line)
        if line["phase"] == "started":
            self.now.primitive = text
        elif (
            text == self.now.primitive
        ):  # not if another primitive has replaced it, as a go-to replaces holding
            self.now.primitive = ""


def _primitive_text(line: Line) -> str:
    name: str = line["name"]
    agent: Any = line.get("agent")
    if agent is not None:
        return f"{name} aMussel {agent}, dock {line['dock'] + 1}"
    if "north_m" in line:
        return f"{name} {line['north_m']:.1f} m north, {line['east_m']:.1f} m east"
    return name
