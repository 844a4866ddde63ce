"""The topics, services and the action server of generation A, around a `GenerationAVehicle`. It only converts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Self

import rospy
from actionlib.action_server import ActionServer
from std_msgs.msg import Float64
from std_srvs.srv import Trigger, TriggerResponse

from apad_bridge.assembly import flight_parts
from apad_bridge.ros.simulated_node.legacy_server import QUEUE, LegacyServer
from apad_bridge.ros.system.node import ned_frame
from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_apad
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.generation_a.messages import GoalOrder
from apad_bridge.world.generation_a.simulated_messages import (
    BatteryAndProgressPublished,
    GoalEnded,
    GoalOutcome,
    HeldPositionPublished,
    Published,
)
from apad_bridge.world.generation_a.vehicle import GenerationAVehicle
from apad_bridge.world.simulated_stack import PosePublished

use_generated_messages()

from apad.msg import aPadAction, aPadFeedback, aPadResult  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402
from misc_msgs.srv import (  # noqa: E402
    ChangeDockingStatus,
    ChangeDockingStatusResponse,
    GetChargeInfo,
    GetChargeInfoResponse,
    GetDockingInfo,
    GetDockingInfoResponse,
    SendEnergy,
    SendEnergyResponse,
)
from navcon_msgs.srv import (  # noqa: E402
    ConfigureVelocityController,
    ConfigureVelocityControllerResponse,
    EnableControl,
    EnableControlResponse,
)

_HELD_STATUS, _RELEASED_STATUS = 0, 1


class Server(LegacyServer[GenerationAVehicle]):
    """Serves the aPad called `name`. The action server's lock guards the vehicle. The node is initialised before."""

    def __init__(
        self, name: str, make_vehicle: Callable[[int], GenerationAVehicle], frame: LocalFrame
    ) -> None:
        self._goals: dict[str, Any] = {}
        """Handles of the goals that have not ended, by key."""
        self._held: dict[str, rospy.Publisher] = {}
        # Its own status timer would sleep on ROS time: `_show` publishes the status each second instead.
        rospy.set_param("~actionlib_status_frequency", 0.0)
        self._server = ActionServer(
            of_apad(name, "action_server"),
            aPadAction,
            self._take_goal,
            self._cancel_goal,
            auto_start=False,
        )
        super().__init__(name, make_vehicle, self._server.lock, frame)
        self._battery = rospy.Publisher(of_apad(name, "battery_level"), Float64, queue_size=QUEUE)
        self._server.start()
        self._offer_services(name)

    @classmethod
    def of_scenario(cls, scenario: Scenario, held: Mapping[int, int]) -> Self:
        """A goal of generation A has no field for speed or victory radius: both are the scenario's mission's."""
        apad, mission = scenario.apad, scenario.mission
        return cls(
            apad.name,
            lambda start_ms: GenerationAVehicle(
                flight_parts.simulated_hull(scenario, held),
                mission.speed_m_s,
                mission.victory_radius_m,
                start_ms,
                apad.fault,
                flight_parts.misses(scenario),
            ),
            LocalFrame.about(scenario.area.origin),
        )

    def _offer_services(self, apad: str) -> None:
        """Anchoring and `DEPTH_enable` succeed without an effect: this vehicle floats, and holds by itself."""
        services: list[tuple[str, Any, Callable[[Any], Any]]] = [
            ("check_docking_availability", GetDockingInfo, self._answer_docks),
            ("change_docking_status", ChangeDockingStatus, self._change_dock),
            ("get_battery_level", GetChargeInfo, self._answer_battery),
            ("charge_info", GetChargeInfo, self._answer_battery),
            ("anchor", Trigger, lambda _: TriggerResponse(True, "it holds its position by itself")),
            ("FADP_enable", EnableControl, self._enables(GenerationAVehicle.enable_position_control)),
            ("DEPTH_enable", EnableControl, lambda _: EnableControlResponse()),
            ("send_energy", SendEnergy, self._send_energy),
            ("VelCon_enable", EnableControl, self._enables(GenerationAVehicle.enable_velocity_control)),
            ("ConfigureVelocityController", ConfigureVelocityController, self._configure_axes),
        ]
        for name, kind, answer in services:
            rospy.Service(of_apad(apad, name), kind, answer)
        for name, sign in (("charging", 1), ("draining", -1)):
            rospy.Subscriber(of_apad(apad, name), Float64, self._change_battery, sign)

    def _enables(
        self, act: Callable[[GenerationAVehicle, bool, int], list[Published]]
    ) -> Callable[[Any], Any]:
        def answer(request: Any) -> Any:
            self._do(lambda it: act(it, request.enable, it.now_ms))
            return EnableControlResponse()

        return answer

    def _configure_axes(self, request: Any) -> Any:
        self._do(lambda it: it.configure_axes(request.desired_mode, it.now_ms))
        return ConfigureVelocityControllerResponse()

    def _take_goal(self, handle: Any) -> None:
        message, key = handle.get_goal(), handle.get_goal_id().id
        with self._lock:
            if (vehicle := self._vehicle) is None:
                handle.set_rejected(None, "no /clock came yet")
                return
            if vehicle.has_crashed:
                return
            handle.set_accepted()
            self._goals[key] = handle
            goal = GoalOrder(
                key, message.id, message.pose.position.x, message.pose.position.y, message.object
            )
            self._show(vehicle.receive(goal, vehicle.now_ms))

    def _cancel_goal(self, handle: Any) -> None:
        self._do(lambda it: it.cancel(handle.get_goal_id().id, it.now_ms))

    def _show(self, shown: list[Published]) -> None:
        for item in shown:
            match item:
                case PosePublished(at_ms, pose):
                    self._publish_pose(self._position, at_ms, pose)
                    self._publish_pose(self._state, at_ms, pose)
                case HeldPositionPublished():
                    self._publish_held(item)
                case BatteryAndProgressPublished(_, battery_percent, goal_key, covered_percent):
                    self._battery.publish(Float64(battery_percent))
                    self._publish_progress(goal_key, covered_percent)
                case GoalEnded():
                    self._end_goal(item)

    def _publish_held(self, held: HeldPositionPublished) -> None:
        publisher = self._held.get(held.name)
        if publisher is None:
            try:
                # Global, as in the published stack: below the name in the goal, and not below this node's namespace.
                # Latched, because subscribers connect only after the first message is out.
                publisher = rospy.Publisher(
                    f"/{held.name}/position_static", NavSts, queue_size=QUEUE, latch=True
                )
            except ValueError as refused:  # a goal may name anything
                rospy.logwarn_throttle(10, f"an object is named {held.name!r}: {refused}")
                return
            self._held[held.name] = publisher
        message = NavSts()
        message.header.stamp = to_ros(held.at_ms)
        message.header.frame_id = ned_frame()
        message.position.north, message.position.east = held.north_m, held.east_m
        message.status = _RELEASED_STATUS if held.released else _HELD_STATUS
        publisher.publish(message)

    def _publish_progress(self, goal_key: str | None, covered_percent: float) -> None:
        if (vehicle := self._vehicle) is not None and vehicle.has_crashed:
            return
        if (handle := self._goals.get(goal_key or "")) is not None:
            handle.publish_feedback(aPadFeedback(id=handle.get_goal().id, status=covered_percent))
        self._server.publish_status()

    def _end_goal(self, ended: GoalEnded) -> None:
        if (handle := self._goals.pop(ended.key, None)) is None:
            return
        result = aPadResult(
            id=handle.get_goal().id, status=0 if ended.outcome is GoalOutcome.SUCCEEDED else 1
        )
        match ended.outcome:
            case GoalOutcome.SUCCEEDED:
                handle.set_succeeded(result, ended.reason)
            case GoalOutcome.PREEMPTED:
                handle.set_canceled(result, ended.reason)
            case GoalOutcome.ABORTED:
                handle.set_aborted(result, ended.reason)

    def _answer_docks(self, _: Any) -> Any:
        with self._lock:
            vehicle = self._running()
            return GetDockingInfoResponse(available_slots=vehicle.free_docks, slots=vehicle.held)

    def _change_dock(self, request: Any) -> Any:
        with self._lock:
            vehicle = self._running()
            try:
                self._show(vehicle.set_dock(request.slot, request.status, vehicle.now_ms))
            except ValueError as refused:
                raise rospy.ServiceException(str(refused)) from refused
            return ChangeDockingStatusResponse(False)

    def _change_battery(self, message: Any, sign: int) -> None:
        """Changes the charge by the message's percent points."""
        self._do(lambda it: it.change_battery(sign * message.data, it.now_ms))

    def _send_energy(self, request: Any) -> Any:
        """True when the dock of coil `coil` holds an aMussel. The docks charge by themselves."""
        with self._lock:
            vehicle = self._running()
            return SendEnergyResponse(
                request.coil in vehicle.dock_indices and request.coil not in vehicle.free_docks
            )

    def _answer_battery(self, _: Any) -> Any:
        with self._lock:
            vehicle = self._running()
            pose = vehicle.pose
            return GetChargeInfoResponse(
                battery_level=vehicle.battery_percent,
                x=pose.north_m,
                y=pose.east_m,
                z=0.0,
                type="charger",
                consumers=vehicle.held,
            )
