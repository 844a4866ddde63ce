"""Replays a run's journal forward once, and gives the run's state at each mission time on the way."""

from __future__ import annotations

from typing import NamedTuple

from agents.time_scale import TimeScale
from agents.water.medium import PacketOutcome
from apad_bridge.events.event import Category
from apad_bridge.events.fleet_events import AMusselSuspected, SuspicionOver
from apad_bridge.events.mission_events import PlanMade
from apad_bridge.events.person_events import PersonOrdered
from apad_bridge.events.sound_events import PacketPassed, RangeMeasured
from apad_bridge.events.vehicle_events import APadMoved
from apad_bridge.records.journal import Entry, JournalContents
from apad_bridge.records.run_state import RunState
from apad_bridge.scenario.schema import Scenario

_TOO_FAR = frozenset(it.name.lower() for it in (PacketOutcome.NOISE, PacketOutcome.OUT_OF_RANGE))


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
    until_ms: int | None = None
    """None while it is suspect."""


class ShownEvent(NamedTuple):
    """An event for a person: its mission time, its category, a text, and the aMussel that it is about."""

    at_ms: int
    category: Category
    text: str
    agent: int | None


def shown_event(entry: Entry) -> ShownEvent | None:
    """None for an event of routine, which has no text."""
    at_ms, event = entry
    text = event.text()
    return None if text is None else ShownEvent(at_ms, event.category, text, event.amussel)


class History:
    """A run's history. `advance` takes all events up to a mission time; `now` is then as of that time.

    The lists have what a page shows of the events that were taken.
    """

    def __init__(self, journal: JournalContents, scenario: Scenario) -> None:
        self._entries: list[Entry] = []
        self._next = 0
        self.end_ms = 0
        """The newest mission time of an event."""
        self.now = RunState(scenario)
        self.trace: list[tuple[int, float, float]] = []
        """The aPad's track as (mission ms, north, east)."""
        self.events: list[ShownEvent] = []
        """The events that a person may look for."""
        self.plans: list[Entry] = []
        """All plans, with the reasons that they state."""
        self.packets: list[PacketView] = []
        self.suspects: list[SuspectView] = []
        """The aMussels that became suspect."""
        self._pinged: set[int] = set()
        """The aMussels that a person pinged and that have not answered yet."""
        self._scale = scenario.time_scale
        self.add(journal)

    def add(self, journal: JournalContents) -> None:
        """Adds further events. One from before the time of the last `advance` is taken by the next."""
        self._entries = [*self._entries[self._next :], *journal.entries]
        self._next = 0
        self.end_ms = max(self.end_ms, journal.last_ms)

    def has_events_until(self, at_ms: int) -> bool:
        """True when `advance` to this time would take an event."""
        return self._next < len(self._entries) and self._entries[self._next].at_ms <= at_ms

    def advance(self, now_ms: int) -> None:
        """Takes all events up to a mission time."""
        while self.has_events_until(now_ms):
            entry = self._entries[self._next]
            self._next += 1
            self.now.apply(*entry)
            self._list(entry)
            if (told := shown_event(entry) or self._ping_answer(entry)) is not None:
                self.events.append(told)

    def _list(self, entry: Entry) -> None:
        match entry.event:
            case APadMoved() as apad:
                self.trace.append((entry.at_ms, apad.north_m, apad.east_m))
            case PlanMade():
                self.plans.append(entry)
            case PacketPassed() as packet:
                self.packets.append(_packet_view(packet, self._scale))
            case AMusselSuspected(agent_id, reason):
                self.suspects.append(SuspectView(entry.at_ms, agent_id, reason))
            case SuspicionOver(agent_id):
                self.suspects = [
                    it._replace(until_ms=entry.at_ms) if it.agent == agent_id and it.until_ms is None else it
                    for it in self.suspects
                ]
            case PersonOrdered(order="ping", agent=int(agent_id)):
                self._pinged.add(agent_id)

    def _ping_answer(self, entry: Entry) -> ShownEvent | None:
        """The answer to a person's ping; the aPad's own pings are routine."""
        match entry.event:
            case RangeMeasured(agent_id, range_m) if agent_id in self._pinged:
                self._pinged.remove(agent_id)
                answer = "did not answer the ping" if range_m is None else f"is {range_m:.2f} m away"
                return ShownEvent(entry.at_ms, Category.NEWS, f"aMussel {agent_id} {answer}", agent_id)
        return None


def _packet_view(packet: PacketPassed, scale: TimeScale) -> PacketView:
    heard = [(listener, outcome) for listener, outcome, *_ in packet.heard]
    near = tuple((listener, outcome) for listener, outcome in heard if outcome not in _TOO_FAR)
    return PacketView(
        at_ms=scale.mission_span(packet.began_ms),
        lasted_ms=packet.lasted_ms,
        sender=packet.from_,
        what=packet.what,
        address=packet.address,
        unsent=packet.unsent,
        heard=near,
        far=len(heard) - len(near),
        timeslot=packet.timeslot,
    )
