"""A fleet in its sea: lets time pass in rounds as fine as sound needs, and carries what is said between modems.

A packet acts at its end, and an agent that does something at a time d can be heard from d + 105 ms on at the earliest: so
long is the shortest packet. A round so never goes beyond the next end of a packet on its way, nor beyond that time after
the next thing that anybody does; when nobody has anything to do, it goes to the tick. Whoever hears a packet meets it in
the next round, stamped with its end. The medium knows where modems are from the fleet's truths: it is the world, not a
mission.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from math import hypot

from agents.coordinator import Coordinator, Died, Heard
from agents.host import Host
from agents.keel_modem import KeelModem, Send
from agents.modem.facts import FrameArrived
from agents.modem.firmware import Firmware
from agents.modem.frames import PAYLOAD_BYTES, SHORT_MS, Frame, FrameKind, Generation
from agents.outputs import PingAnswered, SoundSent, Truth, WifiSent
from agents.physical import Physical
from agents.sea_facts import (
    APAD,
    APAD_ADDRESS,
    NotRanged,
    Printed,
    Ranged,
    SeaResult,
    SoundReached,
    Told,
    address_of,
)
from agents.sea_modems import SeaModems
from agents.stimuli import PingArrived, SoundArrived
from agents.water import medium
from agents.water.chance import fates
from agents.water.medium import Began, LinksChanged, Medium, Moved, PacketEnded, ThrustersRan
from agents.water.places import Place
from agents.water.sound import Sound
from agents.water.topology import Topology
from agents.water.wifi import Wifi
from firmware_model.actions import Buoyancy
from firmware_model.rails import RAILS

_FIRMWARE = {Generation.V2: Firmware.V2, Generation.V3: Firmware.V3}
_STEP_US = 62.5
"""The modem times a round trip in these."""


@dataclass(frozen=True, slots=True)
class SeaConfig:
    """Agent time. `wifi` is None where Wi-Fi has no limits but the water."""

    seed: int
    sound: Sound
    wifi: Wifi | None
    bottom_um: int
    surfacing_ms: int
    sinking_ms: int
    keel_um: int
    """The depth of the aPad's modem."""
    range_noise_m: float
    """Standard deviation of a measured range."""
    thrusting_m_s: float
    """An aPad that moves faster than this has its thrusters running."""
    modems: Generation = Generation.V3


Happened = tuple[int, int, int, medium.Stimulus]
"""(agent time, order within it, node, what)."""


