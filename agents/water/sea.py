"""Fleets in one sea: advances time in rounds as fine as sound needs, and carries packets between modems.

A packet acts at its end, and the shortest packet lasts 105 ms. So an agent that acts at a time d affects nobody before
d + 105 ms. A round therefore ends at the next end of a packet under way, or 105 ms after the next action of anybody,
whichever is first; if nobody has anything to do, it ends at the tick. A receiver takes a packet in the next round,
stamped with its end. The medium takes modems' places from the fleets' truths, because it is the world, not a mission.

Several aPads' flights share one sea. Each has a station in it: its aPad's modem, beside its own fleet. The first flight of
a tick lets time pass for all fleets; the others then take what happened meanwhile. So nobody acts in another's past. A
station's fleet is granted its time by an `Authority`: its coordinator, in this process or behind a link (`sea_server.py`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from agents.coordinator import AgentDied
from agents.modem.facts import FrameArrived
from agents.modem.frames import PAYLOAD_BYTES, SHORT_MS, FrameKind, ModemFrame, ModemGeneration
from agents.modem.modem_model import ModemFirmware
from agents.mussel.outputs import Output, PingAnswered, SoundSent, Truth, WifiSent
from agents.mussel.stimuli import AgentStimulus, ModemSent, PingArrived, SoundArrived
from agents.time_scale import AgentMs, MissionMs, TimeScale
from agents.water import medium
from agents.water.apad_modem import APadModem, ModemSend
from agents.water.medium import Began, LinksChanged, ModemMoved, PacketEnded, ThrustersRan, WaterMedium
from agents.water.packet_draws import fates
from agents.water.places import ModemPlace, along_m, place_of
from agents.water.sea_events import (
    APAD,
    APAD_ADDRESS,
    AgentRanged,
    NotRanged,
    Printed,
    SeaResult,
    SoundReached,
    StimulusDelivered,
    address_of,
)
from agents.water.sea_modems import SeaModems, noise_measured
from agents.water.sound import Sound
from agents.water.topology import Topology
from agents.water.wifi import Wifi
from firmware_model.power.rails import RAILS
from firmware_model.sinking import Sinking

_FIRMWARE = {ModemGeneration.V2: ModemFirmware.V2, ModemGeneration.V3: ModemFirmware.V3}
LOST_IN_THE_AIR = "Wi-Fi: lost in the air"
_START_MS = MissionMs(0)


@dataclass(frozen=True, slots=True)
class SeaConfig:
    """Agent time. If `wifi` is None, only the water limits Wi-Fi."""

    seed: int
    sound: Sound
    wifi: Wifi | None
    sinking: Sinking
    modems: ModemGeneration = ModemGeneration.V3

    def apad_place(self, north_m: float, east_m: float) -> ModemPlace:
        """The place of an aPad's modem, on its keel."""
        return ModemPlace(round(north_m * 1e6), round(east_m * 1e6), self.sound.keel_um, in_water=True)

    def wifi_gets_through(
        self,
        sender: int,
        sent_at: ModemPlace | None,
        receiver: int,
        received_at: ModemPlace | None,
        at_ms: int,
    ) -> bool:
        """True if a Wi-Fi packet between two nodes at these places gets through the air; None is a place not known yet."""
        if self.wifi is None:
            return True
        if sent_at is None or received_at is None:
            return False
        return self.wifi.gets_through(along_m(sent_at, received_at), self.seed, sender, at_ms, receiver)

    def any_radio_reaches(
        self, apads: Mapping[int, ModemPlace | None], agent_id: int, place: ModemPlace | None, at_ms: int
    ) -> bool:
        """True if a packet from one of the aPads to an aMussel gets through the air. Their radios are one network."""
        return any(
            self.wifi_gets_through(apad, sent_at, agent_id, place, at_ms) for apad, sent_at in apads.items()
        )


