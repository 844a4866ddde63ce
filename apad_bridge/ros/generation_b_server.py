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

from apad_bridge.ros import generation_b_requests as requests
from apad_bridge.ros.generation_b_go2point import Go2Point
from apad_bridge.ros.generation_b_shown import (
    ArmShown,
    BatteryShown,
    CameraTurned,
    Finished,
    GoToBegun,
    GoToEnded,
    GoToLeft,
    PoseShown,
    Shown,
    StatusShown,
)
from apad_bridge.ros.generation_b_vehicle import GenerationBVehicle
from apad_bridge.ros.generation_b_words import PRIMITIVE_FINISHED, Order
from apad_bridge.ros.messages import use_generated_messages
from apad_bridge.ros.names import CLOCK, of_apad, ours
from apad_bridge.ros.ros_time import to_ms, to_ros
from apad_bridge.ros.their_services import service_to_offer

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402
from misc_msgs.srv import (  # noqa: E402
    DockingPrimitiveService,
    DockingService,
    DynamicPositioningPrimitiveService,
    Go2pointPrimitiveService,
    Go2pointService,
)
from musselbed_msgs.msg import DockAlert  # noqa: E402

Conversion = Callable[[Any], Order]

_QUEUE = 200
"""Twenty seconds of the fastest topic: who reads slower loses the oldest, and nobody waits for it."""


class GenerationBServer:
    """All of the aPad called `name`. One lock, the action server's, guards the vehicle. The node is initialised before."""

    def __init__(self, name: str, make_vehicle: Callable[[int], GenerationBVehicle]) -> None:
        self.heard_clock_s = time.monotonic()
        self._make_vehicle = make_vehicle
        self._vehicle: GenerationBVehicle | None = None
        self._go2point = Go2Point(name, self._order, self._stop)
        self._lock = self._go2point.lock
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
        self._go2point.start()
        self._offer_services(name)
        self._listen(name)

    def follow_clock(self) -> None:
        """From now on time is /clock's; otherwise somebody calls `advance_to`."""
        rospy.Subscriber(CLOCK, Clock, self._take_clock, tcp_nodelay=True)

    def _offer_services(self, apad: str) -> None:
        """Each by the text in the user's workspace, where that has what is read of it."""
        services: list[tuple[str, Any, Conversion]] = [
            ("primitive/go2point", Go2pointPrimitiveService, requests.go_to),
            ("primitive/dynamic_positioning", DynamicPositioningPrimitiveService, requests.position),
            ("primitive/docking", DockingPrimitiveService, requests.docking),
            ("go2point", Go2pointService, requests.simple_go_to),
            ("docking", DockingService, requests.simple_docking),
        ]
        for name, known, convert in services:
            kind = service_to_offer(known, convert)
            rospy.Service(
                of_apad(apad, f"commander/{name}"), kind, self._takes(convert, kind._response_class)
            )
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

    def _takes(self, convert: Conversion, response: Any) -> Callable[[Any], Any]:
        def take(request: Any) -> Any:
            with self._lock:
                if self._vehicle is None:
                    raise rospy.ServiceException("no /clock was heard yet")
                taken = self._order(convert(request))
            if taken is None:
                self._ended.wait()
            # At once, and whatever comes of it.
            return response(status=bool(taken))

        return take

    def _order(self, order: Order) -> bool | None:
        """What a service answers, None for never. Before any /clock nothing is taken."""
        if self._vehicle is None:
            return False
        self._show(self._vehicle.receive(order, self._vehicle.now_ms))
        return self._vehicle.takes

    def _stop(self) -> None:
        if self._vehicle is not None:
            self._show(self._vehicle.stop(self._vehicle.now_ms))

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
                    self._go2point.tell_status()
                case StatusShown(_, docking, status):
                    out["docking_status" if docking else "goto_status"].publish(Int32(status))
                case ArmShown(_, arm):
                    out["dock_out"].publish(Float32MultiArray(data=[float(it) for it in arm.is_open]))
                case CameraTurned(_, servo):
                    out["kinect_out"].publish(Float32(servo))
                case Finished():
                    out["eventString"].publish(String(PRIMITIVE_FINISHED))
                case GoToBegun() | GoToLeft() | GoToEnded():
                    self._go2point.show(item)


def _nav_sts(at_ms: int, pose: Any) -> Any:
    """Global position, origin, variances and status stay 0, as the published simulator leaves them."""
    message = NavSts()
    message.header.stamp = to_ros(at_ms)
    message.header.frame_id = "local"
    message.position.north, message.position.east = pose.north_m, pose.east_m
    message.gbody_velocity.x, message.gbody_velocity.y = pose.north_m_s, pose.east_m_s
    message.orientation.yaw = pose.heading_rad
    return message
