"""The flights of one aPad, or of several, in virtual time and in this process; several tick by tick side by side.

A tick of mission time is flown by one flight after another; then the assignment of aMussels to aPads is looked at.

An aMussel stays where it is simulated, and its truth and its samples are recorded there and nowhere else. If another
aPad serves it, the exchange passes its packets to that aPad's flight, and passes that flight's packets, and the contacts
of its docks, back. With water the flights share one sea, where each aPad's own modem sends and hears all sound; then the
exchange passes Wi-Fi and contacts alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

from agents.hosting import interrupts
from agents.nursery.launch import StartedNursery
from agents.time_scale import MissionMs
from agents.water.sea import Sea
from apad_bridge.assembly.division import Member
from apad_bridge.assembly.fleet_parts import shared_sea
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.fleet_events import HandedOn, TookOn
from apad_bridge.mission.manual import CommandSource
from apad_bridge.mission.stand_down_rule import Breakdown
from apad_bridge.planning.registry import Trust
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs import flying
from apad_bridge.runs.display import JointDisplay, ProgressDisplay
from apad_bridge.runs.several.assignment import Assignment, Move, view_of
from apad_bridge.runs.several.consensus import ByConsensus
from apad_bridge.runs.several.joint_summary import Flown
from apad_bridge.scenario.another_apad import ASSIGNMENT_PERIOD_S, Sharing
from apad_bridge.supervisor import recorder_interface
from apad_bridge.supervisor.context import FlightContext, Watcher
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.packet_relay import (
    AMusselStanding,
    Division,
    PacketOrigin,
    PacketRelay,
    RelayedPacket,
    RelayOutcome,
)
from apad_bridge.supervisor.run_spec import RunSpec
from apad_bridge.supervisor.supervisor import Supervisor
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.guards.guarded_orders import BodyInWater, Point

ASSIGNMENT_PERIOD_MS = round(1000 * ASSIGNMENT_PERIOD_S)


class Exchange:
    """Carries packets and contacts between flights. `own` names the aMussels simulated beside each aPad.

    A flight handles at its next tick what another sent it.
    """

    def __init__(self, own: Mapping[str, Iterable[int]]) -> None:
        self.home = {agent_id: name for name, ids in own.items() for agent_id in ids}
        self.server = dict(self.home)
        self._waiting: dict[str, list[RelayedPacket]] = {name: [] for name in own}
        self._places_m: dict[str, Point] = {}
        """The newest place of each aPad, which the guards of the others keep clear of."""

    def join(self, name: str, sharing: Sharing, context: FlightContext) -> FlightContext:
        """The same context, in which one of several aPads reaches the others."""
        division = Division(lambda agent_id: self._standing(name, agent_id), tuple(_AS_REMOTE.values()))
        relay = PacketRelay(division, [lambda now_ms: self._take(name)], {RelayOutcome.PUBLISH: self._carry})
        watchers, gate = context.watchers, context.safety.gate
        return replace(
            context,
            relay=relay,
            stands_down=Breakdown(sharing.failed_go_tos),
            watchers=lambda supervisor: (self._place_watcher(name, supervisor, gate), *watchers(supervisor)),
        )

    def _place_watcher(self, name: str, supervisor: Supervisor, gate: Gate) -> Watcher:
        """Tells the gate where the other aPads are, and the others where this one is."""

        def watch(now_ms: int) -> None:
            if supervisor.pose is not None:
                self._places_m[name] = (supervisor.pose.north_m, supervisor.pose.east_m)
            others = ((it, place_m) for it, place_m in self._places_m.items() if it != name)
            gate.see_bodies(tuple(BodyInWater(it, place_m, agent_id=None) for it, place_m in others))

        return watch

    def _standing(self, name: str, agent_id: int) -> AMusselStanding:
        is_served_here = self.server.get(agent_id) == name
        if self.home.get(agent_id) == name:
            return AMusselStanding.OURS if is_served_here else AMusselStanding.LENT
        return AMusselStanding.BORROWED if is_served_here else AMusselStanding.FOREIGN

    def _take(self, name: str) -> list[RelayedPacket]:
        waiting, self._waiting[name] = self._waiting[name], []
        return waiting

    def _carry(self, packet: RelayedPacket) -> None:
        """Takes an aMussel's packet to its server, and all else to its home; a packet to EVERYONE has neither."""
        name_of = self.server if packet.source is PacketOrigin.LOCAL_AMUSSEL else self.home
        if (name := name_of.get(packet.agent_id)) is not None:
            self._waiting[name].append(replace(packet, source=_AS_REMOTE[packet.source]))


_AS_REMOTE = {
    PacketOrigin.LOCAL_AMUSSEL: PacketOrigin.REMOTE_AMUSSEL,
    PacketOrigin.LOCAL_SUPERVISOR: PacketOrigin.REMOTE_SUPERVISOR,
    PacketOrigin.LOCAL_DOCK: PacketOrigin.REMOTE_DOCK,
}


@dataclass(frozen=True, slots=True)
class MemberFlight:
    """One aPad's start, its flight over the exchange's relay, and its records."""

    start_m: tuple[float, float]
    flight: Flight
    recorder: recorder_interface.FlightRecorder


Join = Callable[[FlightContext], FlightContext]
"""Joins a flight's context to the exchange, before the flight is built."""


