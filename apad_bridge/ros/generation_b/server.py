"""The topics and services of generation B, around a `GenerationBVehicle`. It only converts."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Self

import rospy
from std_msgs.msg import Bool, Float32, Float32MultiArray, Float64, Int32, String
from std_srvs.srv import Trigger, TriggerResponse

from apad_bridge.assembly import flight_parts
from apad_bridge.ros.generation_b.go2point import Go2Point
from apad_bridge.ros.simulated_node.legacy_server import QUEUE, LegacyServer
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros.types.workspace_services import service_to_offer
from apad_bridge.ros_names.names import of_apad, ours
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.generation_b.messages import PRIMITIVE_FINISHED, ServiceOrder
from apad_bridge.world.generation_b import simulated_messages
from apad_bridge.world.generation_b.simulated_messages import (
    ArmPublished,
    BatteryPublished,
    CameraTurned,
    Finished,
    GoToBegun,
    GoToEnded,
    GoToLeft,
    Published,
    StatusPublished,
)
from apad_bridge.world.generation_b.vehicle import GenerationBVehicle
from apad_bridge.world.simulated_stack import PosePublished

use_generated_messages()

from misc_msgs.srv import (  # noqa: E402
    DockingPrimitiveService,
    DockingService,
    DynamicPositioningPrimitiveService,
    Go2pointPrimitiveService,
    Go2pointService,
)
from musselbed_msgs.msg import DockAlert  # noqa: E402

Conversion = Callable[[Any], ServiceOrder]


class ServiceCallQueue:
    """Runs the calls of all services one after another, as roscpp's one thread does.

    roscpp drops a call whose connection has closed before its turn. rospy runs it: each connection has a thread of its own.
    """

    def __init__(self, blocks: Callable[[], bool]) -> None:
        self._blocks = blocks
        self._turn = threading.Condition()
        self._waiting: deque[object] = deque()

    def look(self) -> None:
        """Time has passed: the vehicle may no longer block."""
        with self._turn:
            self._turn.notify_all()

    def run(self, transport: Any, handle: Callable[[], None]) -> None:
        call = object()
        with self._turn:
            self._waiting.append(call)
            self._turn.wait_for(lambda: self._waiting[0] is call and not self._blocks())
        try:
            if not _has_closed(transport.socket):
                handle()
        finally:
            self.let_next(call)

    def let_next(self, call: object = None) -> None:
        """Ends the turn of `call`, or of whichever has it: one that never ends keeps nobody waiting."""
        with self._turn:
            if self._waiting and call in (None, self._waiting[0]):
                self._waiting.popleft()
            self._turn.notify_all()


def _has_closed(sock: Any) -> bool:
    with contextlib.suppress(BlockingIOError):
        try:
            return not sock.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except ConnectionError:
            return True
    return False


class QueuedService(rospy.Service):  # type: ignore[misc]
    """A service whose calls wait in `calls`."""

    def __init__(self, name: str, kind: Any, answer: Callable[[Any], Any], calls: ServiceCallQueue) -> None:
        self._calls = calls
        super().__init__(name, kind, answer)

    def _handle_request(self, transport: Any, request: Any) -> None:
        self._calls.run(transport, lambda: rospy.Service._handle_request(self, transport, request))


class Server(LegacyServer[GenerationBVehicle]):
    """Serves the aPad called `name`. The action server's lock guards the vehicle. The node is initialised before."""

    def __init__(
        self, name: str, make_vehicle: Callable[[int], GenerationBVehicle], frame: LocalFrame
    ) -> None:
        self._go2point = Go2Point(name, self._order, lambda: self._do(lambda it: it.stop(it.now_ms)))
        super().__init__(name, make_vehicle, self._go2point.lock, frame)
        self._calls = ServiceCallQueue(lambda: self._vehicle is not None and self._vehicle.blocks)
        self._ended = threading.Event()
        """Never set before the process ends: a service that hangs waits for it."""
        kinds: dict[str, Any] = {
            "battery_level": Float64,
            "goto_status": Int32,
            "docking_status": Int32,
            "eventString": String,
            "dock_out": Float32MultiArray,
            "kinect_out": Float32,
        }
        self._out = {
            leaf: rospy.Publisher(of_apad(name, leaf), kind, queue_size=QUEUE) for leaf, kind in kinds.items()
        }
        self._go2point.start()
        self._offer_services(name)
        self._listen(name)

    @classmethod
    def of_scenario(cls, scenario: Scenario, held: Mapping[int, int]) -> Self:
        apad = scenario.apad
        return cls(
            apad.name,
            lambda start_ms: GenerationBVehicle(
                flight_parts.simulated_hull(scenario, held), start_ms, apad.fault
            ),
            LocalFrame.about(scenario.area.origin),
        )

    def _offer_services(self, apad: str) -> None:
        """Offers each by the definition in the user's workspace, if that has the fields that are read."""
        services: list[tuple[str, Any, Conversion]] = [
            ("primitive/go2point", Go2pointPrimitiveService, simulated_messages.go_to),
            (
                "primitive/dynamic_positioning",
                DynamicPositioningPrimitiveService,
                simulated_messages.position,
            ),
            ("primitive/docking", DockingPrimitiveService, simulated_messages.docking),
            ("go2point", Go2pointService, simulated_messages.simple_go_to),
            ("docking", DockingService, simulated_messages.simple_docking),
        ]
        for name, known, convert in services:
            kind = service_to_offer(known, convert)
            self._offer(apad, name, kind, self._takes(convert, kind._response_class))
        for name, act in (
            ("stop_mission", GenerationBVehicle.stop),
            ("pause_mission", GenerationBVehicle.pause),
            ("continue_mission", GenerationBVehicle.go_on),
        ):
            self._offer(apad, name, Trigger, self._commands(act))

    def _offer(self, apad: str, name: str, kind: Any, answer: Callable[[Any], Any]) -> None:
        QueuedService(of_apad(apad, f"commander/{name}"), kind, answer, self._calls)

    def advance_to(self, now_ms: int) -> None:
        super().advance_to(now_ms)
        self._calls.look()

    def _listen(self, apad: str) -> None:
        def listen(name: str, kind: Any, take: Callable[[GenerationBVehicle, Any], list[Published]]) -> None:
            def taken(message: Any) -> None:
                self._do(lambda vehicle: take(vehicle, message))

            rospy.Subscriber(name, kind, taken, tcp_nodelay=True)

        listen(
            of_apad(apad, "docking_horizontal"),
            Float32,
            lambda it, message: it.detect(message.data, None, it.now_ms),
        )
        listen(
            of_apad(apad, "docking_vertical"),
            Float32,
            lambda it, message: it.detect(None, message.data, it.now_ms),
        )
        listen(of_apad(apad, "manual"), Bool, lambda it, message: it.set_manual(message.data, it.now_ms))
        listen(ours("dock"), DockAlert, lambda it, alert: it.load(alert.dock, alert.closed, it.now_ms))

    def _takes(self, convert: Conversion, response: Any) -> Callable[[Any], Any]:
        def take(request: Any) -> Any:
            with self._lock:
                self._running()
                taken = self._order(convert(request))
            if taken is None:
                self._calls.let_next()
                self._ended.wait()
            # It answers at once, before the outcome is known.
            return response(status=bool(taken))

        return take

    def _order(self, order: ServiceOrder) -> bool | None:
        """The answer of a service, None for never. Before the first /clock no order is taken."""
        if self._vehicle is None:
            return False
        self._show(self._vehicle.receive(order, self._vehicle.now_ms))
        return self._vehicle.takes

    def _commands(self, act: Callable[[GenerationBVehicle, int], list[Published]]) -> Callable[[Any], Any]:
        def answer(_: Any) -> Any:
            self._do(lambda it: act(it, it.now_ms))
            return TriggerResponse(False, "")  # by its source: the published commander sets neither field

        return answer

    def _show(self, shown: list[Published]) -> None:
        out = self._out
        for item in shown:
            match item:
                case PosePublished(at_ms, pose):
                    self._publish_pose(self._position, at_ms, pose)
                case BatteryPublished(_, percent):
                    out["battery_level"].publish(Float64(percent))
                    self._go2point.publish_status()
                case StatusPublished(_, docking, status):
                    out["docking_status" if docking else "goto_status"].publish(Int32(status))
                case ArmPublished(_, arm):
                    out["dock_out"].publish(Float32MultiArray(data=[float(it) for it in arm.is_open]))
                case CameraTurned(_, servo):
                    out["kinect_out"].publish(Float32(servo))
                case Finished():
                    out["eventString"].publish(String(PRIMITIVE_FINISHED))
                case GoToBegun() | GoToLeft() | GoToEnded():
                    self._go2point.show(item)
