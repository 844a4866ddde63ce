"""One flight: the loop that lets mission time pass tick by tick for the fleet, the vehicle, the supervisor and the records.

At each tick: the agents are granted time up to it, the vehicle tells what became true, the world's contacts go to the
bodies, the supervisor acts, and what it says goes out, to be met in the next window. Nothing else moves anything.

The docks' contacts as the bodies feel them: closing, being carried, opening. The world's business, not the mission's.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import astuple

from agents.coordinator import Died, Heard
from agents.mussel.outputs import Dropped, SoundSent, WifiSent
from agents.mussel.stimuli import (
    ContactClosed,
    ContactOpened,
    DockMoved,
    SoundArrived,
    Stimulus,
    WifiArrived,
    to_wire,
)
from agents.packet_medium import Medium
from agents.water.medium import PacketEnded
from agents.water.sea_events import NotRanged, Ranged, SeaResult, SoundReached, Told
from apad_bridge.mission.events import (
    KeepSamples,
    OperatorAsked,
    Ping,
    RangeHeard,
    Send,
    SoundHeard,
    WifiHeard,
)
from apad_bridge.mission.orders import Note
from apad_bridge.supervisor.clock import StopSign
from apad_bridge.supervisor.context import FlightContext, Watcher
from apad_bridge.supervisor.core import TICK_MS, Supervisor
from apad_bridge.supervisor.fleet import Fleet
from apad_bridge.supervisor.packet_notes import packet_data
from apad_bridge.supervisor.packet_relay import Felt
from apad_bridge.supervisor.recorder_interface import Recorder
from apad_bridge.vehicle.commands import CloseDock, OpenDock, PoseReported
from apad_bridge.vehicle.link import APadSeen, Carried, LetGo
from firmware_model.packets.wire import EVERYONE


class Contacts:
    """Remembers where each docked aMussel was last carried, so that only what changes is told."""

    def __init__(self, held: Iterable[int] = ()) -> None:
        self._places: dict[int, tuple[int, int] | None] = dict.fromkeys(held)
        """By agent; None for one that was docked before anything was told here."""

    def take(self, fact: Carried | LetGo) -> Stimulus | None:
        """The stimulus that the aMussel's body gets; None when nothing changed for it."""
        if isinstance(fact, LetGo):
            if fact.agent_id not in self._places:
                return None
            del self._places[fact.agent_id]
            return ContactOpened()
        place = (round(fact.north_m * 1e6), round(fact.east_m * 1e6))
        if fact.agent_id not in self._places:
            self._places[fact.agent_id] = place
            return ContactClosed(*place)
        before, self._places[fact.agent_id] = self._places[fact.agent_id], place
        return DockMoved(*place) if place != before else None


_ROUNDS = 8
"""More answers than this within one tick wait for the next."""


