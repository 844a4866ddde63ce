"""Serves one sea to several flights, each in a process of its own.

The flights' fleets stay where they are: each flight grants its own, by its coordinator. The server runs the sea's rounds,
and asks each flight for the rounds' windows. It begins once all flights are ready, and lets a tick pass once all have come
to it. A flight that is gone, or silent, leaves the water, and the others go on.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import wait

from agents.coordinator import AgentDied
from agents.mussel.outputs import Output, Truth
from agents.mussel.stimuli import AgentStimulus
from agents.nursery.protocol import is_of_our_user
from agents.time_scale import AgentMs, MissionMs
from agents.water.sea import Sea, Station
from agents.water.sea_events import APAD, LeftWater
from agents.water.sea_link import (
    Begin,
    Leave,
    Link,
    LinkEnded,
    Ready,
    SeaHello,
    SeaRefusal,
    SeaWelcome,
    Tick,
    Ticked,
    Window,
    Windowed,
)

CALLS = frozenset({"carry_apad", "send_sound", "cancel_sends", "ping", "set_topology"})
"""The methods of a `Station` that a flight may call."""
START_S = 180.0
"""Wall seconds from the first flight that is ready. Flights that are not ready by then are not waited for."""
SILENT_S = 30.0
"""Wall seconds from the first flight that has come to a tick, after which one that has not is out of the water."""
ANSWER_S = 60.0
"""Wall seconds for a fleet's window; its watchdog may have to end agents, and restart them."""
ALONE_S = 600.0
"""Wall seconds without any flight after which the server ends."""
_HELLO_S = 5.0
_LOOK_S = 0.5


class RemoteFleet:
    """A fleet in another process, as the sea's rounds see it: its `Authority` and its `TruthSource`.

    After a failure of its link it has nothing to do any more, and `gone` is the reason.
    """

    def __init__(self, link: Link, agent_ids: tuple[int, ...]) -> None:
        self.agent_ids = agent_ids
        self.gone: str | None = None
        self._link = link
        self._due_ms: int | None = None
        self._stimuli: list[tuple[int, int, AgentStimulus]] = []
        self._truths: list[Truth] = []

    def come(self, tick: Tick) -> None:
        """The flight has come to this tick."""
        self._due_ms = tick.due_ms
        self._truths += tick.truths

    @property
    def due_agent_ms(self) -> int | None:
        dues_ms = [at_ms for _, at_ms, _ in self._stimuli]
        if self._due_ms is not None:
            dues_ms.append(self._due_ms)
        return min(dues_ms, default=None)

    def receive_at(self, agent_id: int, stimulus: AgentStimulus, agent_ms: AgentMs) -> int:
        """Keeps the stimulus for the next window. The flight's coordinator stamps it; see `sea_client.py`."""
        self._stimuli.append((agent_id, agent_ms, stimulus))
        return agent_ms

    def take_stimuli(self) -> tuple[tuple[int, int, AgentStimulus], ...]:
        stimuli, self._stimuli = self._stimuli, []
        return tuple(stimuli)

    def advance(self, now_ms: MissionMs) -> Iterable[Output | AgentDied]:
        return self._ask(AgentMs(now_ms), now_ms)

    def grant(self, until_ms: AgentMs) -> Iterable[Output | AgentDied]:
        due_ms = self.due_agent_ms
        return () if due_ms is None or due_ms > until_ms else self._ask(until_ms, None)

    def take_truths(self) -> list[Truth]:
        truths, self._truths = self._truths, []
        return truths

    def _ask(self, until_ms: AgentMs, tick_ms: MissionMs | None) -> Iterable[Output | AgentDied]:
        window = Window(until_ms, tick_ms, self.take_stimuli())
        try:
            if self.gone is None:
                self._link.send(window)
        except LinkEnded as ended:
            self._end(str(ended))
        return self._answer()

    def _answer(self) -> Iterator[Output | AgentDied]:
        """Waits for the answer when the first outcome is asked for: other fleets have their windows by then."""
        if self.gone is not None:
            return
        try:
            answer = self._link.receive(ANSWER_S)
        except LinkEnded as ended:
            self._end(str(ended))
            return
        if not isinstance(answer, Windowed):
            self._end(f"it answered a window by a {type(answer).__name__}")
            return
        self._due_ms = answer.due_ms
        self._truths += answer.truths
        yield from answer.outputs

    def _end(self, reason: str) -> None:
        self.gone, self._due_ms = reason, None


