"""A vehicle link to ANY aPad of generation B on ROS, ours or a real one.

    link = GenerationBLink(scenario, docks, gate, our_clock=True)
    link.wait_until_ready(10.0)        # VehicleNotReady, one line that names the missing parts

Stamps are as in generation A: with `our_clock` poses carry those of their messages; a fact without a stamp became true at
the tick that receives it.

Beside what both generations publish, an aPad of generation B publishes goals and status of its primitives, the state of its
arms, and whether a pilot steers.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import Any

import rosgraph
import rospy
from std_msgs.msg import Bool, Float32MultiArray, Int32
from std_srvs.srv import Trigger

from apad_bridge.assembly import flight_parts
from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Unreachable
from apad_bridge.ros.generation_b.virtual_camera import DETECTION_TOPICS, VirtualCamera
from apad_bridge.ros.links.legacy_link import LegacyLink, OpenedAPad
from apad_bridge.ros.links.order_sender import Answered
from apad_bridge.ros.links.vehicle_subscribers import VehicleSubscribers, publisher_of
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.types.live_types import live_services, unreadable_topics
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_apad
from apad_bridge.scenario.blocks.mission_options import DockingProfile
from apad_bridge.scenario.lab_interface.fields import has, write
from apad_bridge.scenario.lab_interface.lab_messages import DockReport
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.commands import (
    GoalOfOthers,
    GoTo,
    Hold,
    MoveArm,
    OrderCut,
    Stop,
    VehicleCommand,
)
from apad_bridge.vehicle.generation_b.core import GenerationBCore
from apad_bridge.vehicle.generation_b.docks import KeptDocks
from apad_bridge.vehicle.generation_b.messages import (
    ArmReceived,
    DockingOrder,
    ManualReceived,
    NumberedOrder,
    PrimitiveName,
    PrimitiveStatus,
    Received,
    ServiceAnswered,
    StatusReceived,
    arms,
)
from apad_bridge.vehicle.generation_b.stack import STACK
from apad_bridge.vehicle.guards.gate import Gate
from apad_bridge.vehicle.link_errors import VehicleNotReady
from apad_bridge.vehicle.order_queue import Rank
from apad_bridge.vehicle.stack_messages import UNSTAMPED
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact
from apad_bridge.world.contacts import FloatingPlaces
from apad_bridge.world.generation_b.docks import BenchDocks

use_generated_messages()

from misc_msgs.srv import (  # noqa: E402
    DockingPrimitiveService,
    DynamicPositioningPrimitiveService,
    Go2pointPrimitiveService,
)
from navcon_msgs.msg import GoToPointActionGoal  # noqa: E402

_OPEN = 0.5
"""`dock_out` is 1.0 for an arm that stands open, and 0.0."""
_DATA = ("data",)
_GOAL = ("goal.T2.point.x", "goal.T2.point.y")
_HOLD, _OFF = "hold that stops", "off"
"""The lines of stops. Those of orders are called as their primitives."""
_SETTLE_S = 0.003
"""On our own clock: messages published before the tick's last `stateRef` have reached this machine by then, and are read
within this time."""


class Subscribers(VehicleSubscribers):
    """Subscribes to the aPad called `name`. Only poses have a stamp."""

    def __init__(self, name: str, inbox: Inbox[Received], *, stamped: bool) -> None:
        super().__init__(name, inbox, stamped=stamped)
        self._listen(of_apad(name, "goto_status"), Int32, _DATA, self._take_status, False)
        self._listen(of_apad(name, "docking_status"), Int32, _DATA, self._take_status, True)
        self._manual = self._listen(of_apad(name, "manual"), Bool, _DATA, self._take_manual)
        self._has_manual = False
        self._listen(of_apad(name, "dock_out"), Float32MultiArray, _DATA, self._take_arms)
        # A vehicle flies without it: then nothing but the status shows another client's go-to.
        server = of_apad(name, "go2point")
        self._listen(f"{server}/goal", GoToPointActionGoal, _GOAL, self._take_goal, is_checked_before=False)

    def lost_pilot(self) -> bool:
        """True, once, when the node that published the pilot's flag has left."""
        had, self._has_manual = self._has_manual, self._manual.get_num_connections() > 0
        return had and not self._has_manual

    def _take_status(self, message: Any, docking: bool) -> None:
        try:
            status = StatusReceived(UNSTAMPED, docking, PrimitiveStatus(message.data))
        except ValueError:
            self._inbox.drop("a primitive's status of no known code")
            return
        self._inbox.put(status, always=True)

    def _take_manual(self, message: Any) -> None:
        self._inbox.put(ManualReceived(UNSTAMPED, bool(message.data)), always=True)

    def _take_goal(self, message: Any) -> None:
        """A goal on its way to the server. The commander sends those of its services, whoever called them."""
        place, client = message.goal.T2.point, publisher_of(message)
        self._inbox.put(GoalOfOthers(UNSTAMPED, client, place.x, place.y), always=True)

    def _take_arms(self, message: Any) -> None:
        for dock_index, opening in enumerate(message.data):
            if opening > _OPEN:
                self._inbox.put(ArmReceived(UNSTAMPED, dock_index), always=True)
                break


