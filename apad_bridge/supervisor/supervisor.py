"""The supervisor's pure core: takes facts, keeps beliefs, advances the mission at ticks, returns commands and packets."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass

from agents.packet_medium import Medium, medium_of
from agents.time_scale import MissionMs
from apad_bridge.acoustics.ranging import RangingService
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.beliefs.measurement import Docked, Permitted, Released
from apad_bridge.events.event import Event
from apad_bridge.events.fleet_events import AMusselSuspected, SuspicionOver
from apad_bridge.events.mission_events import MissionEnd, Phase, PrimitiveChanged, PrimitivePhase, Stuck
from apad_bridge.events.person_events import Steering
from apad_bridge.events.run_events import EndReason
from apad_bridge.events.sound_events import SamplesGone
from apad_bridge.events.vehicle_events import DocksDisagree
from apad_bridge.mission.docking.dock_witnesses import ON_BOTTOM
from apad_bridge.mission.facts import (
    AMusselHeard,
    EndRequested,
    Fact,
    KeepSamples,
    RangeHeard,
    Send,
    StandDownRequested,
    SupervisorAction,
)
from apad_bridge.mission.flight_mission import MissionRole
from apad_bridge.mission.orders import (
    MissionAction,
    PermitSurfacing,
    PingAgent,
    SendCommand,
    VehicleOrder,
)
from apad_bridge.mission.sources import Allocation
from apad_bridge.mission.stand_down_rule import StandDownRule
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.forecast import Forecast, Forecaster
from apad_bridge.supervisor.sample_collection import NoSampleCollection, SampleCollection
from apad_bridge.vehicle.commands import (
    PRIMITIVE_NAMES,
    Arrived,
    BatteryReported,
    CloseDock,
    CommandAccepted,
    CommandedByOthers,
    CommandFailed,
    DockClosed,
    DockOpened,
    DocksNamed,
    GoalOfOthers,
    GoTo,
    Hold,
    OpenDock,
    PilotReported,
    PoseReported,
    Primitive,
    VehicleCommand,
)
from apad_bridge.vehicle.docking_port import DockingPort
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.guards.guarded_orders import Surfacing
from apad_bridge.vehicle.guards.stops import StopRecord
from apad_bridge.vehicle.outcomes import (
    DockChanged,
    NothingCaught,
    Outcome,
    PrimitiveEnded,
    PrimitiveFailed,
)
from firmware_model.packets import (
    CommandPacket,
    Kind,
    LogRecords,
    ShortStatus,
    StatusPacket,
)
from firmware_model.packets.codec import Codec

_PRIORITY: dict[type, int] = {
    DockClosed: 0,
    DockOpened: 0,
    PoseReported: 1,
    BatteryReported: 1,
    CommandAccepted: 2,
    Arrived: 2,
    CommandFailed: 2,
    CommandedByOthers: 2,
    PilotReported: 2,
    GoalOfOthers: 2,
    DocksNamed: 2,
    AMusselHeard: 3,
    RangeHeard: 3,
    EndRequested: 4,
    StandDownRequested: 4,
}


@dataclass(frozen=True, slots=True)
class LearnedState:
    """The state that a supervisor learns, and that the next supervisor of the run continues with."""

    beliefs: FleetBeliefs
    ranging: RangingService | None
    """None for an aPad without water, or without a modem in it: its packets go out at once, and it pings nobody."""
    allocation: Allocation
    """The aMussels that the aPad serves, over these beliefs."""


class Supervisor:
    """Supervises one aPad in mission time. `receive` only keeps a fact; `advance`, called at ticks, acts on all due facts.

    Facts of one tick are handled in the order (time, kind, arrival), so that their interleaving does not matter.
    """

    def __init__(
        self,
        scenario: Scenario,
        learned: LearnedState,
        mission: MissionRole,
        port: DockingPort,
        codec: Codec,
        samples: SampleCollection | NoSampleCollection,
        stands_down: StandDownRule,
        gate: Gate,
    ) -> None:
        """`stands_down` says when this aPad leaves its aMussels to others, instead of trying again, or ending.

        `gate` is the vehicle's. It judges permissions to surface too, and says which readings of the battery count.
        """
        self.beliefs = learned.beliefs
        self.allocation = learned.allocation
        self._stands_down = stands_down
        self._gate = gate
        self.mission = mission
        self.port = port
        self.pose: PoseReported | None = None
        self.battery: BatteryReported | None = None
        self.battery_at_start: BatteryReported | None = None
        self.dropped: Counter[str] = Counter()
        self._doubted: set[int] = set()
        """Docked aMussels whose own packets deny it."""
        self._codec = codec
        self.samples = samples
        self._duration_ms = scenario.duration_ms
        self._end_at_apad_fraction = scenario.mission.end_at_apad_fraction
        end_by = scenario.mission.end_by
        self._end_by_ms = round(end_by * 1000) if isinstance(end_by, float | int) else None
        """The time to be home. None, too, once a person was told that it passes while the aPad is stopped."""
        self._ranging = learned.ranging
        self._facts: list[tuple[int, int, int, Fact]] = []
        self._counter = 0
        self._now_ms = MissionMs(0)
        self._named: dict[int, Primitive] = {}

    @property
    def ranging_dropped(self) -> Counter[str]:
        return Counter() if self._ranging is None else self._ranging.dropped

    @property
    def primitive(self) -> str:
        """The running primitive, by the name that people use."""
        running = self.port.running
        return "none" if running is None else PRIMITIVE_NAMES[type(running)]

    @property
    def stop(self) -> StopRecord | None:
        """The stop in force."""
        return self._gate.stops.in_force

    @property
    def has_ended(self) -> bool:
        return self.mission.state.phase is Phase.ENDED

    def receive(self, fact: Fact) -> None:
        """Keeps the fact for the first tick at or after its stamp."""
        self._counter += 1
        self._facts.append((fact.at_ms, _PRIORITY[type(fact)], self._counter, fact))

    def advance(self, now_ms: MissionMs) -> list[SupervisorAction]:
        """Acts at the tick `now_ms` on everything stamped up to it (ValueError if time went back)."""
        if now_ms < self._now_ms:
            raise ValueError(f"time went back: {now_ms} before {self._now_ms}")
        self._now_ms = now_ms
        due = sorted(entry for entry in self._facts if entry[0] <= now_ms)
        self._facts = [entry for entry in self._facts if entry[0] > now_ms]
        self.beliefs.advance(now_ms)
        self.mission.await_person(self._gate.awaits_person, self._gate.pilot)
        actions: list[SupervisorAction] = self._report_lateness(now_ms)
        for _, _, _, fact in due:
            actions += self._handle(fact, now_ms)
        actions += self._acknowledge()
        actions += self._pass_on(self.port.advance(now_ms), now_ms)
        if (end := self._reason_to_end(now_ms)) is not None:
            actions += self._carry_out(self.mission.end(MissionEnd(end), now_ms), now_ms)
        elif (reason := self._stands_down.reason_to_stand_down(self._battery_ends)) is not None:
            actions += self._carry_out(self.mission.stand_down(reason, now_ms), now_ms)
        actions += self._carry_out(self.mission.advance(now_ms), now_ms)
        if self._ranging is not None:
            actions += self._ranging.advance(self.allocation.all(), now_ms)
        return actions

    def _report_lateness(self, now_ms: MissionMs) -> list[SupervisorAction]:
        """Tells once that the time to be home passes while the aPad may not move."""
        held = self._gate.awaits_person or self._gate.pilot
        if self._end_by_ms is None or now_ms < self._end_by_ms or not held or self.has_ended:
            return []
        self._end_by_ms = None
        return [Stuck(f"mission.end_by passes while it may not move: {held}")]

    def inform(self, forecaster: Forecaster, now_ms: MissionMs) -> None:
        """Has a forecaster take what is believed at the tick `now_ms`."""
        elsewhere = self.allocation.served_elsewhere
        forecaster.take(
            now_ms,
            (it for it in self.beliefs.all() if it.agent_id not in elsewhere),
            None if self.battery is None else self.battery.fraction,
        )

    def forecast(self, forecaster: Forecaster, now_ms: MissionMs) -> Forecast:
        """The forecast of this flight at the tick `now_ms`."""
        self.inform(forecaster, now_ms)
        place_m = None if self.pose is None else self.pose.place_m
        return forecaster.look(now_ms, self.mission.state, place_m)

    def send(self, send: Send, now_ms: MissionMs) -> list[Send]:
        """The packet with the time at which the modem may send it; nothing if the same packet waits already."""
        timed = send if self._ranging is None else self._ranging.send(send, now_ms)
        return [] if timed is None else [timed]

    def _handle(self, fact: Fact, now_ms: MissionMs) -> list[SupervisorAction]:
        match fact:
            case AMusselHeard(_, at_ms, data):
                packet = self._codec.decode(data)
                if isinstance(packet, LogRecords):
                    return self._collect_samples(packet)
                if isinstance(packet, StatusPacket | ShortStatus):
                    return self._believe(packet, at_ms)
                self.dropped["bytes that are no status packet"] += 1
                return []
            case RangeHeard():
                if self._ranging is None:
                    return []
                return self._ranging.hear(fact, self.pose, self.beliefs, now_ms)
            case EndRequested(_, end):
                return self._carry_out(self.mission.end(end, now_ms), now_ms)
            case StandDownRequested(_, reason):
                return self._carry_out(self.mission.stand_down(reason, now_ms), now_ms)
            case CommandedByOthers():
                if not self.has_ended:
                    self.mission.take_over(by=Steering.OTHERS)
            case DocksNamed(_, held, named):
                self.mission.docks_named({agent_id: agent_id in named for agent_id in held})
            case PoseReported():
                self.pose = fact
                self.mission.moved(fact.north_m, fact.east_m)
            case BatteryReported():
                self.battery = fact
                if self._gate.battery.take(fact):
                    self.mission.battery_heard(fact.fraction)
                if self.battery_at_start is None:
                    self.battery_at_start = fact
        return self._pass_on(self.port.receive(fact, now_ms), now_ms)

    def _collect_samples(self, packet: LogRecords) -> list[SupervisorAction]:
        if packet.agent_id in self.allocation.served_for_others:
            return []  # another fleet's aMussel: its samples are kept and acknowledged where it is simulated
        taken = self.samples.take(packet)
        if isinstance(taken, str):
            self.dropped[taken] += 1
            return []
        actions: list[SupervisorAction] = []
        if taken.samples:
            actions.append(KeepSamples(packet.agent_id, taken.samples))
        if taken.gone:
            first, last = min(taken.gone), max(taken.gone)
            actions.append(SamplesGone(packet.agent_id, len(taken.gone), first, last))
        return actions

    def _believe(self, status: StatusPacket | ShortStatus, at_ms: MissionMs) -> list[SupervisorAction]:
        """Updates the beliefs from the status, and tells if its sender became suspect by it, or no longer is."""
        agent_id, beliefs = status.agent_id, self.beliefs
        was_suspect = beliefs.suspicion(agent_id) is not None
        actions: list[SupervisorAction] = []
        if isinstance(status, ShortStatus):
            if self._ranging is not None:
                self._ranging.short_status_received(agent_id)
            reason = beliefs.hear_short(status, at_ms)
        elif (reason := beliefs.hear(status, at_ms)) is None:
            if (belief := beliefs.get(agent_id)) is not None:
                self.samples.note_place(belief, status.agent_ms)
            actions += self._doubt_dock(status)
        if reason is not None:
            self.dropped[reason] += 1
        elif (suspicion := beliefs.suspicion(agent_id)) is not None and not was_suspect:
            actions.append(AMusselSuspected(agent_id, suspicion.reason))
        elif suspicion is None and was_suspect:
            actions.append(SuspicionOver(agent_id))
        return actions

    def _doubt_dock(self, status: StatusPacket) -> list[SupervisorAction]:
        """Tells once that an aMussel reports to lie on the bottom while, by the vehicle's report, a dock holds it."""
        agent_id, docked = status.agent_id, self.mission.state.docked
        holding = [it for it, held in docked if held == agent_id] if status.state in ON_BOTTOM else []
        if not holding:
            self._doubted.discard(agent_id)
            return []
        if agent_id in self._doubted:
            return []
        self._doubted.add(agent_id)
        name, state = f"dock {holding[-1] + 1}", status.state.name
        reason = f"{name} holds it by the vehicle's report, and it reports {state}, on the bottom"
        return [DocksDisagree(agent_id, reason)]

    def _acknowledge(self) -> list[SupervisorAction]:
        acks = self.samples.acknowledgements()
        return [Send(Medium.WIFI, ack.agent_id, self._codec.encode(ack)) for ack in acks]

    def _reason_to_end(self, now_ms: MissionMs) -> EndReason | None:
        if now_ms >= self._duration_ms:
            return EndReason.MISSION_TIME
        return self._stands_down.reason_to_end(self._battery_ends)

    @property
    def _battery_ends(self) -> EndReason | None:
        return EndReason.APAD_BATTERY if self._is_empty else None

    @property
    def _is_empty(self) -> bool:
        believed = self._gate.battery.believed
        return believed is not None and believed.fraction <= self._end_at_apad_fraction

    def presence_changed(self, agent_id: int) -> None:
        """Called when an aMussel becomes real, simulated or retired: its home and delay were those of another body."""
        self.mission.forget_home(agent_id)
        if self._ranging is not None:
            self._ranging.moved(agent_id, self._now_ms)

    # With several aPads: the aMussels that this one serves.

    def start_serving(self, agent_id: int, belief: Belief | None) -> None:
        """Serves the aMussel from now on; for another fleet's aMussel, `belief` is the former server's belief."""
        if agent_id not in self.allocation.own:
            self.beliefs.admit(agent_id, belief)
        self.allocation.take(agent_id)
        if self._ranging is not None:
            self._ranging.start_serving(agent_id, self._now_ms)

    def stop_serving(self, agent_id: int) -> None:
        """Leaves the aMussel to another aPad from now on.

        One of this fleet still updates the beliefs here, because its records are kept here.
        """
        self.allocation.give(agent_id)
        if self._ranging is not None:
            self._ranging.stop_serving(agent_id)
        if agent_id not in self.allocation.own:
            self.beliefs.dismiss(agent_id)

    def _pass_on(self, items: list[VehicleCommand | Outcome], now_ms: MissionMs) -> list[SupervisorAction]:
        """Passes commands out and outcomes to the mission, and the mission's orders to the port, until none is left."""
        actions: list[SupervisorAction] = []
        waiting = deque(items)
        while waiting:
            item = waiting.popleft()
            if isinstance(item, PrimitiveEnded | DockChanged):
                self._learn_from_dock(item)
                actions += self._note_outcome(item)
                actions += self._carry_out(self.mission.receive(item, now_ms), now_ms)
            else:
                actions.append(item)
        return actions

    def _carry_out(self, orders: list[MissionAction], now_ms: MissionMs) -> list[SupervisorAction]:
        actions: list[SupervisorAction] = []
        outcomes: list[VehicleCommand | Outcome] = []
        for order in orders:
            match order:
                case PermitSurfacing(agent_id) if not self._gate.passes(self._surfacing(agent_id), now_ms):
                    pass  # the gate has the reason for the journal
                case PermitSurfacing(agent_id):
                    self.beliefs.learn(agent_id, Permitted(), now_ms)
                    actions += self._command(Kind.PERMISSION, agent_id, now_ms)
                case PingAgent(agent_id) if self._ranging is not None:
                    self._ranging.ping(agent_id)
                case PingAgent():
                    self.dropped["pings without a modem in the water"] += 1
                case SendCommand(kind, agent_id):
                    actions += self._command(kind, agent_id, now_ms)
                case Event() | VehicleOrder():
                    actions.append(order)
                case _:
                    self._named[order.command_id] = order
                    actions.append(_primitive_event(order, PrimitivePhase.STARTED))
                    for item in self.port.receive(order, now_ms):
                        if isinstance(item, PrimitiveEnded | DockChanged):
                            outcomes.append(item)
                        else:
                            actions.append(item)
        # The mission made its other orders before these outcomes. A snapshot among them must not follow a newer one.
        return actions + self._pass_on(outcomes, now_ms)

    def _command(self, kind: Kind, agent_id: int, now_ms: MissionMs) -> list[Send]:
        data = self._codec.encode(CommandPacket(kind, agent_id))
        return self.send(Send(medium_of(kind), agent_id, data), now_ms)

    def _surfacing(self, agent_id: int) -> Surfacing:
        belief = self.beliefs.get(agent_id)
        return Surfacing(agent_id, None if belief is None else (belief.north_m, belief.east_m))

    def _learn_from_dock(self, outcome: Outcome) -> None:
        """Updates the belief of the aMussel in a dock that opened or closed, without a packet from it."""
        if not isinstance(outcome, DockChanged) or self.pose is None:
            return
        at_ms = MissionMs(outcome.at_ms)
        if self._ranging is not None:
            self._ranging.moved(outcome.agent_id, at_ms)
        if outcome.closed:
            self.beliefs.learn(outcome.agent_id, Docked(), at_ms)
        else:
            self.beliefs.learn(outcome.agent_id, Released(self.pose.north_m, self.pose.east_m), at_ms)

    def _note_outcome(self, outcome: Outcome) -> list[SupervisorAction]:
        if isinstance(outcome, DockChanged):
            return []
        if (primitive := self._named.pop(outcome.primitive_id, None)) is None:
            return []
        # Neither an aPad that waits for a person nor one that may be empty is broken down.
        may_be_empty = self._is_empty or self._gate.battery.doubts
        is_free = not (self._gate.awaits_person or may_be_empty)
        if isinstance(primitive, GoTo) and is_free:
            self._stands_down.go_to_ended(outcome)
        if isinstance(outcome, PrimitiveFailed):
            return [_primitive_event(primitive, PrimitivePhase.FAILED, outcome.reason)]
        if isinstance(outcome, NothingCaught):
            return [_primitive_event(primitive, PrimitivePhase.NOTHING_CAUGHT)]
        return [_primitive_event(primitive, PrimitivePhase.SUCCEEDED)]


def _primitive_event(
    primitive: Primitive, phase: PrimitivePhase, reason: str | None = None
) -> PrimitiveChanged:
    return PrimitiveChanged(
        PRIMITIVE_NAMES[type(primitive)],
        phase,
        agent=primitive.agent_id if isinstance(primitive, CloseDock | OpenDock) else None,
        dock=primitive.dock_index if isinstance(primitive, CloseDock | OpenDock) else None,
        north_m=primitive.north_m if isinstance(primitive, GoTo | Hold) else None,
        east_m=primitive.east_m if isinstance(primitive, GoTo | Hold) else None,
        reason=reason,
    )
