"""Orders the simulated aPad of generation B by services, simple services and its action; prints the outcomes as JSON.

Use: order_by_every_road.py NORTH EAST, near the aPad, on the master at ROS_MASTER_URI, where its node and a /clock run.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import rospy
from actionlib.action_client import ActionClient, CommState
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Point
from programs import wait_until
from std_msgs.msg import Int32, String

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from misc_msgs.srv import (  # noqa: E402
    DockingService,
    DynamicPositioningPrimitiveService,
    Go2pointPrimitiveService,
    Go2pointService,
)
from navcon_msgs.msg import (  # noqa: E402
    GoToPointAction,
    GoToPointActionFeedback,
    GoToPointActionResult,
    GoToPointGoal,
)


class Goal:
    """A goal of the action that has begun."""

    def __init__(self, client: ActionClient, north_m: float, east_m: float) -> None:
        goal = GoToPointGoal(speed=0.5, victory_radius=0.5)
        goal.T2.point.x, goal.T2.point.y = north_m, east_m
        self.handle = client.send_goal(goal)
        wait_until(lambda: self.handle.get_comm_state() in (CommState.ACTIVE, CommState.DONE))

    def state(self) -> str:
        """At its end."""
        wait_until(lambda: self.handle.get_comm_state() == CommState.DONE)
        return str(GoalStatus.to_string(self.handle.get_goal_status()))


def main() -> None:
    north_m, east_m = map(float, sys.argv[1:])
    rospy.init_node("bench", disable_signals=True)
    came: dict[str, list[Any]] = {}

    def listen(topic: str, kind: Any) -> list[Any]:
        rospy.Subscriber(f"/apad1/{topic}", kind, came.setdefault(topic, []).append)
        return came[topic]

    def call(service: str, kind: Any, **request: Any) -> bool:
        answer = rospy.ServiceProxy(f"/apad1/commander/{service}", kind)(**request)
        return bool(answer.status if hasattr(answer, "status") else answer.success)

    status, docking = listen("goto_status", Int32), listen("docking_status", Int32)
    events, results = listen("eventString", String), listen("go2point/result", GoToPointActionResult)
    # Not the client's: it receives no feedback after the result, and topics keep no order.
    feedback = listen("go2point/feedback", GoToPointActionFeedback)
    client = ActionClient("/apad1/go2point", GoToPointAction)
    assert client.wait_for_server()
    wait_until(lambda: status and docking)

    there = Goal(client, north_m + 3, east_m)
    told: dict[str, Any] = {"by action": there.state(), "distance_m": there.handle.get_result().distance}
    wait_until(lambda: feedback[-1].feedback.distance < 0.6 and events and status[-1].data == 3)
    told["feedback_m"] = [it.feedback.distance for it in feedback]
    told["events"] = [it.data for it in events]

    far = Goal(client, north_m + 90, east_m)
    told["taken"] = [call("go2point", Go2pointService, point=Point(north_m, east_m + 3, 0), speed=0.5)]
    told["then by simple service"] = far.state()
    wait_until(lambda: status[-1].data == 1)
    wait_until(lambda: status[-1].data == 3)

    far, farther = Goal(client, north_m + 90, east_m), Goal(client, north_m + 90, east_m - 5)
    told["then by action"] = far.state()
    farther.handle.cancel()
    told["cancelled"] = farther.state()
    wait_until(lambda: status[-1].data == 2)

    far = Goal(client, north_m + 90, east_m)
    hold = {"north": north_m, "east": east_m, "north_enable": True, "east_enable": True}
    call("primitive/dynamic_positioning", DynamicPositioningPrimitiveService, **hold)
    told["then by positioning"] = far.state()

    results.clear()
    point = Point(north_m, east_m, 0)
    call("primitive/go2point", Go2pointPrimitiveService, point=point, speed=0.5, victory_radius=1.0)
    wait_until(lambda: results)
    told["commanders"] = [[it.status.goal_id.id, it.status.status] for it in results]

    far = Goal(client, north_m + 90, east_m)
    told["taken"].append(call("docking", DockingService, action=True, slot=0))
    told["then by docking"] = far.state()
    wait_until(lambda: docking[-1].data == 1)
    print(json.dumps(told))


if __name__ == "__main__":
    main()