class Sea:
    """Around a coordinator, whose `advance` this one's takes the place of. Public times are mission milliseconds."""

    def __init__(
        self,
        config: SeaConfig,
        coordinator: Coordinator,
        host: Host,
        now_ms: int = 0,
        opened: Collection[int] = (),
    ) -> None:
        """`opened` are the agents whose modems somebody else may talk to: see `write`, and `Printed`."""
        self.config = config
        self.dropped: Counter[str] = Counter()
        self._coordinator = coordinator
        self._host = host
        self._theta = coordinator.theta
        start_ms = self._theta * now_ms
        nodes = [APAD, *coordinator.agent_ids]
        self._medium = Medium(
            config.sound, config.seed, [(node, address_of(node)) for node in nodes], start_ms
        )
        self.now_ms = start_ms
        self._keel = KeelModem(start_ms)
        self._modems = (
            SeaModems(
                _FIRMWARE[config.modems],
                {node: address_of(node) for node in nodes},
                opened,
                start_ms,
                self.dropped,
            )
            if opened
            else None
        )
        self._places: dict[int, Place] = {}
        self._apad_at_ms: int | None = None
        self._truths: list[Truth] = []
        self._told: list[medium.Result] = []
        """Of the medium, between two ticks."""

    def take_truths(self) -> list[Truth]:
        """The fleet's truths since the last call, of whose places the sea has taken note."""
        for truth in self._note_truths():
            place = self._places[truth.agent_id]
            self._told += self._medium.receive(Moved(truth.agent_id, place), self.now_ms)
        truths, self._truths = self._truths, []
        return truths

    def _note_truths(self) -> list[Truth]:
        new = self._host.take_truths()
        for truth in new:
            self._places[truth.agent_id] = self._place(truth.physical)
        self._truths += new
        return new

    # What the aPad does, at ticks.

    def carry_apad(self, north_m: float, east_m: float, at_ms: int) -> None:
        """The aPad is here at mission time `at_ms`, now or since the last tick."""
        place = Place(round(north_m * 1e6), round(east_m * 1e6), self.config.keel_um, in_water=True)
        before, self._places[APAD] = self._places.get(APAD), place
        if before is not None and self._apad_at_ms is not None and at_ms > self._apad_at_ms:
            metres = hypot(place.north_um - before.north_um, place.east_um - before.east_um) / 1e6
            fast = 1000 * metres > self.config.thrusting_m_s * (at_ms - self._apad_at_ms)
            self._told += self._medium.receive(ThrustersRan(APAD, fast), self.now_ms)
        self._apad_at_ms = at_ms
        self._told += self._medium.receive(Moved(APAD, place), self.now_ms)

    def say(self, agent_id: int | None, data: bytes, not_before_ms: int = 0) -> None:
        """Sends bytes by the aPad's modem, to one aMussel or to all: at that agent time, or as soon as it is free."""
        frame = self._carrying(data, APAD_ADDRESS, None if agent_id is None else address_of(agent_id))
        if frame is not None:
            self._ask(agent_id, frame, not_before_ms)

    def ping(self, agent_id: int, not_before_ms: int = 0) -> None:
        """Measures the range to an aMussel: Ranged or NotRanged comes of it."""
        ping = Frame(FrameKind.PING, APAD_ADDRESS, address_of(agent_id), generation=self.config.modems)
        self._ask(agent_id, ping, not_before_ms)

    def lay_links(self, topology: Topology) -> None:
        """Links are as the topology says from now on."""
        self._told += self._medium.receive(LinksChanged(topology), self.now_ms)

    def wifi_reaches(self, agent_id: int, now_ms: int) -> bool:
        """Whether what the aPad says to an aMussel by Wi-Fi now gets through the air."""
        return self._through_the_air(APAD, agent_id, self._theta * now_ms)

    def write(self, agent_id: int, data: bytes) -> None:
        """Whoever opened the modem wrote this to its serial line; what it prints comes as `Printed`."""
        if self._modems is None:
            raise ValueError(f"the modem of aMussel {agent_id} has not been opened")
        self._modems.write(agent_id, data)

    def _ask(self, node: int | None, frame: Frame, not_before_ms: int) -> None:
        if not self._keel.ask(node, frame, not_before_ms):
            self.dropped["sound: the aPad's modem has too much to send"] += 1

    # Rounds.

    def advance(self, now_ms: int) -> list[SeaResult]:
        """Everything up to mission time `now_ms`, in the order of the rounds (ValueError if time went back)."""
        until_ms = self._theta * now_ms
        if until_ms < self.now_ms:
            raise ValueError(f"time went back: {until_ms} before {self.now_ms}")
        results: list[SeaResult] = []
        told, self._told = self._told, []
        self._deliver(told, results)
        while True:
            horizon_ms = self._horizon(until_ms)
            whole = horizon_ms == until_ms
            came = self._coordinator.advance(now_ms) if whole else self._coordinator.grant(horizon_ms)
            self._round(came, horizon_ms, results)
            self.now_ms = horizon_ms
            if whole:
                return results

    def _horizon(self, until_ms: int) -> int:
        """The end of the next round: nothing that begins in it can act before its end."""
        horizon_ms = until_ms
        if (due_ms := self._medium.next_due_ms) is not None:
            horizon_ms = min(horizon_ms, due_ms)
        modems_ms = None if self._modems is None else self._modems.next_due_ms
        for does_ms in (self._coordinator.due_agent_ms, self._keel.next_due_ms, modems_ms):
            if does_ms is not None:
                horizon_ms = min(horizon_ms, max(does_ms, self.now_ms) + SHORT_MS[self.config.modems])
        return max(horizon_ms, self.now_ms)

    def _round(self, came: list[Heard | Died], horizon_ms: int, results: list[SeaResult]) -> None:
        """Brings what agents did in the round to the medium, in the order of time, and what that decided to agents."""
        happened: list[Happened] = []
        for truth in self._note_truths():
            moved = Moved(truth.agent_id, self._place(truth.physical))
            happened.append((truth.at_ms, 0, truth.agent_id, moved))
            if self._modems is not None:
                self._modems.power(truth.agent_id, RAILS[truth.state] != 0, truth.at_ms)
        for it in came:
            match it:
                case Heard(_, agent_id, SoundSent() | PingAnswered() as output):
                    frame = self._frame(agent_id, output)
                    if frame is not None:
                        self._send(happened, output.at_ms, agent_id, frame)
                    continue
                case Heard(_, agent_id, WifiSent(at_ms)):
                    if not self._through_the_air(agent_id, APAD, at_ms):
                        continue
                case Died(_, agent_id, gave_up=reason) if reason is not None:
                    happened.append((horizon_ms, 0, agent_id, Moved(agent_id, None)))
            results.append(it)
        for spoke in self._keel.advance(horizon_ms):
            if isinstance(spoke, Send):
                self._send(happened, spoke.at_ms, APAD, spoke.frame)
            elif spoke.node is not None:
                results.append(NotRanged(self._mission_ms(spoke.at_ms), spoke.node))
        if self._modems is not None:
            for sent in self._modems.round(horizon_ms):
                happened.append((sent.at_ms, 1, sent.node, Began(sent.node, sent.frame)))
        decided: list[medium.Result] = []
        for at_ms, _, _, stimulus in sorted(happened, key=lambda it: it[:3]):
            decided += self._medium.receive(stimulus, min(max(at_ms, self._medium.now_ms), horizon_ms))
        self._deliver(decided + self._medium.advance(horizon_ms), results)
        if self._modems is not None:
            results += [Printed(self._mission_ms(horizon_ms), *it) for it in self._modems.take_printed()]

    def _send(self, happened: list[Happened], at_ms: int, node: int, frame: Frame) -> None:
        """By the node's modem, if there are modems; otherwise straight into the water."""
        if self._modems is None:
            happened.append((at_ms, 1, node, Began(node, frame)))
        else:
            self._modems.ask(node, frame, at_ms)

    def _deliver(self, decided: list[medium.Result], results: list[SeaResult]) -> None:
        for it in decided:
            if isinstance(it, PacketEnded):
                results.append(it)
                continue
            node, at_ms, frame = it.reception.receiver, it.reception.at_ms, it.frame
            if self._modems is not None:
                arrived = FrameArrived(frame, it.reception.travelled_us, it.reception.snr_db)
                if not self._modems.hear(node, arrived, at_ms):
                    continue
            if node == APAD:
                self._hear(it, results)
                continue
            ping = frame.kind is FrameKind.PING
            stimulus = PingArrived(it.reception.travelled_us) if ping else SoundArrived(frame.data)
            agent_ms = self._coordinator.tell(node, stimulus, at_ms)
            if agent_ms is not None:
                results.append(Told(self._mission_ms(at_ms), node, agent_ms, stimulus))

    def _hear(self, heard: medium.Heard, results: list[SeaResult]) -> None:
        """At the aPad's modem."""
        at_ms, frame = heard.reception.at_ms, heard.frame
        mission_ms = self._mission_ms(at_ms)
        if frame.kind is not FrameKind.PING_REPLY:
            results.append(SoundReached(mission_ms, heard.sender, frame.data))
        elif self._keel.answered(heard.sender, at_ms):
            *_, normal = fates(self.config.seed, heard.sender, at_ms, APAD, b"range")
            metres = self.config.range_noise_m * normal
            metres += (frame.flight_us + heard.reception.travelled_us) * self.config.sound.speed_m_s / 2e6
            step_m = _STEP_US * self.config.sound.speed_m_s / 2e6
            results.append(Ranged(mission_ms, heard.sender, max(0, round(metres / step_m)) * step_m))
        else:
            self.dropped["sound: an answer to a ping that was given up"] += 1

    def _frame(self, agent_id: int, output: SoundSent | PingAnswered) -> Frame | None:
        source = address_of(agent_id)
        if isinstance(output, PingAnswered):
            modems, us = self.config.modems, output.travelled_us
            return Frame(FrameKind.PING_REPLY, source, APAD_ADDRESS, b"", modems, us)
        return self._carrying(output.data, source, APAD_ADDRESS)

    def _carrying(self, data: bytes, source: int, to: int | None) -> Frame | None:
        """A frame with these bytes, to one address or to all; None, counted, for more than a modem carries."""
        modems = self.config.modems
        fewest, most = PAYLOAD_BYTES[modems]
        if not fewest <= len(data) <= most:
            self.dropped[
                f"sound: {len(data)} bytes, and a {modems.name} modem carries {fewest} to {most}"
            ] += 1
            return None
        return Frame(FrameKind.BROADCAST if to is None else FrameKind.UNICAST, source, to, data, modems)

    def _through_the_air(self, sender: int, receiver: int, at_ms: int) -> bool:
        one, other = self._places.get(sender), self._places.get(receiver)
        if self.config.wifi is None:
            return True
        if one is None or other is None:
            return False
        metres = hypot(one.north_um - other.north_um, one.east_um - other.east_um) / 1e6
        reached = self.config.wifi.gets_through(metres, self.config.seed, sender, at_ms, receiver)
        if not reached:
            self.dropped["Wi-Fi: lost in the air"] += 1
        return reached

    def _place(self, physical: Physical) -> Place:
        config = self.config
        if physical.docked:
            return Place(physical.north_um, physical.east_um, 0)
        place = (physical.north_um, physical.east_um, physical.depth_um, physical.depth_anchor_ms)
        match physical.buoyancy:
            case Buoyancy.FLOAT:
                return Place(*place, -config.bottom_um, config.surfacing_ms, config.bottom_um)
            case Buoyancy.SINK:
                return Place(*place, config.bottom_um, config.sinking_ms, config.bottom_um)
        return Place(*place)

    def _mission_ms(self, agent_ms: int) -> int:
        return -(-agent_ms // self._theta)
