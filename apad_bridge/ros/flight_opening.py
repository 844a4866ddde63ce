"""Opens the parts of a flight over ROS: the gateway's node, the aPad's link, the packet relay and the pace."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import rospy

from apad_bridge.assembly.safety import safety_of
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.network import Unreachable
from apad_bridge.doctor.origin_check import check_origin
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason
from apad_bridge.events.vehicle_events import VehicleHeard, VehicleSilent
from apad_bridge.mission.sources import Allocation
from apad_bridge.ros.gateway.agent_topics import AgentReport
from apad_bridge.ros.gateway.battery_alerts import BatteryAlerts
from apad_bridge.ros.gateway.claims import ClaimBoard
from apad_bridge.ros.gateway.fleet_guard import SecondFleet
from apad_bridge.ros.gateway.fleet_services import FleetServices
from apad_bridge.ros.gateway.gateway import Gateway, GatewayFailed, TrueReports, open_gateway
from apad_bridge.ros.gateway.heartbeat import Heartbeat, WatchdogStates
from apad_bridge.ros.gateway.standard_topics import StandardTopics
from apad_bridge.ros.generation_a.contacts_link import ContactsLink
from apad_bridge.ros.links.laboratory import Laboratory, LaboratoryLink
from apad_bridge.ros.links.legacy_link import LegacyLink
from apad_bridge.ros.links.other_apads import OtherAPads
from apad_bridge.ros.links.vehicles import READY_S, TruthsAt, open_apad, reports_contact
from apad_bridge.ros.relay import open_relay
from apad_bridge.ros.system.handshakes import HearingWatch
from apad_bridge.ros.system.master_watch import MasterWatch
from apad_bridge.ros.system.node import OrderedEnd
from apad_bridge.ros.system.ros_pace import FollowedClock, OwnMasterClock, StampedByMaster
from apad_bridge.ros.system.route import why_gone
from apad_bridge.ros_names.names import beside_others, in_full, is_one_of_several
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.firmware_config import codec_of
from apad_bridge.scenario.lab_interface.lab_names import DEFAULT, load_names
from apad_bridge.scenario.run_options import APadKind, BenchPart, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.clock import Pace, WallClock
from apad_bridge.supervisor.context import FlightContext, Watcher
from apad_bridge.supervisor.run_spec import ResumePoint
from apad_bridge.supervisor.supervisor import Supervisor
from apad_bridge.vehicle.guards.gate import Gate, Safety, plain_safety
from apad_bridge.vehicle.guards.guarded_orders import BodyInWater
from apad_bridge.vehicle.guards.stops import TAKEN_MS
from apad_bridge.vehicle.link_errors import PeerFailed, VehicleNotReady
from apad_bridge.vehicle.telemetry import SilenceWatch
from apad_bridge.vehicle.vehicle_link import ListeningLink
from apad_bridge.world.roster import NoRoster, Presences, Roster
from apad_bridge.world.simulated_fleet import NoFleet
from apad_bridge.world.world import World
from firmware_model.state_groups import UP_AND_UNDOCKED

APadLink = LegacyLink[Any]
_NODES = {
    BenchPart.WHOLE: "musselbed",
    BenchPart.FLEET: "musselbed_fleet",
    BenchPart.MISSION: "musselbed_mission",
}


@contextmanager
def open_flight_context(
    scenario: Scenario,
    options: RunOptions,
    *,
    world: World,
    resume_point: ResumePoint | None,
    truths_at: TruthsAt,
    presences: Presences,
    allocation: Allocation,
    tell: Callable[[str], None],
) -> Iterator[FlightContext]:
    """Keeps everything on the graph while it is entered. PeerFailed, in one line, when a part does not come up.

    `truths_at` is the recorder's, for a scenario that publishes the truth on the aMussels' own topics. `tell` prints a line
    for a person where the graph contradicts the journal's `presences`. The vehicle docks the aMussels of the `allocation`
    and no others.
    """
    docked = {} if resume_point is None else dict(resume_point.state.docked)
    now_ms = 0 if resume_point is None else resume_point.now_ms
    # A mission alone publishes none of its aMussels' topics: they, or their fleet, do so themselves.
    shown = () if options.part is BenchPart.MISSION else scenario.fleet.ids
    with ExitStack() as stack:
        try:
            if options.has_real_vehicle:
                _refuse_other_origin(scenario, options)
            ordered_end = OrderedEnd()
            stack.callback(ordered_end.close)
            gateway = _gateway(scenario, options, shown, presences, truths_at)
            stack.callback(gateway.close)
            world = replace(world, roster=_roster(stack, world, presences, options, tell))
            laboratory = _laboratory(scenario)
            stack.callback(laboratory.close)
            beside = _beside_the_gateway(scenario, options, shown, presences)
            safety = safety_for(scenario, options)
            others = OtherAPads([it for it in options.apads if it != scenario.apad.name])
            stack.callback(others.close)
            vehicle, watches = _vehicle(scenario, options, safety.gate, docked, now_ms, truths_at)
            stack.callback(vehicle.close)
            if options.has_real_vehicle and not isinstance(vehicle, ContactsLink):
                stack.callback(_leave, vehicle, tell)
            states = WatchdogStates(scenario.apad.name, safety.gate)
            stack.callback(states.close)
            # A fleet alone flies no aPad. Its heartbeat would hide the death of the bench that does.
            heart = (
                ()
                if options.part is BenchPart.FLEET
                else (Heartbeat(safety.gate.stops, lambda: vehicle.can_stop),)
            )
            relayed = open_relay(options, scenario, vehicle, presences, allocation, laboratory)
            stack.callback(relayed.close)
            if not isinstance(vehicle, ContactsLink):
                vehicle.wait_until_ready(READY_S)
        except (SecondFleet, GatewayFailed, Unreachable, VehicleNotReady) as error:
            raise PeerFailed(str(error)) from error
        capabilities = docks = None
        if not isinstance(vehicle, ContactsLink):
            capabilities = vehicle.capabilities
            docks = None if capabilities.reports_contact else vehicle.receive_dock_report
        link = LaboratoryLink(laboratory, vehicle, docks)
        yield FlightContext(
            vehicle=ListeningLink(link) if options.part is BenchPart.FLEET else link,
            pace=_pace(options, vehicle, now_ms, in_fine_steps=bool(watches)),
            world=world,
            safety=safety,
            watchers=lambda supervisor: (
                _bodies_watcher(safety.gate, supervisor, options, presences, others),
                states.watch,
                gateway.watcher(supervisor),
                *(it.watcher(supervisor) for it in (*heart, *beside)),
                *watches,
                *_allocation_watcher(allocation, vehicle),
            ),
            announce=gateway.event,
            show_forecast=lambda now_ms, forecast: gateway.show_forecast(now_ms, forecast()),
            relay=relayed.relay,
            capabilities=capabilities,
            dropped=lambda: sum(
                (it.dropped for it in (laboratory, relayed, others, states)), vehicle.dropped
            ),
            take_events=_graph_events(
                stack, options, scenario, vehicle, (vehicle, laboratory.subscribers, others, states)
            ),
            ended_by_graph=lambda stop: ordered_end.stop_by(
                lambda why: stop(MissionEnd(EndReason.NODE_ENDED, f"{EndReason.NODE_ENDED}: {why}"))
            ),
            keeps_samples=options.part is not BenchPart.FLEET,
        )


def _leave(vehicle: APadLink, tell: Callable[[str], None]) -> None:
    """Waits for the answers to the last orders: a vehicle may drop a call whose connection is closed."""
    if missing := vehicle.wait_until_taken(TAKEN_MS / 1000):
        tell(
            f"the aPad has not answered the last order within {TAKEN_MS / 1000:g} s ({', '.join(missing)}), and may go on: "
            "if it must stop, use the vehicle's own switch"
        )


def safety_for(scenario: Scenario, options: RunOptions) -> Safety:
    """The guards and the monitor of the aPad. A fleet alone commands no aPad, so nothing watches it there."""
    if options.part is BenchPart.FLEET:
        return plain_safety()
    return safety_of(scenario, needs_person=options.has_real_vehicle)


def _refuse_other_origin(scenario: Scenario, options: RunOptions) -> None:
    """Places would mean other places to a vehicle whose local (0, 0) lies elsewhere."""
    name = in_full(options.namespace, scenario.apad.name)
    finding = check_origin(options.master_uri, name, scenario.area.origin)
    if finding.status is CheckStatus.FAIL:
        raise VehicleNotReady(f"{finding.found}: {finding.mend}")


def _bodies_watcher(
    gate: Gate, supervisor: Supervisor, options: RunOptions, presences: Presences, others: OtherAPads
) -> Watcher:
    """Tells the gate where other aPads are, and which real aMussels are at the surface, as far as they are heard.

    No hull touches a simulated aMussel. One that was docked was last heard afloat, until it reports again.
    """

    def watch(now_ms: int) -> None:
        simulated = frozenset() if options.part is BenchPart.MISSION else presences.simulated
        no_body = simulated.union(it for it in supervisor.mission.docks if it is not None)
        gate.see_bodies(
            tuple(
                BodyInWater(f"aMussel {it.agent_id}", (it.north_m, it.east_m), it.agent_id)
                for it in supervisor.beliefs.all()
                if it.agent_id not in no_body and it.state in UP_AND_UNDOCKED
            )
            + others.bodies()
        )

    return watch


def _gateway(
    scenario: Scenario, options: RunOptions, shown: Sequence[int], presences: Presences, truths_at: TruthsAt
) -> Gateway:
    ids = scenario.fleet.ids
    return open_gateway(
        shown,
        scenario.time_scale,
        node_name=f"{_NODES[options.part]}_{ids[0] if ids else scenario.fleet.first_id}",
        xmlrpc_port=options.xmlrpc_port,
        remappings=_remappings(scenario, options),
        simulated=lambda: presences.simulated,
        truth=_shown_truth(truths_at) if scenario.records.truth_on_agent_topics else None,
        is_resumed=options.is_resumed,
        frame=LocalFrame.about(scenario.area.origin),
    )


def _beside_the_gateway(
    scenario: Scenario, options: RunOptions, shown: Sequence[int], presences: Presences
) -> tuple[StandardTopics, BatteryAlerts]:
    return (
        StandardTopics(scenario, shown, options.namespace),
        BatteryAlerts(scenario, shown, options.namespace, lambda: presences.simulated),
    )


def _laboratory(scenario: Scenario) -> Laboratory:
    names = load_names(Path(scenario.apad.interface) if scenario.apad.interface else DEFAULT)
    ids, codec = scenario.fleet.ids, codec_of(scenario)
    return Laboratory(names, scenario.apad.name, ids, codec)


def _remappings(scenario: Scenario, options: RunOptions) -> list[str]:
    """The user's come last: of two for the same name ROS takes the later one."""
    return [*(beside_others(scenario.apad.name) if is_one_of_several(scenario) else ()), *options.remappings]