@dataclass(slots=True)
class _Flight:
    """One aPad's flight, as far as the server knows it."""

    number: int
    name: str
    link: Link | None = None
    has_come: bool = False
    """A supervisor of it has said Hello."""
    epoch: int = 0
    ready: Ready | None = None
    fleet: RemoteFleet | None = None
    station: Station | None = None
    """None while it is not in the water."""
    tick: Tick | None = None
    """The tick that it waits for."""
    leaves: str | None = None
    """The reason why it leaves at the next tick; empty at its end."""


@dataclass(slots=True)
class SeaServer:
    """Serves `sea` to the aPads of these `names`, in order, at a listening socket. It belongs to one thread."""

    sea: Sea
    names: Sequence[str]
    listener: socket.socket
    clock_s: Callable[[], float] = time.monotonic
    _flights: list[_Flight] = field(init=False)
    _zero_clock_ms: int | None = field(default=None, init=False)
    """The flights' clock at mission time 0; None before they begin."""
    _now_ms: MissionMs | None = field(default=None, init=False)
    """The mission time of the last tick."""
    _waits_since_s: float | None = field(default=None, init=False)
    """Since when a flight waits for another one."""
    _alone_since_s: float = field(init=False)

    def __post_init__(self) -> None:
        self._flights = [_Flight(number, name) for number, name in enumerate(self.names)]
        self._alone_since_s = self.clock_s()

    def run(self) -> None:
        """Serves until no flight has been there for `ALONE_S`."""
        while self.clock_s() - self._alone_since_s < ALONE_S:
            self.step(_LOOK_S)

    def step(self, timeout_s: float) -> None:
        """Handles what has arrived, within `timeout_s`, and lets a tick pass if all flights have come to it."""
        flights = {it.link.fileno(): it for it in self._flights if it.link is not None and it.leaves is None}
        links = {descriptor: it.link for descriptor, it in flights.items()}
        listening = self.listener.fileno()
        for descriptor in wait([listening, *flights], timeout_s):
            if descriptor == listening:
                self._admit()
                continue
            assert isinstance(descriptor, int)
            flight, link = flights[descriptor], links[descriptor]
            if link is not None and flight.link is link:  # nobody followed it just now
                self._receive(flight, link)
        if self._zero_clock_ms is None:
            self._begin_together()
        else:
            self._tick_together()
        if any(it.link is not None for it in self._flights):
            self._alone_since_s = self.clock_s()

    # Flights come and go.

    def _admit(self) -> None:
        sock, _ = self.listener.accept()
        if not is_of_our_user(sock):
            sock.close()
            return
        link = Link(sock)
        try:
            hello = link.receive(_HELLO_S)
            if not isinstance(hello, SeaHello) or not 0 <= hello.number < len(self._flights):
                raise LinkEnded("no aPad of this sea")
            flight = self._flights[hello.number]
            if hello.epoch <= flight.epoch:
                link.send(SeaRefusal(f"a newer supervisor of {flight.name} is in the water, or was"))
                raise LinkEnded("fenced off")
            link.send(SeaWelcome(self._now_ms))
        except LinkEnded:
            link.close()
            return
        if flight.link is not None:
            self._remove(flight, "another supervisor follows it")
        self._flights[hello.number] = _Flight(flight.number, flight.name, link, True, hello.epoch)

    def _receive(self, flight: _Flight, link: Link) -> None:
        try:
            message = link.receive(0)
        except LinkEnded as ended:
            self._part(flight, str(ended))
            return
        match message:
            case Ready() if flight.ready is None:
                flight.ready = message
                if self._zero_clock_ms is not None:
                    self._begin(flight)
            case Tick() if flight.station is not None and flight.tick is None:
                flight.tick = message
            case Leave():
                self._part(flight, "")
            case _:
                self._part(flight, f"it said {type(message).__name__} when it was not due")

    def _part(self, flight: _Flight, reason: str) -> None:
        """One in the water leaves at the next tick, in the order of flights; so do its last sounds."""
        if flight.station is None:
            self._remove(flight, reason)
        else:
            flight.leaves = reason

    def _remove(self, flight: _Flight, reason: str) -> None:
        """Takes a flight out of the water at once. Without a reason its end was expected, and nobody is told."""
        link, station = flight.link, flight.station
        flight.link = flight.ready = flight.fleet = flight.station = flight.tick = flight.leaves = None
        if station is not None:
            station.leave()
        if link is None:
            return
        if reason:
            with suppress(LinkEnded):  # it is gone, or it will see that its link is closed
                link.send(SeaRefusal(reason))
            for other in self._flights:
                if other.station is not None:
                    other.station.results.append(LeftWater(self._now_ms or MissionMs(0), flight.name, reason))
        link.close()

    # Beginning, and time.

    def _begin_together(self) -> None:
        if not (ready := [it for it in self._flights if it.ready is not None]):
            return
        awaited = any(it.ready is None and (it.link is not None or not it.has_come) for it in self._flights)
        if awaited and self._waited_s() < START_S:
            return
        self._waits_since_s = None
        self._zero_clock_ms = max(it.ready.clock_ms for it in ready if it.ready is not None)
        for flight in ready:
            self._begin(flight)

    def _begin(self, flight: _Flight) -> None:
        link, ready = flight.link, flight.ready
        assert link is not None and ready is not None and self._zero_clock_ms is not None
        flight.fleet = RemoteFleet(link, ready.agent_ids)
        flight.station = self.sea.join(flight.fleet, flight.fleet, APAD - flight.number)
        try:
            link.send(Begin(self._now_ms, self._zero_clock_ms))
        except LinkEnded as ended:
            self._remove(flight, str(ended))

    def _tick_together(self) -> None:
        flying = [it for it in self._flights if it.station is not None]
        late = [it for it in flying if it.tick is None and it.leaves is None]
        if late and all(it.tick is None for it in flying):
            return
        if late:
            if self._waited_s() < SILENT_S:
                return
            for flight in late:
                flight.leaves = f"silent for {SILENT_S:g} s"
        self._waits_since_s = None
        for flight in flying:
            self._do_as_asked(flight)
        self._pass_tick([it for it in flying if it.station is not None])

    def _do_as_asked(self, flight: _Flight) -> None:
        """Does what the flight did since its last tick; or lets it leave."""
        station, tick = flight.station, flight.tick
        if flight.leaves is not None:
            self._remove(flight, flight.leaves)
        elif station is not None and flight.fleet is not None and tick is not None:
            flight.fleet.come(tick)
            for call in tick.calls:
                if call.method in CALLS:
                    getattr(station, call.method)(*call.arguments)

    def _pass_tick(self, flying: Sequence[_Flight]) -> None:
        for flight in flying:
            station, fleet, link, tick = flight.station, flight.fleet, flight.link, flight.tick
            assert station is not None and fleet is not None and link is not None and tick is not None
            results = station.advance(tick.now_ms)
            self._now_ms = tick.now_ms
            flight.tick = None
            apads, dropped = self.sea.apads_at_tick, station.all_dropped
            try:
                if fleet.gone is not None:
                    raise LinkEnded(fleet.gone)
                link.send(Ticked(tuple(results), fleet.take_stimuli(), apads, dropped))
            except LinkEnded as ended:
                flight.leaves = str(ended)

    def _waited_s(self) -> float:
        if self._waits_since_s is None:
            self._waits_since_s = self.clock_s()
        return self.clock_s() - self._waits_since_s