SERVICES: dict[PrimitiveName, Any] = {
    PrimitiveName.GO_TO: Go2pointPrimitiveService,
    PrimitiveName.POSITION: DynamicPositioningPrimitiveService,
    PrimitiveName.DOCKING: DockingPrimitiveService,
}


class GenerationBLink(LegacyLink[GenerationBCore]):
    """The VehicleLink of the scenario's aPad; `docks` are kept for the vehicle."""

    STACK = STACK
    MEND = "source its workspace, or put its texts into apad_bridge/ros/definitions and run launch_scripts/install"

    def __init__(
        self,
        scenario: Scenario,
        docks: KeptDocks,
        gate: Gate,
        now_ms: int = 0,
        *,
        our_clock: bool,
        camera: VirtualCamera | None = None,
    ) -> None:
        name, docking = scenario.apad.name, scenario.mission.docking
        core = GenerationBCore(
            docks, scenario.apad.battery.range_v, docking, now_ms, takes_back=our_clock, gate=gate
        )
        super().__init__(scenario.apad, core, gate, now_ms)
        self._subscribers = Subscribers(name, self._inbox, stamped=our_clock)
        self._docking = docking
        self._statuses_before = 0
        self._statuses_are_silent = False
        self._services = dict(SERVICES)
        self._camera = camera
        self._arms = rospy.Publisher(of_apad(name, "dock_out"), Float32MultiArray, queue_size=4)

    def serve(self, agent_ids: Iterable[int]) -> None:
        visual = DockingProfile.VISUAL
        self._core.docks.serve(it for it in agent_ids if self._docking.profile_of(it) is not visual)

    def _missing(self) -> list[str]:
        try:
            offered = Graph.read(rosgraph.get_master_uri()).services
        except Unreachable as error:
            return [*self._subscribers.missing, str(error)]
        needed = (rospy.resolve_name(self._service_name(primitive)) for primitive in SERVICES)
        return [
            *self._subscribers.missing,
            *(f"nobody offers {name}" for name in needed if name not in offered),
        ]

    def _differences(self) -> list[str]:
        """Also chooses the definitions by which the services are called from now on."""
        by_name = {rospy.resolve_name(self._service_name(primitive)): primitive for primitive in SERVICES}
        chosen, lines = live_services({name: SERVICES[primitive] for name, primitive in by_name.items()})
        self._services = {primitive: chosen[name] for name, primitive in by_name.items()}
        lines += unreadable_topics(self._subscribers.needed)
        for name, primitive in by_name.items():
            request = chosen[name]._request_class()
            lines += [f"{name} has no field {it} there" for it in _FIELDS[primitive] if not has(request, it)]
        return lines

    @property
    def can_stop(self) -> bool:
        return self._sender.are_open([_OFF, _HOLD])

    def _prepare(self) -> None:
        for primitive, kind in self._services.items():
            self._sender.add_service(primitive.value, self._service_name(primitive), kind)
        # A line of its own: a hold that stops waits behind no other call.
        held = PrimitiveName.POSITION
        self._sender.add_service(_HOLD, self._service_name(held), self._services[held])
        self._sender.add_service(_OFF, of_apad(self.name, "commander/stop_mission"), Trigger)
        self._sender.begin()
        self._sender.wait_until_open([*(it.value for it in self._services), _HOLD, _OFF])

    def advance(self, now_ms: int) -> list[LinkFact]:
        """Facts up to `now_ms`. The orders that the core makes of them are sent."""
        self._now_ms = now_ms
        self._drain()
        if self._subscribers.lost_pilot():
            self._core.receive(ManualReceived(now_ms, None), now_ms)
        facts = self._core.advance(now_ms)
        self._send()
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        command = cleared.order
        if isinstance(command, MoveArm):
            arm = arms(command.dock_index if command.is_open else None)
            self._arms.publish(Float32MultiArray(data=[float(it) for it in arm.is_open]))
        self._core.command(cleared, now_ms)
        self._send()

    def receive_dock_report(self, alert: DockReport) -> None:
        """Receives a dock's change from another source than the vehicle."""
        self._core.receive_dock_report(alert)

    def close(self) -> None:
        self._subscribers.close()
        self._sender.close()
        self._arms.unregister()
        if self._camera is not None:
            self._camera.close()

    # In step with our own clock.

    def wait_until_done(self, now_ms: int, timeout_s: float) -> bool:
        """Waits, with a camera, also until it has published its view from there."""
        until_s = time.monotonic() + timeout_s
        is_done = super().wait_until_done(now_ms, timeout_s)
        if is_done and self._camera is not None:
            self._camera.wait_until_published(now_ms, max(0.0, until_s - time.monotonic()))
        return is_done

    def wait_until_heard(self, now_ms: int, timeout_s: float) -> list[str]:
        """Waits until the position has come up to `now_ms` and a status has come since the last tick, and a moment more.

        Statuses come each second. Messages without a stamp may come one tick late, but no later. While a vehicle publishes
        no statuses, it is not waited for again.
        """
        missing = self._wait_while(
            lambda: [*self._core.silent_topics(now_ms), *self._silent_statuses()], timeout_s
        )
        self._statuses_are_silent = self._core.status_count == self._statuses_before
        self._statuses_before = self._core.status_count
        self._drain(_SETTLE_S)
        return missing

    def _silent_statuses(self) -> list[str]:
        silent = self._core.status_count == self._statuses_before and not self._statuses_are_silent
        return ["goto_status"] if silent else []

    def _send(self) -> None:
        for cleared in self._core.take_calls():
            call = cleared.order
            if isinstance(call.order, Stop):
                request = Trigger._request_class()
                self._sender.send(_OFF, Rank.OFF, cleared, request, self._answer_to(call))
                continue
            primitive, fields = _fields(call.order)
            request = self._services[primitive]._request_class()
            for path, value in fields.items():
                write(request, path, value)
            is_stop = isinstance(call.order, Hold) and call.order.pre_empts
            line, rank = (_HOLD, Rank.HOLD) if is_stop else (primitive.value, Rank.ORDER)
            self._sender.send(line, rank, cleared, request, self._answer_to(call))

    def _answer_to(self, call: NumberedOrder) -> Answered:
        def answered(response: Any, refused: str | None, was_cut: bool) -> None:
            if was_cut:
                self._inbox.put(OrderCut(UNSTAMPED), always=True)
            # The published commander leaves `success` of stop_mission false: any answer says that it took the order.
            if refused is None and not (isinstance(call.order, Stop) or response.status):
                refused = "its service answered that it does not take the order"
            self._inbox.put(ServiceAnswered(UNSTAMPED, call.number, refused), always=True)

        return answered

    def _service_name(self, primitive: PrimitiveName) -> str:
        return of_apad(self.name, f"commander/primitive/{primitive.value}")