def _vehicle(
    scenario: Scenario,
    options: RunOptions,
    gate: Gate,
    docked: Mapping[int, int],
    now_ms: int,
    truths_at: TruthsAt,
) -> tuple[APadLink | ContactsLink, tuple[Watcher, ...]]:
    """The link to the aPad, or to somebody else's dock contacts for a fleet alone; and the watchers that it needs."""
    if options.part is BenchPart.FLEET and reports_contact(scenario):
        return ContactsLink(scenario.apad.name, scenario.fleet.ids, docked, now_ms, scenario.apad.docks), ()
    opened = open_apad(scenario, options, gate, docked, now_ms, truths_at)
    return opened.link, () if opened.watch is None else (opened.watch,)


def _roster(
    stack: ExitStack,
    world: World,
    presences: Presences,
    options: RunOptions,
    tell: Callable[[str], None],
) -> Roster | NoRoster:
    if isinstance(world.fleet, NoFleet):
        return NoRoster()
    claims = ClaimBoard(rospy.get_name(), lambda: presences.simulated)
    if options.is_resumed:
        for line in claims.resume(presences):
            tell(line)
    else:
        claims.refuse_overlap(presences.simulated)
    services = FleetServices(presences, claims)
    stack.callback(services.close)
    return Roster(presences, services, world.fleet.coordinator, world.faults)


