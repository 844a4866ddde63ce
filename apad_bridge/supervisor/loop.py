"""Runs one flight: advances fleet, vehicle, supervisor and records through mission time, tick by tick.

At each tick the agents are granted time up to it, the vehicle reports facts, the docks' contacts go to the bodies, the
supervisor acts, and its packets and commands go out; the agents receive them in the next window. Nothing else moves
anything.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import astuple

from agents.coordinator import AgentDied
from agents.mussel.outputs import SoundSent, StateDoubted, StimulusDropped, WifiSent
from agents.mussel.stimuli import AgentStimulus, SoundArrived, to_json
from agents.packet_medium import Medium
from agents.time_scale import TICK_MS, MissionMs
from agents.water.medium import PacketEnded
from agents.water.sea_events import (
    AgentRanged,
    LeftWater,
    NotRanged,
    SeaLost,
    SeaResult,
    SoundReached,
    StimulusDelivered,
)
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import (
    APadLeftWater,
    PresenceChanged,
    ProcessDied,
    StateDisbelieved,
    Stimulated,
)
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.events.sound_events import LinksRead, ModemReported, RangeMeasured
from apad_bridge.mission.facts import (
    AMusselHeard,
    EndRequested,
    KeepSamples,
    Ping,
    RangeHeard,
    SampleSource,
    Send,
    SupervisorAction,
)
from apad_bridge.mission.orders import StopVehicle, VehicleOrder
from apad_bridge.supervisor.clock import StopSign
from apad_bridge.supervisor.context import FlightContext, Watcher
from apad_bridge.supervisor.packet_relay import RemoteContact
from apad_bridge.supervisor.recorder_interface import FlightRecorder
from apad_bridge.supervisor.supervisor import Supervisor
from apad_bridge.vehicle.commands import CloseDock, OpenDock, PoseReported
from apad_bridge.vehicle.guards.guarded_vehicle import GuardedVehicle
from apad_bridge.vehicle.vehicle_link import APadSeen, Carried, LetGo
from firmware_model.packets.wire import EVERYONE

_ROUNDS = 8
"""Rounds of acting within one tick; further answers wait for the next tick."""


class Flight:
    """Flies from `start_ms` to the mission's end in its context; `watchers` are called after the context's watchers.

    `stop` may be called from a signal handler or another thread.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        context: FlightContext,
        recorder: FlightRecorder,
        start_ms: MissionMs,
        watchers: tuple[Watcher, ...] = (),
    ) -> None:
        self.supervisor = supervisor
        self.dropped: Counter[str] = Counter()
        self.now_ms = start_ms
        self._context = context
        obeys_speed = context.capabilities is None or context.capabilities.obeys_speed
        self._world = context.world
        faulty = self._world.faults.behind(context.vehicle)
        self._vehicle = GuardedVehicle(faulty, context.safety, obeys_speed=obeys_speed)
        self._recorder = recorder
        self._fleet = self._world.fleet
        self._water = self._fleet.water
        self._relay = context.relay
        self._serial_lines = context.serial_lines
        self._fleet_results: list[SeaResult] = []
        """Results of the fleet between two ticks."""
        self._fleet_ms = start_ms - 1
        self._watchers = (*context.watchers(supervisor), self._record_noticed, *watchers)
        self._stopped = StopSign()
        self._stop_end = MissionEnd(EndReason.OPERATOR)

    @property
    def all_dropped(self) -> Counter[str]:
        """The counts of everything that was dropped in the flight, by reason."""
        supervisor = self.supervisor
        dropped = self.dropped + supervisor.dropped + supervisor.port.dropped + supervisor.ranging_dropped
        return dropped + self._context.dropped() + self._fleet.dropped

    def stop_serving(self, agent_id: int) -> None:
        """Leaves the aMussel to another aPad from now on; what waits to be sent to it by sound is dropped."""
        self.supervisor.stop_serving(agent_id)
        self._water.cancel_sends(agent_id)

    def stop(self, end: MissionEnd) -> None:
        self._stop_end = end
        self._stopped.set()

    def end_at_once(self, end: MissionEnd) -> None:
        """Ends the mission at the tick that the flight waits for, which its clock does not reach."""
        self.stop(end)
        self.tick(self.now_ms)
        self._water.leave()

    def run(self) -> MissionEnd:
        """Flies until the mission has ended; returns its end."""
        while not self.step():
            pass
        return self.ended_by

    @property
    def ended_by(self) -> MissionEnd:
        """The mission's end; only after it has ended."""
        end = self.supervisor.mission.state.end
        assert end is not None
        return end

    def step(self) -> bool:
        """Waits for the next tick and runs it; True if the mission has ended with it."""
        needs_between = self._serial_lines.any_open or self._context.safety.needs_person
        between = self._between if needs_between else None
        self._context.pace.reach(self.now_ms, self._stopped, between)
        self.tick(self.now_ms)
        if self.supervisor.has_ended:
            self._water.leave()
            return True
        self.now_ms = MissionMs(self.now_ms + TICK_MS)
        return False

    def tick(self, now_ms: MissionMs) -> None:
        """Runs one tick of mission time: handles everything stamped up to `now_ms`."""
        self._receive_from_fleet(now_ms)
        self._receive_from_modem(now_ms)
        self._receive_from_vehicle(now_ms)
        self._receive_from_relay(now_ms)
        if self._stopped.is_set():
            self.supervisor.receive(EndRequested(now_ms, self._stop_end))
        for _ in range(_ROUNDS):
            if not self._act(now_ms):
                break
            self._receive_from_vehicle(now_ms)
        supervisor = self.supervisor
        self._relay.repeat_contacts(supervisor.beliefs.get, now_ms)
        # Last: packets received up to now are believed, whatever their sender becomes.
        self._apply_requests(now_ms)
        self._recorder.tick(
            now_ms,
            supervisor.beliefs.all(),
            supervisor.pose,
            supervisor.battery,
            supervisor.primitive,
            supervisor.mission.docks,
            lambda: self.all_dropped,
        )
        self._world.roster.answer()
        for watch in self._watchers:
            watch(now_ms)

    def _record_noticed(self, now_ms: MissionMs) -> None:
        noticed = (*self._vehicle.gate.take_events(), *self._context.take_events(now_ms))
        for event in noticed:
            self._recorder.event(now_ms, event)
        if noticed:
            # The next tick, with its own write, may be far: a stop can let mission time stand.
            self._context.flush_records()

    def _act(self, now_ms: MissionMs) -> bool:
        """Lets the supervisor act, and passes its actions on; True if a docking mechanism was commanded.

        A mechanism answers within the tick in which it is commanded, so that docking takes the scenario's time and not a
        tick more.
        """
        actions = iter(self.supervisor.advance(now_ms))
        try:
            return self._carry_out(actions, now_ms)
        except Exception:
            # A person's stop must not be lost because the journal could not take a line before it.
            for action in actions:
                if isinstance(action, StopVehicle):
                    action.give(self._vehicle, now_ms)
            raise

    def _carry_out(self, actions: Iterator[SupervisorAction], now_ms: MissionMs) -> bool:
        mechanism_commanded = False
        for action in actions:
            match action:
                case Event():
                    self._recorder.event(now_ms, action)
                case VehicleOrder():
                    action.give(self._vehicle, now_ms)
                    if isinstance(action, StopVehicle):
                        self._keep_stops(now_ms)
                case Send(Medium.SOUND, agent_id, data) if self._serial_lines.command(agent_id, data, now_ms):
                    pass
                case KeepSamples(agent_id, samples):
                    self._recorder.samples(agent_id, samples)
                case Send(Medium.SOUND) as send if self._water.has_others:
                    self._send(send, now_ms)
                case Send() as send:
                    if send.agent_id not in self.supervisor.allocation.served_for_others:
                        self._send(send, now_ms)
                    self._relay.forward(send, now_ms)
                case Ping(agent_id) if self._world.roster.is_real(agent_id):
                    self._relay.ping(agent_id, now_ms)
                case Ping(agent_id, not_before_ms):
                    self._water.ping(agent_id, not_before_ms)
                case _:
                    mechanism_commanded |= isinstance(action, CloseDock | OpenDock)
                    self._vehicle.command(action, now_ms)
        return mechanism_commanded

    def _between(self, now_ms: MissionMs) -> None:
        """Advances the fleet to a time before the next tick, for the serial lines' sake, and looks at a real vehicle."""
        if self._serial_lines.any_open and now_ms > self._fleet_ms:
            self._fleet_results += self._advance_fleet(now_ms)
        self._vehicle.look_between(now_ms)
        self._keep_stops(now_ms)

    def _keep_stops(self, now_ms: MissionMs) -> None:
        """Journals a real vehicle's stop as soon as it has left: whoever resumes the run has to know it."""
        if not self._context.safety.needs_person or not (events := self._vehicle.gate.take_events()):
            return
        for event in events:
            self._recorder.event(now_ms, event)
        self._context.flush_records()

    def _advance_fleet(self, now_ms: MissionMs) -> list[SeaResult]:
        """Advances the fleet's time, and reads and writes the serial lines."""
        self._fleet_ms = now_ms
        for burst in self._serial_lines.poll(now_ms):
            self._water.write(burst.agent_id, burst.data)
        results = self._water.advance(now_ms)
        if not self._serial_lines.any_open:
            return list(results)
        return [it for it in results if not self._serial_lines.route(it, now_ms)]

    def _receive_from_modem(self, now_ms: MissionMs) -> None:
        """Handles packets that a physical modem has received or sent."""
        for item in self._serial_lines.take():
            match item:
                case AMusselHeard():
                    self.supervisor.receive(item)
                case Send(_, agent_id, data):
                    ids = self._fleet.ids if agent_id == EVERYONE else [agent_id]
                    for each in ids:
                        self._stimulate(each, SoundArrived(data), now_ms)
                case ModemReported(dropped):
                    self._recorder.event(now_ms, item)
                    if dropped is not None:
                        self.dropped[dropped] += 1

    def _receive_from_fleet(self, now_ms: MissionMs) -> None:
        self._update_links(now_ms)
        results_before, self._fleet_results = self._fleet_results, []
        for result in [*results_before, *self._advance_fleet(now_ms)]:
            match result:
                case AgentDied(_, agent_id, agent_ms, cause, reason, gave_up):
                    self._recorder.event(now_ms, ProcessDied(agent_id, agent_ms, cause.name, reason, gave_up))
                    self._world.faults.restarted(agent_id)
                    if gave_up is not None and (why := self._fleet.lost) is not None:
                        self.stop(why)
                case WifiSent(sent_ms, agent_id, data):
                    self._receive_packet(Medium.WIFI, agent_id, data, self._fleet.mission_ms(sent_ms))
                case SoundSent(sent_ms, agent_id, data):
                    self._receive_packet(Medium.SOUND, agent_id, data, self._fleet.mission_ms(sent_ms))
                case StimulusDropped(_, _, reason):
                    self.dropped[reason] += 1
                case StateDoubted(_, agent_id, reason):
                    self._recorder.event(now_ms, StateDisbelieved(agent_id, reason))
                case SoundReached(_, agent_id, _) if self._world.roster.is_muted(agent_id):
                    self.dropped["sound: from a simulated aMussel whose id is real or retired by now"] += 1
                case SoundReached(at_ms, agent_id, data) if self._water.has_others:
                    # Each aPad in the water hears for itself, so nothing is relayed.
                    if self.supervisor.allocation.concerns(agent_id):
                        self.supervisor.receive(AMusselHeard(Medium.SOUND, at_ms, data))
                    else:
                        self.dropped["sound: from another aPad or one of its aMussels"] += 1
                case SoundReached(at_ms, agent_id, data):
                    self._receive_packet(Medium.SOUND, agent_id, data, at_ms)
                case AgentRanged(at_ms, agent_id, range_m) if not self._world.roster.is_muted(agent_id):
                    self._receive_range(RangeHeard(at_ms, agent_id, range_m), now_ms)
                case AgentRanged(at_ms, agent_id) | NotRanged(at_ms, agent_id):
                    self._receive_range(RangeHeard(at_ms, agent_id, None), now_ms)
                case StimulusDelivered(_, agent_id, agent_ms, stimulus):
                    self._note_stimulus(now_ms, agent_id, agent_ms, stimulus)
                case PacketEnded() as packet:
                    self._recorder.event(now_ms, self._fleet.packet_event(packet))
                case LeftWater(_, name, reason):
                    self._recorder.event(now_ms, APadLeftWater(name, reason))
                case SeaLost(_, reason):
                    self.stop(MissionEnd(EndReason.SEA_LOST, f"{EndReason.SEA_LOST}: {reason}"))
        truths = self._water.take_truths()
        self._world.contacts.see(truths)
        self._recorder.truths(truths)

    def _receive_packet(self, medium: Medium, agent_id: int, data: bytes, at_ms: MissionMs) -> None:
        self.supervisor.receive(AMusselHeard(medium, at_ms, data))
        self._relay.transmit(medium, agent_id, data, at_ms)

    def _update_links(self, now_ms: MissionMs) -> None:
        if (changed := self._fleet.update_links()) is None:
            return
        rules = None if changed.topology is None else [astuple(it) for it in changed.topology.rules]
        self._recorder.event(now_ms, LinksRead(rules, changed.problem))

    def _receive_from_relay(self, now_ms: MissionMs) -> None:
        for item in self._relay.advance(now_ms):
            if isinstance(item, Send):
                for send in self.supervisor.send(item, now_ms):
                    self._send(send, now_ms)
            elif isinstance(item, RemoteContact):
                self._stimulate(item.agent_id, item.stimulus, now_ms)
            elif isinstance(item, RangeHeard):
                self._receive_range(item, now_ms)
            else:
                self.supervisor.receive(item)

    def _receive_range(self, heard: RangeHeard, now_ms: MissionMs) -> None:
        self.supervisor.receive(heard)
        range_m = None if heard.range_m is None else round(heard.range_m, 3)
        self._recorder.event(now_ms, RangeMeasured(heard.agent_id, range_m))

    def _apply_requests(self, now_ms: MissionMs) -> None:
        """Applies requests to make aMussels simulated, real or retired; begins and ends faults."""
        beliefs, is_simulated = self.supervisor.beliefs, self._world.roster.is_simulated
        held = frozenset(dict(self.supervisor.mission.state.docked).values())
        asked = self._world.roster.advance(beliefs, now_ms, held, self.supervisor.allocation.served_elsewhere)
        for action in [*asked, *self._world.faults.advance(now_ms, beliefs, is_simulated)]:
            if isinstance(action, Event):
                self._recorder.event(now_ms, action)
                if isinstance(action, PresenceChanged):
                    self.supervisor.presence_changed(action.id)
                    self.supervisor.samples.change_board(SampleSource.after(action, now_ms))
            else:
                self._stimulate(*action, now_ms)

    def _send(self, send: Send, now_ms: MissionMs) -> None:
        if (stimulus := self._fleet.send(send, now_ms)) is not None:
            self._stimulate(send.agent_id, stimulus, now_ms)

    def _receive_from_vehicle(self, now_ms: MissionMs) -> None:
        for fact in self._vehicle.advance(now_ms):
            if isinstance(fact, PoseReported | APadSeen):
                self._water.carry_apad(fact.north_m, fact.east_m, MissionMs(fact.at_ms))
            if isinstance(fact, APadSeen):
                continue
            if isinstance(fact, (Carried, LetGo)):
                if (stimulus := self._world.contacts.take(fact)) is None:
                    continue
                self._relay.send_contact(RemoteContact(fact.agent_id, stimulus), now_ms)
                if fact.agent_id not in self.supervisor.allocation.served_for_others:
                    self._stimulate(fact.agent_id, stimulus, now_ms)
            else:
                self.supervisor.receive(fact)

    def _stimulate(self, agent_id: int, stimulus: AgentStimulus, now_ms: MissionMs) -> None:
        if (agent_ms := self._fleet.receive(agent_id, stimulus, now_ms)) is not None:
            self._note_stimulus(now_ms, agent_id, agent_ms, stimulus)

    def _note_stimulus(
        self, now_ms: MissionMs, agent_id: int, agent_ms: int, stimulus: AgentStimulus
    ) -> None:
        self._recorder.event(now_ms, Stimulated(agent_id, agent_ms, to_json(stimulus)))