def _fields(order: GoTo | Hold | DockingOrder) -> tuple[PrimitiveName, dict[str, Any]]:
    match order:
        case GoTo(_, north_m, east_m, speed_m_s, victory_radius_m):
            return PrimitiveName.GO_TO, {
                "point.x": north_m,
                "point.y": east_m,
                "speed": speed_m_s,
                "victory_radius": victory_radius_m,
                "north_enable": True,
                "east_enable": True,
            }
        case Hold(_, north_m, east_m, heading_rad):
            hold = {"north": north_m, "east": east_m, "north_enable": True, "east_enable": True}
            if heading_rad is not None:
                hold |= {"heading": heading_rad, "heading_enable": True}
            return PrimitiveName.POSITION, hold
        case DockingOrder():
            return PrimitiveName.DOCKING, {
                "docking_action": order.docks,
                "docking_slot": order.dock_index,
                "search_yaw_rate": order.search_yaw_rate_rad_s,
                "max_yaw_rate": order.max_yaw_rate_rad_s,
                "max_surge_speed": order.max_surge_m_s,
                "surge_stdev": order.surge_stdev,
            }


_ALL_ORDERS: tuple[GoTo | Hold | DockingOrder, ...] = (
    GoTo(0, 0.0, 0.0, 1.0, 1.0),
    Hold(0, 0.0, 0.0, 0.0),
    DockingOrder(True, 0, 0.0, 0.0, 0.0, 0.0),
)
_FIELDS = {primitive: tuple(fields) for primitive, fields in map(_fields, _ALL_ORDERS)}
"""The fields that a service's request must have: all those ever written into it."""


