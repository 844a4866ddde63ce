"""The topics and services of generation B, around a `GenerationBVehicle`: converts, and nothing else."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import rospy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool, Float32, Float32MultiArray, Float64, Int32, String
from std_srvs.srv import Trigger, TriggerResponse

from apad_bridge.ros.generation_b_shown import (
    ArmShown,
    BatteryShown,
    CameraTurned,
    Finished,
    PoseShown,
    Shown,
    StatusShown,
)
from apad_bridge.ros.generation_b_vehicle import GenerationBVehicle
from apad_bridge.ros.generation_b_words import (
    PRIMITIVE_FINISHED,
    DockingOrder,
    GoToOrder,
    Order,
    PositionOrder,
)
from apad_bridge.ros.messages import use_generated_messages
from apad_bridge.ros.names import CLOCK, of_apad, ours
from apad_bridge.ros.ros_time import to_ms, to_ros

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402
from misc_msgs.srv import (  # noqa: E402
    DockingPrimitiveService,
    DockingPrimitiveServiceResponse,
    DynamicPositioningPrimitiveService,
    DynamicPositioningPrimitiveServiceResponse,
    Go2pointPrimitiveService,
    Go2pointPrimitiveServiceResponse,
)
from musselbed_msgs.msg import DockAlert  # noqa: E402

_QUEUE = 200
"""Twenty seconds of the fastest topic: who reads slower loses the oldest, and nobody waits for it."""


class GenerationBServer:
    """All of the aPad called `name`. One lock guards the vehicle. The node is initialised before."""

    def __init__(self, name: str, make_vehicle: Callable[[int], GenerationBVehicle]) -> None:
        self.heard_clock_s = time.monotonic()
        self._make_vehicle = make_vehicle
        self._vehicle: GenerationBVehicle | None = None
        self._lock = threading.RLock()
        self._ended = threading.Event()
        """Never set before the process ends: what a service that hangs waits for."""
        kinds: dict[str, Any] = {
            "position": NavSts,
            "stateRef": NavSts,
            "battery_level": Float64,
            "goto_status": Int32,
            "docking_status": Int32,
            "eventString": String,
            "dock_out": Float32MultiArray,
            "kinect_out": Float32,
        }
        self._out = {
            leaf: rospy.Publisher(of_apad(name, leaf), kind, queue_size=_QUEUE)
            for leaf, kind in kinds.items()
        }
        self._offer_services(name)
        self._listen(name)

    def follow_clock(self) -> None:
        """From now on time is /clock's; otherwise somebody calls `advance_to`."""
        rospy.Subscriber(CLOCK, Clock, self._take_clock, tcp_nodelay=True)

    def _offer_services(self, apad: str) -> None:
        primitives: list[tuple[str, Any, Any, Callable[[Any], Order]]] = [
            ("go2point", Go2pointPrimitiveService, Go2pointPrimitiveServiceResponse, _go_to),
            (
                "dynamic_positioning",
                DynamicPositioningPrimitiveService,
                DynamicPositioningPrimitiveServiceResponse,
                _position,
            ),
            ("docking", DockingPrimitiveService, DockingPrimitiveServiceResponse, _docking),
        ]
        for name, kind, response, convert in primitives:
            rospy.Service(of_apad(apad, f"commander/primitive/{name}"), kind, self._takes(convert, response))
        for name, act in (
            ("stop_mission", GenerationBVehicle.stop),
            ("pause_mission", GenerationBVehicle.pause),
            ("continue_mission", GenerationBVehicle.go_on),
        ):
            rospy.Service(of_apad(apad, f"commander/{name}"), Trigger, self._commands(act))

    def _listen(self, apad: str) -> None:
        def act(take: Callable[[GenerationBVehicle, Any], list[Shown]]) -> Callable[[Any], None]:
            def taken(message: Any) -> None:
                with self._lock:
                    if self._vehicle is not None:
                        self._show(take(self._vehicle, message.data))

            return taken

        topics: list[tuple[str, Any, Callable[[GenerationBVehicle, Any], list[Shown]]]] = [
            ("docking_horizontal", Float32, lambda it, data: it.detect(data, None, it.now_ms)),
            ("docking_vertical", Float32, lambda it, data: it.detect(None, data, it.now_ms)),
            ("manual", Bool, lambda it, data: it.set_manual(data, it.now_ms)),
        ]
        for name, kind, take in topics:
            rospy.Subscriber(of_apad(apad, name), kind, act(take), tcp_nodelay=True)
        rospy.Subscriber(ours("dock"), DockAlert, self._take_load, tcp_nodelay=True)

    def _take_load(self, message: Any) -> None:
        with self._lock:
            if self._vehicle is not None:
                self._show(self._vehicle.load(message.slot, message.closed, self._vehicle.now_ms))

    def _take_clock(self, message: Any) -> None:
        self.heard_clock_s = time.monotonic()
        self.advance_to(to_ms(message.clock))

    def advance_to(self, now_ms: int) -> None:
        """Lets the vehicle's time pass to `now_ms`, tells what came of it, and says so last."""
        with self._lock:
            if self._vehicle is None:
                self._vehicle = self._make_vehicle(now_ms)
            if now_ms < self._vehicle.now_ms:
                # As when a supervisor was killed between two ticks and another one goes on from the earlier.
                rospy.logwarn_throttle(10, f"/clock went back to {now_ms} ms: not followed")
            else:
                self._show(self._vehicle.advance(now_ms))
            self._out["stateRef"].publish(_nav_sts(self._vehicle.now_ms, self._vehicle.pose))

    def _takes(self, convert: Callable[[Any], Order], response: Any) -> Callable[[Any], Any]:
        def take(request: Any) -> Any:
            with self._lock:
                if self._vehicle is None:
                    raise rospy.ServiceException("no /clock was heard yet")
                taken = self._vehicle.takes
                self._show(self._vehicle.receive(convert(request), self._vehicle.now_ms))
            if taken is None:
                self._ended.wait()
            # At once, and whatever comes of it.
            return response(status=bool(taken))

        return take

    def _commands(self, act: Callable[[GenerationBVehicle, int], list[Shown]]) -> Callable[[Any], Any]:
        def answer(_: Any) -> Any:
            with self._lock:
                if self._vehicle is not None:
                    self._show(act(self._vehicle, self._vehicle.now_ms))
            return TriggerResponse(True, "")

        return answer

    def _show(self, shown: list[Shown]) -> None:
        out = self._out
        for item in shown:
            match item:
                case PoseShown(at_ms, pose):
                    out["position"].publish(_nav_sts(at_ms, pose))
                case BatteryShown(_, percent):
                    out["battery_level"].publish(Float64(percent))
                case StatusShown(_, docking, status):
                    out["docking_status" if docking else "goto_status"].publish(Int32(status))
                case ArmShown(_, arm):
                    out["dock_out"].publish(Float32MultiArray(data=[float(it) for it in arm.is_open]))
                case CameraTurned(_, servo):
                    out["kinect_out"].publish(Float32(servo))
                case Finished():
                    out["eventString"].publish(String(PRIMITIVE_FINISHED))


def _nav_sts(at_ms: int, pose: Any) -> Any:
    """Global position, origin, variances and status stay 0, as the published simulator leaves them."""
    message = NavSts()
    message.header.stamp = to_ros(at_ms)
    message.header.frame_id = "local"
    message.position.north, message.position.east = pose.north_m, pose.east_m
    message.gbody_velocity.x, message.gbody_velocity.y = pose.north_m_s, pose.east_m_s
    message.orientation.yaw = pose.heading_rad
    return message


def _go_to(request: Any) -> Order:
    return GoToOrder(request.point.x, request.point.y, request.speed, request.victory_radius)


def _position(request: Any) -> Order:
    return PositionOrder(request.north, request.east, request.heading if request.heading_enable else None)


def _docking(request: Any) -> Order:
    return DockingOrder(
        request.docking_action,
        request.docking_slot,
        request.search_yaw_rate,
        request.max_yaw_rate,
        request.max_surge_speed,
        request.surge_stdev,
    )
