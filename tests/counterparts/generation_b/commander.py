"""The commander: services and the go2point action, one primitive at a time, statuses and eventString.

Everything here but the ROS threads' hand-over runs in the one worker thread.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import actionlib
import rospy
from geometry_msgs.msg import Point
from misc_msgs.srv import (
    DockingPrimitiveService,
    DockingService,
    DynamicPositioningPrimitiveService,
    Go2pointPrimitiveService,
    Go2pointService,
)
from navcon_msgs.msg import GoToPointAction, GoToPointFeedback, GoToPointGoal, GoToPointResult
from primitives import SEARCH_WAIT, Docking, DynamicPositioning, End, GoToPoint, Ports, Primitive
from std_msgs.msg import Int32, String
from std_srvs.srv import Trigger, TriggerResponse
from worker import After, Stopped, Worker

IDLE, RUNNING, PREEMPTED, DONE = 0, 1, 2, 3  # facts B: goto_status and docking_status
SIMPLE_RADIUS = 1.5  # m; facts B: commander/go2point, "radius fixed at 1.5 m"
FINISHED = "/PRIMITIVE_FINISHED"  # facts B: eventString


class Commander:
    """Owns the active primitive and answers the services of generation B."""

    def __init__(
        self,
        worker: Worker,
        ports: Ports,
        alive: Callable[[], bool],
        servo_block: float,
        search_wait_after: bool,
    ) -> None:
        self.worker, self.ports, self.alive = worker, ports, alive
        self.servo_block, self.search_wait_after = servo_block, search_wait_after
        self.active: Primitive | None = None
        self.paused: Primitive | None = None
        self.status = {"goto": IDLE, "docking": IDLE}
        self.status_pubs = {
            key: rospy.Publisher(f"{key}_status", Int32, queue_size=10) for key in self.status
        }
        self.event_pub = rospy.Publisher("eventString", String, queue_size=10)
        self.action = actionlib.ActionServer(
            "go2point", GoToPointAction, self._goal, self._cancel, auto_start=False
        )

    def open(self) -> None:
        """Offer the services and the action."""
        primitives, simple = "commander/primitive/", "commander/"
        for name, kind, handler in (
            (primitives + "go2point", Go2pointPrimitiveService, self.go2point),
            (
                primitives + "dynamic_positioning",
                DynamicPositioningPrimitiveService,
                self.dynamic_positioning,
            ),
            (primitives + "docking", DockingPrimitiveService, self.docking),
            (simple + "go2point", Go2pointService, self.simple_go2point),
            (simple + "docking", DockingService, self.simple_docking),
            (simple + "stop_mission", Trigger, self.stop_mission),
            (simple + "pause_mission", Trigger, self.pause_mission),
            (simple + "continue_mission", Trigger, self.continue_mission),
        ):
            rospy.Service(name, kind, self._in_turn(handler))
        self.action.start()

    def _in_turn(self, handler: Callable[[Any], tuple[Any, After]]) -> Callable[[Any], Any]:
        """A service handler that waits for its turn at the worker."""

        def serve(request: Any) -> Any:
            try:
                return self.worker.call(lambda: handler(request))
            except Stopped as error:
                raise rospy.ServiceException(str(error)) from error

        return serve

    # --- the services; each returns its answer and what follows it ---

    def go2point(self, request: Any) -> tuple[bool, After]:
        """commander/primitive/go2point: metres, m/s, radians; true at once (facts B)."""
        if request.heading_topic or request.speed_topic:
            rospy.logwarn("go2point: heading_topic and speed_topic are not supported")
            return False, None
        return self._accept(
            GoToPoint(
                request.point.x,
                request.point.y,
                request.speed,
                request.victory_radius,
                request.fully_actuated_enable,
                request.heading if request.heading_enable else None,
                request.north_enable,
                request.east_enable,
            )
        )

    def simple_go2point(self, request: Any) -> tuple[bool, After]:
        """commander/go2point: the point in metres and a speed in m/s; fully actuated, radius 1.5 m."""
        return self._accept(GoToPoint(request.point.x, request.point.y, request.speed, SIMPLE_RADIUS))

    def dynamic_positioning(self, request: Any) -> tuple[bool, After]:
        """commander/primitive/dynamic_positioning: metres and radians; axes not enabled are left alone."""
        if request.target_topic_enable or request.track_heading_enable:
            rospy.logwarn("dynamic_positioning: following topics is not supported")
            return False, None
        if not all(math.isfinite(v) for v in (request.north, request.east, request.heading)):
            return False, None
        return self._accept(
            DynamicPositioning(
                request.north if request.north_enable else None,
                request.east if request.east_enable else None,
                request.heading if request.heading_enable else None,
                request.point_to_target,
            )
        )

    def docking(self, request: Any) -> tuple[bool, After]:
        """commander/primitive/docking: true at once, then the servo blocks this thread (facts B)."""
        return self._dock(
            request.docking_action,
            request.docking_slot,
            request.search_yaw_rate,
            request.max_yaw_rate,
            request.max_surge_speed,
            request.surge_stdev,
        )

    def simple_docking(self, request: Any) -> tuple[bool, After]:
        """commander/docking: action and slot with the vehicle's own rates."""
        return self._dock(request.docking_action, request.docking_slot)

    def _dock(self, dock: bool, slot: int, *rates: float) -> tuple[bool, After]:
        if slot >= len(SEARCH_WAIT):
            rospy.logwarn("docking: there is no slot %d", slot)
            return False, None
        wait = SEARCH_WAIT[slot] if dock and self.search_wait_after else 0.0
        return self._accept(Docking(dock, slot, self.servo_block, wait, *rates))

    def stop_mission(self, _: Any) -> tuple[TriggerResponse, After]:
        """Pre-empt what runs and forget what was paused; the controllers are off afterwards."""
        was = type(self.active).__name__ if self.active else "nothing"
        self.paused = None
        self._end(End.PREEMPTED)
        return TriggerResponse(True, f"stopped, {was} was running"), None

    def pause_mission(self, _: Any) -> tuple[TriggerResponse, After]:
        """Pre-empt go-to or docking and hold the place it is at."""
        if self.active is None or isinstance(self.active, DynamicPositioning):
            return TriggerResponse(False, "no mission is running"), None
        paused, nav = self.active, self.ports.boat.nav()
        self._begin(DynamicPositioning(nav.north, nav.east, nav.yaw))
        self.paused = None if paused.handle else paused
        return TriggerResponse(True, "paused"), None

    def continue_mission(self, _: Any) -> tuple[TriggerResponse, After]:
        """Start what was paused anew."""
        if self.paused is None:
            return TriggerResponse(False, "nothing is paused"), None
        paused = self.paused
        return TriggerResponse(True, "continued"), lambda: self._begin(paused)

    def _accept(self, primitive: Primitive) -> tuple[bool, After]:
        if not self.alive():
            rospy.logwarn("the battery is empty")
            return False, None
        return True, lambda: self._begin(primitive)

    # --- the action go2point (navcon_msgs/GoToPointAction) ---

    def _goal(self, handle: Any) -> None:
        self.worker.post(lambda: (None, lambda: self._take_goal(handle)))

    def _cancel(self, handle: Any) -> None:
        self.worker.post(lambda: (None, lambda: self._cancel_goal(handle)))

    def _take_goal(self, handle: Any) -> None:
        """Accept a goal with constant references; T1 (the start) is not used."""
        goal: GoToPointGoal = handle.get_goal()
        if goal.ref_type != GoToPointGoal.CONSTANT or not self.alive():
            handle.set_rejected(GoToPointResult(), "only constant heading and speed, and only with a battery")
            return
        handle.set_accepted()
        actuated = goal.subtype != GoToPointGoal.GO2POINT_UA
        heading = goal.heading if goal.subtype == GoToPointGoal.GO2POINT_FA_HDG else None
        primitive = GoToPoint(
            goal.T2.point.x, goal.T2.point.y, goal.speed, goal.victory_radius, actuated, heading
        )
        primitive.handle = handle
        self._begin(primitive)

    def _cancel_goal(self, handle: Any) -> None:
        if self.active is not None and self.active.handle == handle:
            self._end(End.PREEMPTED)

    def _close_goal(self, primitive: GoToPoint, end: End) -> None:
        nav = self.ports.boat.nav()
        result = GoToPointResult(distance=primitive.distance, bearing=primitive.bearing)
        result.position.header.frame_id = "local"
        result.position.point = Point(nav.north, nav.east, 0.0)
        close = {End.DONE: primitive.handle.set_succeeded, End.ABORTED: primitive.handle.set_aborted}
        close.get(end, primitive.handle.set_canceled)(result)

    # --- the active primitive ---

    def _begin(self, primitive: Primitive) -> None:
        """Pre-empt the active primitive and start this one; blocks as long as the primitive does."""
        self._end(End.PREEMPTED)
        self.paused = None
        self.active = primitive
        self._tell(primitive, RUNNING)
        primitive.servo(self.ports)
        self.worker.clock.sleep(primitive.block)
        primitive.begin(self.ports, self.worker.clock.now())

    def tick(self) -> None:
        """One control round of the active primitive."""
        now = self.worker.clock.now()
        self.ports.camera.take(now)
        if self.active is None:
            return
        end = self.active.step(self.ports, now) if self.alive() else End.ABORTED
        if end is not None:
            self._end(end)
        elif self.active.handle is not None:
            self.active.handle.publish_feedback(GoToPointFeedback(self.active.distance, self.active.bearing))

    def _end(self, end: End) -> None:
        """Facts B: every primitive's end switches the controllers off and is told on eventString."""
        primitive, self.active = self.active, None
        if primitive is None:
            return
        self.ports.boat.controllers_off()
        primitive.finish(self.ports)
        self._tell(primitive, DONE if end is End.DONE else PREEMPTED)
        if primitive.handle is not None:
            self._close_goal(primitive, end)
        self.event_pub.publish(FINISHED)
        rospy.loginfo("%s ended: %s", type(primitive).__name__, end.value)

    def _tell(self, primitive: Primitive, status: int) -> None:
        if primitive.channel is not None:
            self.status[primitive.channel] = status
            self.status_pubs[primitive.channel].publish(status)

    def repeat_statuses(self) -> None:
        """Publish both statuses again (the telemetry's 1 Hz)."""
        for channel, status in self.status.items():
            self.status_pubs[channel].publish(status)
