"""A flight's end of a sea that a process of its own serves to several flights (`sea_server.py`).

`RemoteStation` has the verbs of a `Station`. What the flight does at a tick goes out with its next tick, and nothing else
happens in the sea meanwhile, so a flight in its own process and one beside the sea see the same.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from contextlib import suppress

from agents.coordinator import AgentDied, Coordinator
from agents.mussel.outputs import PingAnswered, SoundSent, Truth, WifiSent
from agents.mussel.stimuli import AgentStimulus
from agents.time_scale import AgentMs, MissionMs
from agents.water.places import ModemPlace, place_of
from agents.water.sea import LOST_IN_THE_AIR, SeaConfig, TruthSource
from agents.water.sea_events import (
    APAD,
    AgentRanged,
    LeftWater,
    NotRanged,
    SeaLost,
    SeaResult,
    StimulusDelivered,
)
from agents.water.sea_link import (
    Begin,
    Leave,
    Link,
    LinkEnded,
    Ready,
    SeaHello,
    SeaRefusal,
    SeaWelcome,
    StationCall,
    Tick,
    Ticked,
    Window,
    Windowed,
    connect,
)
from agents.water.sea_server import ANSWER_S, SILENT_S, START_S
from agents.water.topology import Topology

_CONNECT_S = 10.0
_BEGIN_S = START_S + 60.0
_TICK_S = 2 * (SILENT_S + ANSWER_S)
"""Wall seconds without a message, after which the sea counts as lost: it may wait for others as long as it states."""
_NO_WATER = "sound: its aPad is not in the water any more"


class SeaRefused(Exception):
    """The sea does not take the flight, for this reason; or there is no such sea."""


class RemoteSea:
    """The sea in another process, for the flight of one aPad."""

    def __init__(self, link: Link, number: int, name: str, epoch: int, config: SeaConfig) -> None:
        """`number` counts the sea's aPads from 0 on. SeaRefused if the sea does not take it."""
        self.config = config
        self.apad = APAD - number
        """The node of the aPad's modem."""
        self.name = name
        self._link = link
        try:
            link.send(SeaHello(number, epoch))
            welcome = self._receive(_CONNECT_S)
            if not isinstance(welcome, SeaWelcome):
                raise SeaRefused(f"the sea said {type(welcome).__name__}")
        except BaseException:
            link.close()
            raise
        self.now_ms = welcome.now_ms
        """The mission time that the flights in it have come to; None before they begin."""

    @classmethod
    def at(cls, directory: str, number: int, name: str, epoch: int, config: SeaConfig) -> RemoteSea:
        """Connects to the sea that is served in this directory; SeaRefused if none is, or it does not take the flight."""
        try:
            return cls(connect(directory, _CONNECT_S), number, name, epoch, config)
        except OSError:
            raise SeaRefused("its process has ended") from None
        except LinkEnded as ended:
            raise SeaRefused(str(ended)) from None

    def join(self, coordinator: Coordinator, host: TruthSource) -> RemoteStation:
        """The station of this flight's fleet, which is in the water once the flight has begun."""
        return RemoteStation(self, self._link, coordinator, host)

    def begin(self, agent_ids: tuple[int, ...], clock_ms: int) -> Begin:
        """Waits until all flights can begin; `clock_ms` is the clock that this one will follow, now.

        SeaRefused if the sea does not take it.
        """
        try:
            self._link.send(Ready(agent_ids, clock_ms))
            begin = self._receive(_BEGIN_S)
        except LinkEnded as ended:
            raise SeaRefused(str(ended)) from None
        if not isinstance(begin, Begin):
            raise SeaRefused(f"the sea said {type(begin).__name__}")
        return begin

    def _receive(self, timeout_s: float) -> object:
        message = self._link.receive(timeout_s)
        if isinstance(message, SeaRefusal):
            raise SeaRefused(message.reason)
        return message