class Flight:
    """Flies from `start_ms` to the mission's end, in its surroundings; `watchers` come after those of the surroundings.

    `stop` may be called from a signal handler or another thread.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        context: FlightContext,
        recorder: Recorder,
        start_ms: int = 0,
        watchers: tuple[Watcher, ...] = (),
    ) -> None:
        self.supervisor = supervisor
        self.dropped: Counter[str] = Counter()
        self.now_ms = start_ms
        self._around = context
        self._vehicle = context.vehicle
        self._recorder = recorder
        self._fleet = context.fleet
        self._relay = context.relay
        self._serial_lines = context.serial_lines
        self._roster = context.roster
        self._came: list[SeaResult] = []
        """Of the fleet, between two ticks."""
        self._come_ms = start_ms - 1
        self._watchers = (*context.watchers(supervisor), self._tell_noticed, *watchers)
        self._contacts = Contacts(context.held)
        self._stopped = StopSign()
        self._stop_reason = "the operator"

    @property
    def all_dropped(self) -> Counter[str]:
        """What came to nothing anywhere in the flight, by reason."""
        supervisor = self.supervisor
        dropped = self.dropped + supervisor.dropped + supervisor.port.dropped + supervisor.ranging_dropped
        dropped += self._around.dropped()
        return dropped if self._fleet is None else dropped + self._fleet.dropped

    def stop(self, reason: str) -> None:
        self._stop_reason = reason
        self._stopped.set()

    def run(self) -> str:
        """Flies until the mission has ended; gives the reason."""
        while not self.step():
            pass
        return self.ended_by

    @property
    def ended_by(self) -> str:
        return self.supervisor.mission.state.ended_by or ""

    def step(self) -> bool:
        """The next tick, when it has come; whether the mission has ended with it."""
        self._around.pace.reach(
            self.now_ms, self._stopped, None if self._serial_lines is None else self._between
        )
        self.tick(self.now_ms)
        if self.supervisor.has_ended:
            return True
        self.now_ms += TICK_MS
        return False

    def tick(self, now_ms: int) -> None:
        """One tick of mission time: everything stamped up to `now_ms` is handled."""
        self._hear_fleet(now_ms)
        self._hear_modem(now_ms)
        self._hear_vehicle(now_ms)
        self._hear_relay(now_ms)
        if self._stopped.is_set():
            self.supervisor.receive(OperatorAsked(now_ms, self._stop_reason))
        for _ in range(_ROUNDS):
            if not self._act(now_ms):
                break
            self._hear_vehicle(now_ms)
        # Last: what was heard up to now is believed, whoever said it.
        self._apply_requests(now_ms)
        supervisor = self.supervisor
        self._recorder.tick(
            now_ms,
            supervisor.beliefs.all(),
            supervisor.pose,
            supervisor.battery,
            supervisor.primitive,
            supervisor.mission.docks,
        )
        if self._roster is not None:
            self._roster.answer()
        for watch in self._watchers:
            watch(now_ms)

    def _tell_noticed(self, now_ms: int) -> None:
        for kind, data in self._around.noticed(now_ms):
            self._recorder.event(now_ms, kind, **data)

    def _act(self, now_ms: int) -> bool:
        """Lets the supervisor act, and passes on what it says; whether a docking mechanism was commanded.

        A mechanism answers within the tick in which it is commanded, so that docking takes the scenario's time and not a
        tick more.
        """
        mechanism = False
        for action in self.supervisor.advance(now_ms):
            match action:
                case Note(kind, data):
                    self._recorder.event(now_ms, kind, **data)
                case Send(Medium.SOUND, agent_id, data) if (
                    self._serial_lines is not None and self._serial_lines.command(agent_id, data, now_ms)
                ):
                    pass
                case KeepSamples(agent_id, records):
                    self._recorder.samples(agent_id, records)
                case Send(medium, agent_id, data) as send:
                    if self._fleet is None and self._relay is not None:
                        self._relay.transmit(medium, agent_id, data, now_ms)
                    else:
                        if agent_id not in self.supervisor.allocation.served_for_others:
                            self._send(send, now_ms)
                        if self._relay is not None:
                            self._relay.said(send, now_ms)
                case Ping(agent_id, not_before_ms):
                    if self._fleet is not None and self._fleet.sea is not None:
                        self._fleet.sea.ping(agent_id, not_before_ms)
                    else:
                        self.dropped["a ping without water to send it through"] += 1
                case _:
                    mechanism |= isinstance(action, CloseDock | OpenDock)
                    self._vehicle.command(action, now_ms)
        return mechanism

    def _between(self, now_ms: int) -> None:
        """A time before the next tick has come: only who talks to a serial line notices."""
        if now_ms > self._come_ms:
            self._came += self._live(now_ms)

    def _live(self, now_ms: int) -> list[SeaResult]:
        """Lets the fleet's time pass, and reads and writes the serial lines."""
        self._come_ms = now_ms
        written = [] if self._serial_lines is None else self._serial_lines.poll(now_ms)
        if self._fleet is None:
            return []
        for burst in written:
            if self._fleet.sea is not None:
                self._fleet.sea.write(burst.agent_id, burst.data)
        came, serial_lines = self._fleet.advance(now_ms), self._serial_lines
        return (
            list(came) if serial_lines is None else [it for it in came if not serial_lines.took(it, now_ms)]
        )

    def _hear_modem(self, now_ms: int) -> None:
        """What a physical modem has brought, or has sent."""
        for came in [] if self._serial_lines is None else self._serial_lines.take():
            match came:
                case SoundHeard():
                    self.supervisor.receive(came)
                case Send(_, agent_id, data) if self._fleet is not None:
                    ids = self._fleet.coordinator.agent_ids if agent_id == EVERYONE else [agent_id]
                    for each in ids:
                        self._tell_agent(each, SoundArrived(data), now_ms)
                case Note(kind, told):
                    self._recorder.event(now_ms, kind, **told)
                    if "dropped" in told:
                        self.dropped[told["dropped"]] += 1

    def _hear_fleet(self, now_ms: int) -> None:
        if self._fleet is None:
            self._live(now_ms)
            return
        self._look_at_links(self._fleet, now_ms)
        came_before, self._came = self._came, []
        for came in [*came_before, *self._live(now_ms)]:
            match came:
                case Died(_, agent_id, agent_ms, cause, reason, gave_up):
                    self._recorder.event(
                        now_ms,
                        "died",
                        id=agent_id,
                        agent_ms=agent_ms,
                        cause=cause.name,
                        reason=reason,
                        gave_up=gave_up,
                    )
                case Heard(at_ms, agent_id, WifiSent(_, data)):
                    self.supervisor.receive(WifiHeard(at_ms, data))
                    self._allocation(Medium.WIFI, agent_id, data, at_ms)
                case Heard(at_ms, agent_id, SoundSent(_, data)):
                    self.supervisor.receive(SoundHeard(at_ms, data))
                    self._allocation(Medium.SOUND, agent_id, data, at_ms)
                case Heard(_, _, Dropped(_, reason)):
                    self.dropped[reason] += 1
                case SoundReached(at_ms, agent_id, data):
                    self.supervisor.receive(SoundHeard(at_ms, data))
                    self._allocation(Medium.SOUND, agent_id, data, at_ms)
                case Ranged(at_ms, agent_id, range_m):
                    self.supervisor.receive(RangeHeard(at_ms, agent_id, range_m))
                    self._recorder.event(now_ms, "range", id=agent_id, range_m=round(range_m, 3))
                case NotRanged(at_ms, agent_id):
                    self.supervisor.receive(RangeHeard(at_ms, agent_id, None))
                    self._recorder.event(now_ms, "range", id=agent_id, range_m=None)
                case Told(_, agent_id, agent_ms, stimulus):
                    self._note_stimulus(now_ms, agent_id, agent_ms, stimulus)
                case PacketEnded() as packet:
                    self._note_packet(self._fleet, packet, now_ms)
        self._recorder.truths(self._fleet.take_truths())

    def _note_packet(self, fleet: Fleet, packet: PacketEnded, now_ms: int) -> None:
        assert fleet.sea is not None  # where else would it come from
        data = packet_data(packet, fleet.timeslots, fleet.sea.config.sound.speed_m_s)
        self._recorder.event(now_ms, "packet", **data)

    def _look_at_links(self, fleet: Fleet, now_ms: int) -> None:
        changed = None if fleet.links is None else fleet.links.look()
        if changed is None or fleet.sea is None:
            return
        if changed.topology is not None:
            fleet.sea.lay_links(changed.topology)
        rules = None if changed.topology is None else [list(astuple(it)) for it in changed.topology.rules]
        self._recorder.event(now_ms, "links", rules=rules, problem=changed.problem)

    def _allocation(self, medium: Medium, agent_id: int, data: bytes, at_ms: int) -> None:
        if self._relay is not None:
            self._relay.transmit(medium, agent_id, data, at_ms)

    def _hear_relay(self, now_ms: int) -> None:
        if self._relay is None:
            return
        for came in self._relay.advance(now_ms):
            if isinstance(came, Send):
                word = self.supervisor.timed(came, now_ms)
                if word is not None:
                    self._send(word, now_ms)
            elif isinstance(came, Felt):
                self._tell_agent(came.agent_id, came.stimulus, now_ms)
            else:
                self.supervisor.receive(came)

    def _apply_requests(self, now_ms: int) -> None:
        """Who is simulated, and who is not any more."""
        if self._roster is None or self._fleet is None:
            return
        for done in self._roster.advance(self._fleet.coordinator, self.supervisor.beliefs, now_ms):
            if isinstance(done, Note):
                self._recorder.event(now_ms, done.kind, **done.data)
            else:
                self._tell_agent(*done, now_ms)

    def _send(self, send: Send, now_ms: int) -> None:
        sea = None if self._fleet is None else self._fleet.sea
        if sea is not None and send.medium is Medium.SOUND:
            sea.say(None if send.agent_id == EVERYONE else send.agent_id, send.data, send.not_before_ms)
            return
        if sea is not None and not sea.wifi_reaches(send.agent_id, now_ms):
            return
        arrived = SoundArrived(send.data) if send.medium is Medium.SOUND else WifiArrived(send.data)
        self._tell_agent(send.agent_id, arrived, now_ms)

    def _hear_vehicle(self, now_ms: int) -> None:
        sea = None if self._fleet is None else self._fleet.sea
        for fact in self._vehicle.advance(now_ms):
            if sea is not None and isinstance(fact, PoseReported | APadSeen):
                sea.carry_apad(fact.north_m, fact.east_m, fact.at_ms)
            if isinstance(fact, APadSeen):
                continue
            if isinstance(fact, (Carried, LetGo)):
                stimulus = self._contacts.take(fact)
                if stimulus is None:
                    continue
                tell_served_elsewhere = self._around.tell_served_elsewhere
                if (
                    tell_served_elsewhere is not None
                    and fact.agent_id in self.supervisor.allocation.served_for_others
                ):
                    tell_served_elsewhere(Felt(fact.agent_id, stimulus), now_ms)
                else:
                    self._tell_agent(fact.agent_id, stimulus, now_ms)
            else:
                self.supervisor.receive(fact)

    def _tell_agent(self, agent_id: int, stimulus: Stimulus, now_ms: int) -> None:
        if self._fleet is None:
            return
        agent_ms = self._fleet.coordinator.receive(agent_id, stimulus, now_ms)
        if agent_ms is None:
            self.dropped["for an aMussel that is not of this fleet"] += 1
            return
        self._note_stimulus(now_ms, agent_id, agent_ms, stimulus)

    def _note_stimulus(self, now_ms: int, agent_id: int, agent_ms: int, stimulus: Stimulus) -> None:
        wire = [field.hex() if isinstance(field, bytes) else field for field in to_wire(stimulus)]
        self._recorder.event(now_ms, "stimulus", id=agent_id, agent_ms=agent_ms, wire=wire)