def _allocation_watcher(allocation: Allocation, vehicle: APadLink | ContactsLink) -> tuple[Watcher, ...]:
    """Passes a changed allocation on to the vehicle's link, which docks no other aMussels."""
    if isinstance(vehicle, ContactsLink):
        return ()
    served = allocation.own

    def watch(now_ms: int) -> None:
        nonlocal served
        if allocation.served != served:
            served = allocation.served
            vehicle.serve(served)

    return (watch,)


class _Listener(Protocol):
    def take_events(self) -> list[Event]: ...


def _graph_events(
    stack: ExitStack,
    options: RunOptions,
    scenario: Scenario,
    vehicle: APadLink | ContactsLink,
    listeners: Sequence[_Listener],
) -> Callable[[int], list[Event]]:
    """Reports what cannot be read, when nobody can connect to us, and when another's master or vehicle goes and comes.

    With a master or a vehicle of ours the run ends.
    """
    hearing = HearingWatch()
    stack.callback(hearing.close)

    def refused(now_ms: int) -> list[Event]:
        return [*hearing.take(), *(event for listener in listeners for event in listener.take_events())]

    if options.apad is APadKind.SIM:
        return refused
    master = MasterWatch(options.master_uri)
    stack.callback(master.close)
    silence, name = SilenceWatch(), scenario.apad.name

    def take(now_ms: int) -> list[Event]:
        events: list[Event] = [*master.take(), *refused(now_ms)]
        if not isinstance(vehicle, ContactsLink) and silence.look(vehicle.heard_ms, now_ms):
            kind = VehicleSilent if silence.is_silent else VehicleHeard
            events.append(kind(name, silence.since_ms))
            master.request_registration()
        return events

    return take


def _shown_truth(truths_at: TruthsAt) -> TrueReports:
    return lambda now_ms: {
        it.agent_id: AgentReport(it.north_m, it.east_m, it.depth_m, it.primary) for it in truths_at(now_ms)
    }


def _pace(options: RunOptions, vehicle: APadLink | ContactsLink, now_ms: int, *, in_fine_steps: bool) -> Pace:
    in_step, uri = None if isinstance(vehicle, ContactsLink) else vehicle, options.master_uri
    if options.apad is APadKind.SIM and in_step is not None:
        return OwnMasterClock(
            options.speed, in_step, now_ms, in_fine_steps=in_fine_steps, why_gone=lambda: why_gone(uri)
        )
    following = options.time is TimeSource.ROS
    clock = FollowedClock(now_ms, in_step, why_gone=lambda: why_gone(uri)) if following else WallClock(1.0)
    return StampedByMaster(clock, now_ms)
