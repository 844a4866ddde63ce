"""The two long primitives as actions that last until their end: `go_to` and `docking` below /musselbed/NAME."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import actionlib
import rospy

from apad_bridge.mission.call_queue import CallQueue, Snapshot
from apad_bridge.mission.manual import ManualMission
from apad_bridge.mission.values import Refused, Status, dock_index_of, manoeuvre_of
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import ours_of_apad

use_generated_messages()

from musselbed_msgs.msg import (  # noqa: E402
    DockingAction,
    DockingFeedback,
    DockingResult,
    GoToAction,
    GoToFeedback,
    GoToResult,
)

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