class LockstepRunner:
    """Runs the flights. Without an `assignment` or a `consensus` each aPad serves its own aMussels to the end."""

    def __init__(
        self,
        flights: Mapping[str, MemberFlight],
        exchange: Exchange,
        assignment: Assignment | None,
        consensus: ByConsensus | None = None,
    ) -> None:
        self.flights = dict(flights)
        self._exchange = exchange
        self.assignment = assignment
        self.consensus = consensus
        self.moves: list[tuple[int, Move]] = []
        """(mission ms, move), in the order in which they were made."""

    @classmethod
    def of(
        cls,
        members: Sequence[Member],
        sharing: Sharing,
        open_member: Callable[[Member, Join, Sea | None], MemberFlight],
    ) -> LockstepRunner:
        """Opens each member's flight, in the sea that they share; only several aPads join an exchange."""
        served = {member.name: member.scenario.fleet.ids for member in members}
        exchange, is_alone = Exchange(served), len(members) == 1
        sea, flights = shared_sea(members[0].scenario, len(members)), {}
        for member in members:
            join: Join = _unchanged if is_alone else partial(exchange.join, member.name, sharing)
            flights[member.name] = open_member(member, join, sea)
        if is_alone or not sharing.transfers:
            return cls(flights, exchange, None)
        if sharing.consensus is not None:
            return cls(flights, exchange, None, ByConsensus(members, sharing.consensus))
        return cls(flights, exchange, Assignment(served))

    @property
    def handed_on_count(self) -> int:
        """The number of aMussels that were handed on at least once."""
        return len({move.agent_id for _, move in self.moves})

    def run(self, until_ms: int | None = None) -> None:
        """Runs to the end of every mission, or up to the last tick before `until_ms`: another call goes on from there."""
        running = {name: it for name, it in self.flights.items() if not it.flight.supervisor.has_ended}
        while running:
            now_ms = min(it.flight.now_ms for it in running.values())
            if until_ms is not None and now_ms >= until_ms:
                return
            ended = [name for name, it in running.items() if it.flight.step()]
            for name in ended:
                del running[name]
            if now_ms % ASSIGNMENT_PERIOD_MS != 0:
                continue
            if self.assignment is not None:
                self._reassign(self.assignment, running, now_ms)
            if self.consensus is not None:
                self._agree(self.consensus, running, now_ms)

    def _reassign(
        self, assignment: Assignment, running: Mapping[str, MemberFlight], now_ms: MissionMs
    ) -> None:
        views = [view_of(name, it.start_m, it.flight.supervisor) for name, it in running.items()]
        for move in assignment.plan_moves(views):
            giver, taker = self.flights[move.giver], self.flights[move.taker]
            belief = giver.flight.supervisor.beliefs.get(move.agent_id)
            giver.flight.stop_serving(move.agent_id)
            taker.flight.supervisor.start_serving(move.agent_id, belief)
            self._exchange.server[move.agent_id] = move.taker
            assignment.record_move(move)
            self.moves.append((now_ms, move))
            giver.recorder.event(now_ms, HandedOn(move.agent_id, move.taker))
            taker.recorder.event(now_ms, TookOn(move.agent_id, move.giver))

    def _agree(self, consensus: ByConsensus, running: Mapping[str, MemberFlight], now_ms: MissionMs) -> None:
        """Has each aPad look at what it serves. An aMussel in a dock sends its packets to that dock's aPad."""
        server: dict[int, str] = {}
        for name, it in running.items():
            for event in consensus.look(name, it.start_m, it.flight, now_ms):
                it.recorder.event(now_ms, event)
            server |= dict.fromkeys(consensus.parts[name].granted, name)
        for name, it in self.flights.items():
            server |= dict.fromkeys(dict(it.flight.supervisor.mission.state.docked).values(), name)
        for agent_id, name in server.items():
            if (former := self._exchange.server[agent_id]) != name:
                self._exchange.server[agent_id] = name
                self.moves.append((now_ms, Move(agent_id, former, name)))


def _unchanged(context: FlightContext) -> FlightContext:
    return context


def fly_in_step(
    members: Sequence[Member],
    sharing: Sharing,
    whole: RunDirectory,
    progress: ProgressDisplay,
    command_sources: Sequence[CommandSource] | None = None,
    nurseries: Mapping[str, StartedNursery] = MappingProxyType({}),
    trust: Trust | None = None,
) -> Flown:
    """Flies with each aPad's own mission, or a single one with these sources of commands in its place.

    `nurseries` were begun for the aPads' fleets; a fleet without one begins its own. SIGINT, SIGTERM and SIGHUP end all
    flights in order. PeerFailed when a fleet does not start.
    """
    display, opened = JointDisplay([member.name for member in members], progress), {}
    spec = RunSpec(command_sources=None if command_sources is None else tuple(command_sources))
    with interrupts.held_back(), ExitStack() as stack:

        def open_member(member: Member, join: Join, sea: Sea | None) -> MemberFlight:
            name, scenario = member.name, member.scenario
            config, directory = flight_config(scenario, trust), whole.of_apad(name, len(members))
            context, recorder = flying.open_in_process(
                stack, config, member.starts, directory, sea, nurseries.get(name)
            )
            opened[name] = flying.prepare(config, join(context), recorder, display.of(name), spec)
            return MemberFlight(scenario.apad.start_m, opened[name].flight, opened[name].recorder)

        runner = LockstepRunner.of(members, sharing, open_member)
        with flying.stopped_by_signals(*(it.flight for it in runner.flights.values())):
            runner.run()
        return Flown({name: it.finish() for name, it in opened.items()}, handed_on=runner.handed_on_count)