class Authority(Protocol):
    """The clock authority of a station's fleet, with the verbs of the `Coordinator`.

    The outcome of a grant may be read later, so that several fleets get the same window at once.
    """

    @property
    def agent_ids(self) -> Sequence[int]: ...

    @property
    def due_agent_ms(self) -> int | None: ...

    def advance(self, now_ms: MissionMs) -> Iterable[Output | AgentDied]: ...

    def grant(self, until_ms: AgentMs) -> Iterable[Output | AgentDied]: ...

    def receive_at(self, agent_id: int, stimulus: AgentStimulus, agent_ms: AgentMs) -> int | None: ...


class TruthSource(Protocol):
    def take_truths(self) -> list[Truth]: ...


SeaEvent = tuple[int, int, int, medium.MediumStimulus | WifiSent]
"""(agent time, order within it, node, stimulus or Wi-Fi packet on its way to the aPad)"""


class Sea:
    """The water around the fleets of one flight or of several. It owns the medium, the rounds and who is in the water."""

    def __init__(
        self,
        config: SeaConfig,
        scale: TimeScale,
        agent_ids: Iterable[int],
        apads: int = 1,
        now_ms: MissionMs = _START_MS,
        opened: Collection[int] = (),
    ) -> None:
        """`agent_ids` are all fleets' aMussels, and `apads` is the number of stations that will `join`.

        `opened` are the agents whose modems somebody else may use: see `Station.write` and `Printed`. `now_ms` is mission
        time.
        """
        self.config = config
        self.scale = scale
        self.apads = apads
        nodes = [*(APAD - n for n in range(apads)), *agent_ids]
        addresses = {node: address_of(node) for node in nodes}
        self.now_ms = scale.agent_ms(now_ms)
        """Agent time."""
        self.medium = WaterMedium(config.sound, config.seed, addresses.items(), self.now_ms)
        self.modem_dropped: Counter[str] = Counter()
        """The drops of simulated modems, which belong to no station alone."""
        self.modems = (
            SeaModems(_FIRMWARE[config.modems], addresses, opened, self.now_ms, self.modem_dropped)
            if opened
            else None
        )
        if self.modems is not None:
            self.modems.measure(noise_measured(config.sound.noise_db), nodes)
        self.places: dict[int, ModemPlace] = {}
        self.apads_at_tick: dict[int, ModemPlace | None] = {}
        """The place of each aPad at the end of the last rounds, as other flights know it. None before its first place."""
        self._stations: dict[int, Station] = {}
        """The stations in the water, by their aPads' nodes."""
        self._station_of: dict[int, Station] = {}
        """The station of each aMussel in the water."""
        self._behind: set[int] = set()
        """The aPads whose flights have not taken the results of the last rounds yet."""
        self.undelivered: list[medium.MediumResult] = []
        """The medium's results between two ticks."""

    def join(self, coordinator: Authority, host: TruthSource, apad: int | None = None) -> Station:
        """Puts an aPad's modem and its fleet into the water: the next one, or the one of this node.

        ValueError if all aPads have joined, or this one has.
        """
        if len(self._stations) == self.apads:
            raise ValueError(f"this sea is for {self.apads} aPads")
        node = APAD - len(self._stations) if apad is None else apad
        if node in self._stations:
            raise ValueError(f"aPad {APAD - node + 1} of this sea has joined already")
        station = Station(self, node, coordinator, host)
        self._stations[node] = station
        self._station_of.update(dict.fromkeys(coordinator.agent_ids, station))
        return station

    def leave(self, station: Station) -> None:
        """Takes the station out: its flight has ended, nobody grants its fleet time, and its modems fall silent."""
        self._stations.pop(station.apad, None)
        self._behind.discard(station.apad)
        gone = [agent_id for agent_id, it in self._station_of.items() if it is station]
        for node in (station.apad, *gone):
            self._station_of.pop(node, None)
            self.places.pop(node, None)
            self.undelivered += self.medium.receive(ModemMoved(node, None), self.now_ms)

    def move(self, node: int, place: ModemPlace, at_ms: int) -> list[medium.MediumResult]:
        self.places[node] = place
        return self.medium.receive(ModemMoved(node, place), at_ms)

    # Rounds.

    def advance(self, station: Station, now_ms: MissionMs) -> None:
        """Runs everything up to mission time `now_ms`, in the order of the rounds, unless another station did so already.

        ValueError if time went back, or if the flights are not in step: each must have come to a time before any goes on.
        """
        until_ms = self.scale.agent_ms(now_ms)
        if until_ms < self.now_ms:
            raise ValueError(f"time went back: {until_ms} before {self.now_ms}")
        if station.apad in self._behind and until_ms == self.now_ms:
            self._behind.remove(station.apad)
            return
        if self._behind:
            raise ValueError(
                f"flights out of step: not all have come to {self.now_ms}, one goes on to {until_ms}"
            )
        self._behind = self._stations.keys() - {station.apad}
        undelivered, self.undelivered = self.undelivered, []
        self._deliver(undelivered)
        while True:
            horizon_ms = self._horizon(until_ms)
            whole = horizon_ms == until_ms
            granted = [
                (it, it.coordinator.advance(now_ms) if whole else it.coordinator.grant(horizon_ms))
                for it in self._stations.values()
            ]
            self._round([(it, output) for it, outputs in granted for output in outputs], horizon_ms)
            self.now_ms = horizon_ms
            if whole:
                self.apads_at_tick = {apad: self.places.get(apad) for apad in self._stations}
                return

    def _horizon(self, until_ms: AgentMs) -> AgentMs:
        """The end of the next round, chosen so that nothing that begins in the round acts before its end."""
        horizon_ms: int = until_ms
        if (due_ms := self.medium.next_due_ms) is not None:
            horizon_ms = min(horizon_ms, due_ms)
        acts = [None if self.modems is None else self.modems.next_due_ms]
        for it in self._stations.values():
            acts += [it.coordinator.due_agent_ms, it.keel.next_due_ms]
        for acts_ms in acts:
            if acts_ms is not None:
                horizon_ms = min(horizon_ms, max(acts_ms, self.now_ms) + SHORT_MS[self.config.modems])
        return AgentMs(max(horizon_ms, self.now_ms))

    def _round(self, outputs: Sequence[tuple[Station, Output | AgentDied]], horizon_ms: int) -> None:
        """Brings the agents' outputs to the medium, in the order of time, and the medium's decisions to the agents."""
        events: list[SeaEvent] = []
        for truth in [truth for it in self._stations.values() for truth in it.new_truths()]:
            moved = ModemMoved(truth.agent_id, place_of(truth.physical, self.config.sinking))
            events.append((truth.at_ms, 0, truth.agent_id, moved))
            if self.modems is not None:
                self.modems.power(truth.agent_id, RAILS[truth.state] != 0, truth.at_ms)
        for station, it in outputs:
            match it:
                case SoundSent(at_ms, agent_id) | PingAnswered(at_ms, agent_id):
                    if (frame := station.frame(it)) is not None:
                        self._send(events, at_ms, agent_id, frame)
                case WifiSent(at_ms, agent_id):
                    events.append((at_ms, 2, agent_id, it))
                case AgentDied(_, agent_id, gave_up=reason) if reason is not None:
                    events.append((horizon_ms, 0, agent_id, ModemMoved(agent_id, None)))
                    station.results.append(it)
                case _:
                    station.results.append(it)
        for station in self._stations.values():
            for action in station.keel.advance(horizon_ms):
                if isinstance(action, ModemSend):
                    self._send(events, action.at_ms, station.apad, action.frame)
                elif action.node is not None:
                    station.results.append(NotRanged(self._mission_ms(action.at_ms), action.node))
        if self.modems is not None:
            for sent in self.modems.round(horizon_ms):
                events.append((sent.at_ms, 1, sent.node, Began(sent.node, sent.frame)))
                if not sent.from_host and sent.node > APAD:
                    self._stimulate(sent.node, ModemSent(sent.frame.duration_ms), AgentMs(sent.at_ms))
            events += [(at_ms, 0, it.node, it) for at_ms, it in self.modems.take_readdressed()]
        self._deliver(self._apply(events, horizon_ms))
        if self.modems is not None:
            for node, data in self.modems.take_printed():
                if (printing := self._station(node)) is not None:
                    printing.results.append(Printed(self._mission_ms(horizon_ms), node, data))

    def _apply(self, events: list[SeaEvent], horizon_ms: int) -> list[medium.MediumResult]:
        """Applies the events in the order of time. Returns the medium's decisions up to the horizon."""
        decided: list[medium.MediumResult] = []
        for at_ms, _, node, event in sorted(events, key=lambda it: it[:3]):
            if isinstance(event, WifiSent):
                if any(self._through_the_air(node, apad, at_ms) for apad in self._stations):
                    self._station_of[node].results.append(event)
                else:
                    self._station_of[node].dropped[LOST_IN_THE_AIR] += 1
                continue
            now_ms = min(max(at_ms, self.medium.now_ms), horizon_ms)
            if isinstance(event, ModemMoved) and event.place is not None:
                decided += self.move(node, event.place, now_ms)
            else:
                decided += self.medium.receive(event, now_ms)
        return decided + self.medium.advance(horizon_ms)

    def _send(self, events: list[SeaEvent], at_ms: int, node: int, frame: ModemFrame) -> None:
        """Sends by the node's modem, if there are modems; otherwise straight into the water."""
        if self.modems is None:
            events.append((at_ms, 1, node, Began(node, frame)))
        else:
            self.modems.ask(node, frame, at_ms)

    def _deliver(self, decided: list[medium.MediumResult]) -> None:
        for it in decided:
            if isinstance(it, PacketEnded):
                if (sent_from := self._station(it.sender)) is not None:
                    sent_from.results.append(sent_from.seen_from_here(it))
                continue
            node, at_ms, frame = it.reception.receiver, it.reception.at_ms, it.frame
            if self.modems is not None:
                arrived = FrameArrived(frame, it.reception.travelled_us, it.reception.snr_db)
                if not self.modems.frame_arrived(node, arrived, at_ms):
                    continue
            if (station := self._stations.get(node)) is not None:
                station.receive_at_apad(it)
                continue
            ping = frame.kind is FrameKind.PING
            stimulus = PingArrived(it.reception.travelled_us) if ping else SoundArrived(frame.data)
            self._stimulate(node, stimulus, AgentMs(at_ms))

    def _stimulate(self, node: int, stimulus: AgentStimulus, at_ms: AgentMs) -> None:
        station = self._station_of.get(node)
        agent_ms = None if station is None else station.coordinator.receive_at(node, stimulus, at_ms)
        if station is not None and agent_ms is not None:
            station.results.append(StimulusDelivered(self._mission_ms(at_ms), node, agent_ms, stimulus))

    def _station(self, node: int) -> Station | None:
        """The station of an aPad or of an aMussel; None for one that has left the water."""
        return self._stations.get(node) or self._station_of.get(node)

    def _through_the_air(self, sender: int, receiver: int, at_ms: int) -> bool:
        places = self.places
        return self.config.wifi_gets_through(
            sender, places.get(sender), receiver, places.get(receiver), at_ms
        )

    def _mission_ms(self, agent_ms: int) -> MissionMs:
        return self.scale.mission_ms(AgentMs(agent_ms))


