"""A fleet in its sea: advances time in rounds as fine as sound needs, and carries packets between modems.

A packet acts at its end, and the shortest packet lasts 105 ms. So an agent that acts at a time d affects nobody before
d + 105 ms. A round therefore ends at the next end of a packet under way, or 105 ms after the next action of anybody,
whichever is first; if nobody has anything to do, it ends at the tick. A receiver takes a packet in the next round,
stamped with its end. The medium takes modems' places from the fleet's truths, because it is the world, not a mission.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

from agents.coordinator import Coordinator, Died, Heard
from agents.hosting.host import Host
from agents.modem.facts import FrameArrived
from agents.modem.firmware import Firmware
from agents.modem.frames import PAYLOAD_BYTES, SHORT_MS, Frame, FrameKind, Generation
from agents.mussel.outputs import PingAnswered, SoundSent, Truth, WifiSent
from agents.mussel.stimuli import ModemSent, PingArrived, SoundArrived, Stimulus
from agents.water import medium
from agents.water.apad_modem import APadModem, Send
from agents.water.chance import fates
from agents.water.medium import Began, LinksChanged, Medium, Moved, PacketEnded, ThrustersRan
from agents.water.places import Place, along_m, place_of
from agents.water.sea_events import (
    APAD,
    APAD_ADDRESS,
    NotRanged,
    Printed,
    Ranged,
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

_FIRMWARE = {Generation.V2: Firmware.V2, Generation.V3: Firmware.V3}


@dataclass(frozen=True, slots=True)
class SeaConfig:
    """Agent time. If `wifi` is None, only the water limits Wi-Fi."""

    seed: int
    sound: Sound
    wifi: Wifi | None
    sinking: Sinking
    modems: Generation = Generation.V3


Event = tuple[int, int, int, medium.Stimulus | Heard]
"""(agent time, order within it, node, stimulus); a Heard is a Wi-Fi packet on its way to the aPad."""


class Sea:
    """The sea around a coordinator; its `advance` replaces the coordinator's. Public times are mission milliseconds."""

    def __init__(
        self,
        config: SeaConfig,
        coordinator: Coordinator,
        host: Host,
        now_ms: int = 0,
        opened: Collection[int] = (),
    ) -> None:
        """`opened` are the agents whose modems somebody else may use: see `write` and `Printed`."""
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
        self._keel = APadModem(start_ms)
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
        if self._modems is not None:
            self._modems.measure(noise_measured(config.sound.noise_db), nodes)
        self._places: dict[int, Place] = {}
        self._apad_at_ms: int | None = None
        self._truths: list[Truth] = []
        self._undelivered: list[medium.Result] = []
        """The medium's results between two ticks."""

    def take_truths(self) -> list[Truth]:
        """The fleet's truths since the last call; the sea moves the modems accordingly."""
        for truth in self._new_truths():
            self._undelivered += self._move(
                truth.agent_id, place_of(truth.physical, self.config.sinking), self.now_ms
            )
        truths, self._truths = self._truths, []
        return truths

    def _new_truths(self) -> list[Truth]:
        new = self._host.take_truths()
        self._truths += new
        return new

    def _move(self, node: int, place: Place, at_ms: int) -> list[medium.Result]:
        self._places[node] = place
        return self._medium.receive(Moved(node, place), at_ms)

    # The aPad acts at ticks.

    def carry_apad(self, north_m: float, east_m: float, at_ms: int) -> None:
        """Places the aPad at mission time `at_ms`, which is now or after the last tick."""
        place = Place(round(north_m * 1e6), round(east_m * 1e6), self.config.sound.keel_um, in_water=True)
        before = self._places.get(APAD)
        if before is not None and self._apad_at_ms is not None and at_ms > self._apad_at_ms:
            fast = 1000 * along_m(before, place) > self.config.sound.thrusting_m_s * (
                at_ms - self._apad_at_ms
            )
            self._undelivered += self._medium.receive(ThrustersRan(APAD, fast), self.now_ms)
            if self._modems is not None:
                level_db = self.config.sound.noise_db + fast * self.config.sound.thruster_noise_db
                self._modems.measure(noise_measured(level_db), [APAD])
        self._apad_at_ms = at_ms
        self._undelivered += self._move(APAD, place, self.now_ms)

    def send_sound(self, agent_id: int | None, data: bytes, not_before_ms: int = 0) -> None:
        """Sends bytes by the aPad's modem, to one aMussel or to all: at that agent time, or as soon as it is free."""
        frame = self._carrying(data, APAD_ADDRESS, None if agent_id is None else address_of(agent_id))
        if frame is not None:
            self._ask(agent_id, frame, not_before_ms)

    def ping(self, agent_id: int, not_before_ms: int = 0) -> None:
        """Measures the range to an aMussel; Ranged or NotRanged follows."""
        ping = Frame(FrameKind.PING, APAD_ADDRESS, address_of(agent_id), generation=self.config.modems)
        self._ask(agent_id, ping, not_before_ms)

    def set_topology(self, topology: Topology) -> None:
        """Replaces the topology from now on."""
        self._undelivered += self._medium.receive(LinksChanged(topology), self.now_ms)

    def wifi_reaches(self, agent_id: int, now_ms: int) -> bool:
        """True if a Wi-Fi packet that the aPad sends to an aMussel now gets through."""
        return self._through_the_air(APAD, agent_id, self._theta * now_ms)

    def write(self, agent_id: int, data: bytes) -> None:
        """Writes bytes to an opened modem's serial line; its output comes as `Printed`."""
        if self._modems is None:
            raise ValueError(f"the modem of aMussel {agent_id} has not been opened")
        self._modems.write(agent_id, data)

    def _ask(self, node: int | None, frame: Frame, not_before_ms: int) -> None:
        if not self._keel.ask(node, frame, not_before_ms):
            self.dropped["sound: the aPad's modem has too much to send"] += 1

    # Rounds.

    def advance(self, now_ms: int) -> list[SeaResult]:
        """Runs everything up to mission time `now_ms`, in the order of the rounds (ValueError if time went back)."""
        until_ms = self._theta * now_ms
        if until_ms < self.now_ms:
            raise ValueError(f"time went back: {until_ms} before {self.now_ms}")
        results: list[SeaResult] = []
        undelivered, self._undelivered = self._undelivered, []
        self._deliver(undelivered, results)
        while True:
            horizon_ms = self._horizon(until_ms)
            whole = horizon_ms == until_ms
            events = self._coordinator.advance(now_ms) if whole else self._coordinator.grant(horizon_ms)
            self._round(events, horizon_ms, results)
            self.now_ms = horizon_ms
            if whole:
                return results

    def _horizon(self, until_ms: int) -> int:
        """The end of the next round, chosen so that nothing that begins in the round acts before its end."""
        horizon_ms = until_ms
        if (due_ms := self._medium.next_due_ms) is not None:
            horizon_ms = min(horizon_ms, due_ms)
        modems_ms = None if self._modems is None else self._modems.next_due_ms
        for acts_ms in (self._coordinator.due_agent_ms, self._keel.next_due_ms, modems_ms):
            if acts_ms is not None:
                horizon_ms = min(horizon_ms, max(acts_ms, self.now_ms) + SHORT_MS[self.config.modems])
        return max(horizon_ms, self.now_ms)

    def _round(self, outputs: list[Heard | Died], horizon_ms: int, results: list[SeaResult]) -> None:
        """Brings the agents' outputs to the medium, in the order of time, and the medium's decisions to the agents."""
        events: list[Event] = []
        for truth in self._new_truths():
            moved = Moved(truth.agent_id, place_of(truth.physical, self.config.sinking))
            events.append((truth.at_ms, 0, truth.agent_id, moved))
            if self._modems is not None:
                self._modems.power(truth.agent_id, RAILS[truth.state] != 0, truth.at_ms)
        for it in outputs:
            match it:
                case Heard(_, agent_id, SoundSent() | PingAnswered() as output):
                    frame = self._frame(agent_id, output)
                    if frame is not None:
                        self._send(events, output.at_ms, agent_id, frame)
                case Heard(_, agent_id, WifiSent(at_ms)):
                    events.append((at_ms, 2, agent_id, it))
                case Died(_, agent_id, gave_up=reason) if reason is not None:
                    events.append((horizon_ms, 0, agent_id, Moved(agent_id, None)))
                    results.append(it)
                case _:
                    results.append(it)
        for action in self._keel.advance(horizon_ms):
            if isinstance(action, Send):
                self._send(events, action.at_ms, APAD, action.frame)
            elif action.node is not None:
                results.append(NotRanged(self._mission_ms(action.at_ms), action.node))
        if self._modems is not None:
            for sent in self._modems.round(horizon_ms):
                events.append((sent.at_ms, 1, sent.node, Began(sent.node, sent.frame)))
                if not sent.from_host and sent.node != APAD:
                    self._tell(sent.node, ModemSent(sent.frame.duration_ms), sent.at_ms, results)
            events += [(at_ms, 0, it.node, it) for at_ms, it in self._modems.take_readdressed()]
        self._deliver(self._apply(events, horizon_ms, results), results)
        if self._modems is not None:
            results += [Printed(self._mission_ms(horizon_ms), *it) for it in self._modems.take_printed()]

    def _apply(self, events: list[Event], horizon_ms: int, results: list[SeaResult]) -> list[medium.Result]:
        """Applies the events in the order of time. Returns the medium's decisions up to the horizon."""
        decided: list[medium.Result] = []
        for at_ms, _, node, event in sorted(events, key=lambda it: it[:3]):
            if isinstance(event, Heard):
                if self._through_the_air(node, APAD, at_ms):
                    results.append(event)
                continue
            now_ms = min(max(at_ms, self._medium.now_ms), horizon_ms)
            if isinstance(event, Moved) and event.place is not None:
                decided += self._move(node, event.place, now_ms)
            else:
                decided += self._medium.receive(event, now_ms)
        return decided + self._medium.advance(horizon_ms)

    def _send(self, events: list[Event], at_ms: int, node: int, frame: Frame) -> None:
        """Sends by the node's modem, if there are modems; otherwise straight into the water."""
        if self._modems is None:
            events.append((at_ms, 1, node, Began(node, frame)))
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
                if not self._modems.frame_arrived(node, arrived, at_ms):
                    continue
            if node == APAD:
                self._receive_at_apad(it, results)
                continue
            ping = frame.kind is FrameKind.PING
            stimulus = PingArrived(it.reception.travelled_us) if ping else SoundArrived(frame.data)
            self._tell(node, stimulus, at_ms, results)

    def _tell(self, node: int, stimulus: Stimulus, at_ms: int, results: list[SeaResult]) -> None:
        agent_ms = self._coordinator.receive_at(node, stimulus, at_ms)
        if agent_ms is not None:
            results.append(StimulusDelivered(self._mission_ms(at_ms), node, agent_ms, stimulus))

    def _receive_at_apad(self, heard: medium.Heard, results: list[SeaResult]) -> None:
        at_ms, frame = heard.reception.at_ms, heard.frame
        mission_ms = self._mission_ms(at_ms)
        if frame.kind is not FrameKind.PING_REPLY:
            results.append(SoundReached(mission_ms, heard.sender, frame.data))
        elif self._keel.answered(heard.sender, at_ms):
            *_, normal = fates(self.config.seed, heard.sender, at_ms, APAD, b"range")
            round_trip_us, off_m = (
                frame.flight_us + heard.reception.travelled_us,
                self.config.sound.range_noise_m * normal,
            )
            range_m = self.config.sound.range_m(round_trip_us, off_m)
            results.append(Ranged(mission_ms, heard.sender, range_m))
        else:
            self.dropped["sound: an answer to a ping that was given up"] += 1

    def _frame(self, agent_id: int, output: SoundSent | PingAnswered) -> Frame | None:
        source = address_of(agent_id)
        if isinstance(output, PingAnswered):
            modems, us = self.config.modems, output.travelled_us
            return Frame(FrameKind.PING_REPLY, source, APAD_ADDRESS, b"", modems, us)
        return self._carrying(output.data, source, APAD_ADDRESS)

    def _carrying(self, data: bytes, source: int, to: int | None) -> Frame | None:
        """A frame with these bytes, to one address or to all; None, counted, if a modem cannot carry them."""
        modems = self.config.modems
        fewest, most = PAYLOAD_BYTES[modems]
        if not fewest <= len(data) <= most:
            self.dropped[f"sound: not the {fewest} to {most} bytes that a {modems.name} modem carries"] += 1
            return None
        return Frame(FrameKind.BROADCAST if to is None else FrameKind.UNICAST, source, to, data, modems)

    def _through_the_air(self, sender: int, receiver: int, at_ms: int) -> bool:
        one, other = self._places.get(sender), self._places.get(receiver)
        if self.config.wifi is None:
            return True
        if one is None or other is None:
            return False
        reached = self.config.wifi.gets_through(
            along_m(one, other), self.config.seed, sender, at_ms, receiver
        )
        if not reached:
            self.dropped["Wi-Fi: lost in the air"] += 1
        return reached

    def _mission_ms(self, agent_ms: int) -> int:
        return -(-agent_ms // self._theta)
