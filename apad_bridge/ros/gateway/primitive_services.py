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

import actionlib
import rospy

from apad_bridge.mission.call_queue import CallQueue, Snapshot
from apad_bridge.mission.flight_mission import FlightMission
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.script_values import Refused, Status, dock_index_of, manoeuvre_of
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import ours_of_apad
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.run_options import BenchPart, RunOptions
from apad_bridge.scenario.schema import Scenario

use_generated_messages()

from musselbed_msgs.msg import (  # noqa: E402
    DockingAction,
    DockingFeedback,
    DockingResult,
    GoToAction,
    GoToFeedback,
    GoToResult,
)
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

# The two long primitives as actions that last until their end: `go_to` and `docking` below /musselbed/NAME.
_LOOK_S = 1.0
_REPLACED = "another order took its place"


def docking_act(request: Any, *, dock: bool) -> Callable[[ManualMission], None]:
    """The mission's part of a goal or request to dock, or undock."""

    def act(mission: ManualMission) -> None:
        dock_index = dock_index_of(request.number, mission.state.dock_count)
        manoeuvre = manoeuvre_of(request.max_yaw_rate_rad_s or None, request.max_surge_m_s or None)
        if dock:
            mission.dock(dock_index, request.id, manoeuvre)
        else:
            mission.undock(dock_index, manoeuvre)

    return act


class PrimitiveActions:
    """A thread of actionlib for each orders through the call queue, and follows the primitive at every tick."""

    def __init__(self, command_source: CallQueue, apad: str) -> None:
        self._command_source = command_source
        self._go_to = actionlib.SimpleActionServer(
            ours_of_apad(apad, "go_to"), GoToAction, self._run_go_to, auto_start=False
        )
        self._docking = actionlib.SimpleActionServer(
            ours_of_apad(apad, "docking"), DockingAction, self._run_docking, auto_start=False
        )
        self._go_to.start()
        self._docking.start()

    def _run_go_to(self, goal: Any) -> None:
        def act(mission: ManualMission) -> int:
            mission.go_to(goal.north_m, goal.east_m, goal.speed_m_s or None, goal.victory_radius_m or None)
            return mission.goto_orders

        def look(now: Snapshot, order: int) -> tuple[Status, bool]:
            if now.goto_m is not None:
                self._go_to.publish_feedback(GoToFeedback(distance_m=now.goto_m))
            return now.goto, now.goto_order == order

        self._run(self._go_to, GoToResult, act, look)

    def _run_docking(self, goal: Any) -> None:
        def act(mission: ManualMission) -> int:
            docking_act(goal, dock=goal.dock)(mission)
            return mission.docking_orders

        def look(now: Snapshot, order: int) -> tuple[Status, bool]:
            self._docking.publish_feedback(DockingFeedback(status=int(now.docking)))
            return now.docking, now.docking_order == order

        self._run(self._docking, DockingResult, act, look)

    def _run(
        self,
        server: Any,
        result: Any,
        act: Callable[[ManualMission], int],
        look: Callable[[Snapshot, int], tuple[Status, bool]],
    ) -> None:
        try:
            order = self._command_source.call(act)
        except Refused as refused:
            server.set_aborted(result(status=int(Status.FAILED), message=str(refused)), str(refused))
            return
        while not rospy.is_shutdown():
            now = self._command_source.wait(_LOOK_S)
            if (reason := self._command_source.ended_by) is not None:
                server.set_aborted(
                    result(status=int(Status.PREEMPTED), message=f"the mission is over: {reason}")
                )
                return
            if server.is_preempt_requested():
                self._hold()
                server.set_preempted(result(status=int(Status.PREEMPTED), message="cancelled"))
                return
            status, is_ours = look(now, order)
            if not is_ours or status is Status.PREEMPTED:
                server.set_preempted(result(status=int(Status.PREEMPTED), message=_REPLACED), _REPLACED)
                return
            if status is Status.DONE:
                server.set_succeeded(result(status=int(status), message=""))
                return
            if status is Status.FAILED:
                why = now.failure or ""
                server.set_aborted(result(status=int(status), message=why), why)
                return

    def _hold(self) -> None:
        try:
            self._command_source.call(lambda mission: mission.hold())
        except Refused as refused:
            rospy.logwarn("musselbed: a cancelled action could not stop the aPad: %s", refused)


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
            rospy.Service(below("dock"), Dock, partial(self._move_dock, DockResponse, dock=True)),
            rospy.Service(below("undock"), Undock, partial(self._move_dock, UndockResponse, dock=False)),
            *(
                rospy.Service(below(name), Trigger, partial(self._trigger, act))
                for name, act in (
                    ("take_over", FlightMission.take_over),
                    ("give_back", FlightMission.give_back),
                )
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

    def _move_dock(self, response: Any, request: Any, *, dock: bool) -> Any:
        return self._answered(response, docking_act(request, dock=dock))

    def _answered(self, response: Any, act: ServiceAct) -> Any:
        try:
            self._command_source.call(act)
        except Refused as refused:
            return response(accepted=False, message=str(refused))
        return response(accepted=True, message="")

    def _trigger(self, act: Callable[[FlightMission], str], _: Any) -> Any:
        """Answers with the text that the call returns."""
        try:
            return TriggerResponse(success=True, message=self._command_source.call_mission(act))
        except Refused as refused:
            return TriggerResponse(success=False, message=str(refused))

    def _show(self, snapshot: Snapshot) -> None:
        now = (int(snapshot.goto), int(snapshot.docking))
        if now != self._published:
            self._published = now
            self._goto_status.publish(Int32(now[0]))
            self._docking_status.publish(Int32(now[1]))