def _refuse_second_camera(name: str) -> None:
    """VehicleNotReady where something publishes detections already: the servoing would follow two cameras in turn."""
    try:
        published = Graph.read(rosgraph.get_master_uri()).publishers
    except Unreachable as error:
        raise VehicleNotReady(str(error)) from error
    for topic in (rospy.resolve_name(of_apad(name, it)) for it in DETECTION_TOPICS):
        if others := sorted(set(published.get(topic, ())) - {rospy.get_name()}):
            raise VehicleNotReady(
                f"{topic} has a publisher already, {others[0]}: stop it, or dock no aMussel by `camera` "
                "(mission.docking.profile and camera_ids)"
            )


def open_link(
    scenario: Scenario,
    gate: Gate,
    sight: FloatingPlaces,
    docked: Mapping[int, int],
    now_ms: int,
    *,
    our_clock: bool,
) -> OpenedAPad:
    apad, docking, ids = scenario.apad, scenario.mission.docking, scenario.fleet.ids
    simulated_ids = [it for it in ids if docking.profile_of(it) is not DockingProfile.VISUAL]
    seen_ids = frozenset(it for it in ids if docking.profile_of(it) is DockingProfile.CAMERA)
    if seen_ids:
        _refuse_second_camera(apad.name)
    camera = VirtualCamera(apad.name) if seen_ids else None
    docks = BenchDocks(simulated_ids, flight_parts.misses(scenario), sight, docked, apad.docks)
    link = GenerationBLink(scenario, docks, gate, now_ms, our_clock=our_clock, camera=camera)
    if camera is None:
        return OpenedAPad(link)

    def watch(at_ms: int) -> None:
        camera.show({agent_id: place_m for agent_id, place_m in sight(at_ms).items() if agent_id in seen_ids})

    return OpenedAPad(link, watch)