class RemoteStation:
    """A `Station` whose sea is in another process. It belongs to the flight's thread.

    Without its sea, or out of the water, it grants its fleet by itself. Sound is then lost, and Wi-Fi has this aPad's radio
    alone.
    """

    has_others = True

    def __init__(self, sea: RemoteSea, link: Link, coordinator: Coordinator, host: TruthSource) -> None:
        self.apad = sea.apad
        self.config = sea.config
        self._name = sea.name
        self._link: Link | None = link
        self._coordinator = coordinator
        self._host = host
        self._calls: list[StationCall] = []
        self._truths: list[Truth] = []
        """Those that `take_truths` has not returned."""
        self._unsent: list[Truth] = []
        """Those that the sea does not know."""
        self._stamps: list[int | None] = []
        """The agent times of the stimuli from the sea in this tick, in order."""
        self._places: dict[int, ModemPlace] = {}
        """The newest place of each aMussel of this fleet."""
        self._place: ModemPlace | None = None
        self._apads: Mapping[int, ModemPlace | None] = {}
        self._dropped: Counter[str] = Counter()
        self._dropped_there: Counter[str] = Counter()
        self._pinged: list[int] = []
        """The aMussels whose pings have no outcome yet."""

    @property
    def all_dropped(self) -> Counter[str]:
        return self._dropped + self._dropped_there

    # Time.

    def advance(self, now_ms: MissionMs) -> list[SeaResult]:
        """Like `Station.advance`, returns once all flights in the water have come to mission time `now_ms`."""
        if self._link is None:
            return self._advance_alone(now_ms)
        died: list[SeaResult] = []
        try:
            return self._advance_together(self._link, now_ms, died)
        except SeaRefused as refused:
            why: SeaResult = LeftWater(now_ms, self._name, str(refused))
        except LinkEnded as ended:
            why = SeaLost(now_ms, f"the sea that the aPads share is lost: {ended}")
        self._stop()
        return [*died, *self._advance_alone(now_ms), why]

    def _advance_together(self, link: Link, now_ms: MissionMs, died: list[SeaResult]) -> list[SeaResult]:
        calls, self._calls = tuple(self._calls), []
        self._new_truths()
        due_ms = self._coordinator.due_agent_ms
        with suppress(LinkEnded):  # the sea may have said why
            link.send(Tick(now_ms, calls, self._take_unreported(), due_ms))
        while True:
            match link.receive(_TICK_S):
                case Window(until_ms, tick_ms, stimuli):
                    self._receive_stimuli(stimuli)
                    outputs = tuple(
                        self._coordinator.grant(until_ms)
                        if tick_ms is None
                        else self._coordinator.advance(tick_ms)
                    )
                    died += [it for it in outputs if isinstance(it, AgentDied)]
                    self._new_truths()
                    link.send(Windowed(outputs, self._take_unreported(), self._coordinator.due_agent_ms))
                case Ticked(results, stimuli, apads, dropped):
                    self._receive_stimuli(stimuli)
                    self._apads, self._dropped_there = apads, dropped
                    return self._stamped(results)
                case SeaRefusal(reason):
                    raise SeaRefused(reason)
                case other:
                    raise LinkEnded(f"it said {type(other).__name__} when it was not due")

    def _receive_stimuli(self, stimuli: tuple[tuple[int, int, AgentStimulus], ...]) -> None:
        self._stamps += [
            self._coordinator.receive_at(agent_id, stimulus, AgentMs(at_ms))
            for agent_id, at_ms, stimulus in stimuli
        ]

    def _stamped(self, results: tuple[SeaResult, ...]) -> list[SeaResult]:
        """The results, in which each stimulus has the time at which its aMussel gets it; a dead one gets none."""
        stamps, self._stamps = iter(self._stamps), []
        stamped: list[SeaResult] = []
        for it in results:
            if isinstance(it, AgentRanged | NotRanged) and it.agent_id in self._pinged:
                self._pinged.remove(it.agent_id)
            if not isinstance(it, StimulusDelivered):
                stamped.append(it)
            elif (agent_ms := next(stamps)) is not None:
                stamped.append(StimulusDelivered(it.mission_ms, it.agent_id, agent_ms, it.stimulus))
        return stamped

    def _advance_alone(self, now_ms: MissionMs) -> list[SeaResult]:
        results: list[SeaResult] = [NotRanged(now_ms, it) for it in self._pinged]
        self._pinged = []
        for it in self._coordinator.advance(now_ms):
            if isinstance(it, SoundSent | PingAnswered):
                self._dropped[_NO_WATER] += 1
            elif isinstance(it, WifiSent) and not self.config.wifi_gets_through(
                it.agent_id, self._places.get(it.agent_id), self.apad, self._place, it.at_ms
            ):
                self._dropped[LOST_IN_THE_AIR] += 1
            else:
                results.append(it)
        return results

    def _stop(self) -> None:
        """Goes on without the sea."""
        if self._link is not None:
            self._link.close()
        self._link, self._calls, self._apads, self._stamps = None, [], {}, []

    def leave(self) -> None:
        """Takes this aPad's modem and its fleet's out of the water, at the flight's end."""
        if self._link is None:
            return
        with suppress(LinkEnded):  # the sea may have ended just before the flight
            self._link.send(Leave())
        self._stop()

    # Truths and places.

    def take_truths(self) -> list[Truth]:
        """The fleet's truths since the last call."""
        self._new_truths()
        truths, self._truths = self._truths, []
        return truths

    def _new_truths(self) -> None:
        new = self._host.take_truths()
        self._truths += new
        self._unsent += new
        for truth in new:
            self._places[truth.agent_id] = place_of(truth.physical, self.config.sinking)

    def _take_unreported(self) -> tuple[Truth, ...]:
        unsent, self._unsent = self._unsent, []
        return tuple(unsent)

    def carry_apad(self, north_m: float, east_m: float, at_ms: int) -> None:
        """Places the aPad at mission time `at_ms`, which is now or after the last tick."""
        self._place = self.config.apad_place(north_m, east_m)
        self._ask("carry_apad", north_m, east_m, at_ms)

    # The aPad acts at ticks.

    def send_sound(self, agent_id: int | None, data: bytes, not_before_ms: int = 0) -> None:
        """Sends bytes by the aPad's modem, to one aMussel or to all: at that agent time, or as soon as it is free."""
        self._ask("send_sound", agent_id, data, not_before_ms)

    def cancel_sends(self, agent_id: int) -> None:
        """Drops what waits to be sent to an aMussel."""
        self._ask("cancel_sends", agent_id)

    def ping(self, agent_id: int, not_before_ms: int = 0) -> None:
        """Measures the range to an aMussel; Ranged or NotRanged follows."""
        self._pinged.append(agent_id)
        self._ask("ping", agent_id, not_before_ms)

    def set_topology(self, topology: Topology) -> None:
        """Replaces the topology of the whole sea from now on."""
        self._ask("set_topology", topology)

    def wifi_reaches(self, agent_id: int, now_ms: MissionMs) -> bool:
        """True if a Wi-Fi packet that is sent to an aMussel now gets through, from this aPad or from another."""
        apads = {**self._apads, self.apad: self._place}
        at_ms = self._coordinator.scale.agent_ms(now_ms)
        reached = self.config.any_radio_reaches(apads, agent_id, self._places.get(agent_id), at_ms)
        if not reached:
            self._dropped[LOST_IN_THE_AIR] += 1
        return reached

    def write(self, agent_id: int, data: bytes) -> None:
        """No modem is open in a sea that several flights share."""
        raise ValueError(f"the modem of aMussel {agent_id} has not been opened")

    def _ask(self, method: str, *arguments: object) -> None:
        if self._link is not None:
            self._calls.append(StationCall(method, arguments))
        elif method in ("send_sound", "ping"):
            self._dropped[_NO_WATER] += 1
