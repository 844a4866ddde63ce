"""Mission primitives as services and actions of ours, over any aPad: for a person's command line, and for programs.

They are below /musselbed/NAME, the aPad's name, and take orders while no planner does: in a flight by hand (`--manual`),
beside a script, or when a person has taken the mission over (`take_over`, and `give_back`). A service answers when the
order is taken, at the next mission tick; `goto_status` and `docking_status`, or the actions, report the end. Zeros, which
`rosservice call` sends for fields left out, mean the scenario's own numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import rospy

from apad_bridge.mission.call_queue import CallQueue, Snapshot
from apad_bridge.mission.flight_mission import FlightMission
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.values import Refused
from apad_bridge.ros.gateway.primitive_actions import PrimitiveActions, docking_act
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import ours_of_apad
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.run_options import BenchPart, RunOptions
from apad_bridge.scenario.schema import Scenario

use_generated_messages()

from musselbed_msgs.srv import (  # noqa: E402
    Dock,
    DockResponse,
    GoToPoint,
    GoToPointResponse,
    GoToPosition,
    GoToPositionResponse,
    HoldPosition,
    HoldPositionResponse,
    Undock,
    UndockResponse,
)
from std_msgs.msg import Int32  # noqa: E402
from std_srvs.srv import Trigger, TriggerResponse  # noqa: E402

ServiceAct = Callable[[ManualMission], None]


@contextmanager
def primitives_offered(scenario: Scenario, options: RunOptions) -> Iterator[CallQueue | None]:
    """Offers the services, and yields their call queue; None where no aPad is flown, or none may move."""
    if options.part is BenchPart.FLEET or options.dry_run:
        yield None
        return
    command_source = CallQueue()
    services = PrimitiveServices(command_source, LocalFrame.about(scenario.area.origin), scenario.apad.name)
    try:
        yield command_source
    finally:
        command_source.close("the flight is over")
        services.close()


class PrimitiveServices:
    """On the graph until `close`. Its handlers run in rospy's threads and put every order on the call queue."""

    def __init__(self, command_source: CallQueue, frame: LocalFrame, apad: str) -> None:
        below = partial(ours_of_apad, apad)
        self._command_source = command_source
        self._frame = frame
        self._published = (-1, -1)
        self._goto_status = rospy.Publisher(below("goto_status"), Int32, queue_size=10, latch=True)
        self._docking_status = rospy.Publisher(below("docking_status"), Int32, queue_size=10, latch=True)
        self._services = [
            rospy.Service(below("go_to_point"), GoToPoint, self._go_to_point),
            rospy.Service(below("go_to_position"), GoToPosition, self._go_to_position),
            rospy.Service(below("hold_position"), HoldPosition, self._hold_position),
            rospy.Service(below("dock"), Dock, self._dock),
            rospy.Service(below("undock"), Undock, self._undock),
            rospy.Service(
                below("take_over"), Trigger, self._mission_trigger(lambda mission: mission.take_over())
            ),
            rospy.Service(
                below("give_back"), Trigger, self._mission_trigger(lambda mission: mission.give_back())
            ),
        ]
        self._actions = PrimitiveActions(command_source, apad)
        command_source.listen(self._show)

    def close(self) -> None:
        for service in self._services:
            service.shutdown("the flight is over")

    def _go_to_point(self, request: Any) -> Any:
        return self._answered(
            GoToPointResponse,
            lambda mission: mission.go_to(
                request.north_m, request.east_m, request.speed_m_s or None, request.victory_radius_m or None
            ),
        )

    def _go_to_position(self, request: Any) -> Any:
        try:
            north_m, east_m = self._frame.to_local(request.latitude, request.longitude)
        except ValueError as error:
            return GoToPositionResponse(accepted=False, message=str(error))
        return self._answered(
            GoToPositionResponse,
            lambda mission: mission.go_to(
                north_m, east_m, request.speed_m_s or None, request.victory_radius_m or None
            ),
        )

    def _hold_position(self, request: Any) -> Any:
        point = () if request.here else (request.north_m, request.east_m)
        return self._answered(HoldPositionResponse, lambda mission: mission.hold(*point))

    def _dock(self, request: Any) -> Any:
        return self._answered(DockResponse, docking_act(request, dock=True))

    def _undock(self, request: Any) -> Any:
        return self._answered(UndockResponse, docking_act(request, dock=False))

    def _answered(self, response: Any, act: ServiceAct) -> Any:
        try:
            self._command_source.call(act)
        except Refused as refused:
            return response(accepted=False, message=str(refused))
        return response(accepted=True, message="")

    def _mission_trigger(self, act: Callable[[FlightMission], str]) -> Callable[[Any], Any]:
        return lambda _: _triggered(lambda: self._command_source.call_mission(act))

    def _show(self, snapshot: Snapshot) -> None:
        now = (int(snapshot.goto), int(snapshot.docking))
        if now != self._published:
            self._published = now
            self._goto_status.publish(Int32(now[0]))
            self._docking_status.publish(Int32(now[1]))


def _triggered(call: Callable[[], str]) -> Any:
    """Answers with the text that the call returns."""
    try:
        text = call()
    except Refused as refused:
        return TriggerResponse(success=False, message=str(refused))
    return TriggerResponse(success=True, message=text)