class Station:
    """One aPad's modem in a sea, beside its flight's fleet. Public times are mission milliseconds.

    Its `advance` replaces the coordinator's. The aPad hears every packet that reaches its modem, of its own fleet and of
    others. An aMussel's packets and outcomes are among the results of the station that it began beside.
    """

    def __init__(self, sea: Sea, apad: int, coordinator: Authority, host: TruthSource) -> None:
        self.apad = apad
        """The node of the aPad's modem."""
        self.dropped: Counter[str] = Counter()
        self.coordinator = coordinator
        self.keel = APadModem(sea.now_ms)
        self.results: list[SeaResult] = []
        """The results since the last `advance` of this station."""
        self._sea = sea
        self._host = host
        self._ranged: set[int] = set()
        """The aMussels that this aPad has ever pinged."""
        self._apad_at_ms: int | None = None
        self._truths: list[Truth] = []

    @property
    def config(self) -> SeaConfig:
        return self._sea.config

    @property
    def now_ms(self) -> int:
        """Agent time."""
        return self._sea.now_ms

    @property
    def has_others(self) -> bool:
        """True if other aPads have their modems in this water."""
        return self._sea.apads > 1

    @property
    def all_dropped(self) -> Counter[str]:
        """The counts of everything that was lost without being the outcome of a packet."""
        return self.dropped + self._sea.modem_dropped

    def advance(self, now_ms: MissionMs) -> list[SeaResult]:
        """Runs everything up to mission time `now_ms`, and returns what happened here, in the order of the rounds.

        ValueError if time went back, or for flights out of step.
        """
        self._sea.advance(self, now_ms)
        results, self.results = self.results, []
        return results

    def leave(self) -> None:
        """Takes this aPad's modem and its fleet's out of the water for good."""
        self._sea.leave(self)

    def take_truths(self) -> list[Truth]:
        """The fleet's truths since the last call; the sea moves the modems accordingly."""
        sea = self._sea
        for truth in self.new_truths():
            place = place_of(truth.physical, sea.config.sinking)
            sea.undelivered += sea.move(truth.agent_id, place, sea.now_ms)
        truths, self._truths = self._truths, []
        return truths

    def new_truths(self) -> list[Truth]:
        """The fleet's truths since the last call of either; `take_truths` returns them again."""
        new = self._host.take_truths()
        self._truths += new
        return new

    # The aPad acts at ticks.

    def carry_apad(self, north_m: float, east_m: float, at_ms: int) -> None:
        """Places the aPad at mission time `at_ms`, which is now or after the last tick."""
        sea, sound = self._sea, self._sea.config.sound
        place = sea.config.apad_place(north_m, east_m)
        before = sea.places.get(self.apad)
        if before is not None and self._apad_at_ms is not None and at_ms > self._apad_at_ms:
            fast = 1000 * along_m(before, place) > sound.thrusting_m_s * (at_ms - self._apad_at_ms)
            sea.undelivered += sea.medium.receive(ThrustersRan(self.apad, fast), sea.now_ms)
            if sea.modems is not None:
                level_db = sound.noise_db + fast * sound.thruster_noise_db
                sea.modems.measure(noise_measured(level_db), [self.apad])
        self._apad_at_ms = at_ms
        sea.undelivered += sea.move(self.apad, place, sea.now_ms)

    def send_sound(self, agent_id: int | None, data: bytes, not_before_ms: int = 0) -> None:
        """Sends bytes by the aPad's modem, to one aMussel or to all: at that agent time, or as soon as it is free."""
        frame = self._carrying(data, APAD_ADDRESS, None if agent_id is None else address_of(agent_id))
        if frame is not None:
            self._ask(agent_id, frame, not_before_ms)

    def cancel_sends(self, agent_id: int) -> None:
        """Drops what waits to be sent to an aMussel."""
        self.keel.forget(agent_id)

    def ping(self, agent_id: int, not_before_ms: int = 0) -> None:
        """Measures the range to an aMussel; Ranged or NotRanged follows."""
        ping = ModemFrame(FrameKind.PING, APAD_ADDRESS, address_of(agent_id), generation=self.config.modems)
        self._ranged.add(agent_id)
        self._ask(agent_id, ping, not_before_ms)

    def set_topology(self, topology: Topology) -> None:
        """Replaces the topology of the whole sea from now on."""
        sea = self._sea
        sea.undelivered += sea.medium.receive(LinksChanged(topology), sea.now_ms)

    def wifi_reaches(self, agent_id: int, now_ms: MissionMs) -> bool:
        """True if a Wi-Fi packet that is sent to an aMussel now gets through, from this aPad or from another.

        Another aPad's radio is where it was at the end of the last rounds, so the flights' order in a tick changes nothing.
        """
        sea = self._sea
        apads = sea.apads_at_tick | {self.apad: sea.places.get(self.apad)}
        place, at_ms = sea.places.get(agent_id), sea.scale.agent_ms(now_ms)
        reached = sea.config.any_radio_reaches(apads, agent_id, place, at_ms)
        if not reached:
            self.dropped[LOST_IN_THE_AIR] += 1
        return reached

    def write(self, agent_id: int, data: bytes) -> None:
        """Writes bytes to an opened modem's serial line; its output comes as `Printed`."""
        if self._sea.modems is None:
            raise ValueError(f"the modem of aMussel {agent_id} has not been opened")
        self._sea.modems.write(agent_id, data)

    def _ask(self, node: int | None, frame: ModemFrame, not_before_ms: int) -> None:
        if not self.keel.ask(node, frame, not_before_ms):
            self.dropped["sound: the aPad's modem has too much to send"] += 1

    # For the sea's rounds.

    def frame(self, output: SoundSent | PingAnswered) -> ModemFrame | None:
        """An aMussel's frame, which goes to the address that all aPads share."""
        source = address_of(output.agent_id)
        if isinstance(output, PingAnswered):
            modems, us = self.config.modems, output.travelled_us
            return ModemFrame(FrameKind.PING_REPLY, source, APAD_ADDRESS, b"", modems, us)
        return self._carrying(output.data, source, APAD_ADDRESS)

    def receive_at_apad(self, heard: medium.FrameHeard) -> None:
        at_ms, frame, config = heard.reception.at_ms, heard.frame, self.config
        mission_ms = self._sea.scale.mission_ms(AgentMs(at_ms))
        if frame.kind is not FrameKind.PING_REPLY:
            self.results.append(SoundReached(mission_ms, heard.sender, frame.data))
        elif self.keel.answered(heard.sender, at_ms):
            *_, normal = fates(config.seed, heard.sender, at_ms, self.apad, b"range")
            round_trip_us = frame.flight_us + heard.reception.travelled_us
            range_m = config.sound.range_m(round_trip_us, config.sound.range_noise_m * normal)
            self.results.append(AgentRanged(mission_ms, heard.sender, range_m))
        elif heard.sender in self._ranged:
            self.dropped["sound: an answer to a ping that was given up"] += 1

    def seen_from_here(self, packet: PacketEnded) -> PacketEnded:
        """The packet as this flight records it: its own aPad is `APAD`, and the n-th aPad of the sea otherwise -n.

        Another aPad beyond the range is left out.
        """
        if not self.has_others:
            return packet
        receptions = []
        for it in packet.receptions:
            if it.receiver == self.apad:
                receptions.append(replace(it, receiver=APAD))
            elif it.receiver > APAD:
                receptions.append(it)
            elif it.outcome is not medium.PacketOutcome.OUT_OF_RANGE:
                receptions.append(replace(it, receiver=it.receiver - 1))
        sender = APAD if packet.sender == self.apad else packet.sender
        return replace(packet, sender=sender, receptions=tuple(receptions))

    def _carrying(self, data: bytes, source: int, to: int | None) -> ModemFrame | None:
        """A frame with these bytes, to one address or to all; None, counted, if a modem cannot carry them."""
        modems = self.config.modems
        fewest, most = PAYLOAD_BYTES[modems]
        if not fewest <= len(data) <= most:
            self.dropped[f"sound: not the {fewest} to {most} bytes that a {modems.name} modem carries"] += 1
            return None
        return ModemFrame(FrameKind.BROADCAST if to is None else FrameKind.UNICAST, source, to, data, modems)
