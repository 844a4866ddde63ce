"""Sends an aPad of generation A away from the mission that flies it, gives it back, and prints what happened as JSON.

Use: send_away.py NORTH EAST, on the master at ROS_MASTER_URI. It sends one go-to as soon as the mission's first go-to runs,
waits until the aPad is there, and for 5 s of its positions more; then it calls give_back and waits for the next plan.
"""

from __future__ import annotations

import json
import math
import queue
import sys
from typing import Any

import rospy
from actionlib import SimpleActionClient
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from std_srvs.srv import Trigger

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from apad.msg import aPadAction, aPadActionGoal, aPadGoal  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402
from musselbed_msgs.msg import MissionEvent  # noqa: E402

PATIENCE_S = 150.0
STAYS = 50
"""Positions at 10 Hz."""


def main() -> None:
    north_m, east_m = map(float, sys.argv[1:3])
    rospy.init_node("somebody", disable_signals=True)
    events: queue.Queue[tuple[str, dict[str, Any]]] = queue.Queue()
    positions: queue.Queue[tuple[float, float]] = queue.Queue()
    active: queue.Queue[set[str]] = queue.Queue()
    rospy.Subscriber(
        "/apad1/action_server/goal",
        aPadActionGoal,
        lambda it: events.put(("goal", {"key": it.goal_id.id, "place": it.goal.pose.position})),
    )
    rospy.Subscriber(
        "/apad1/action_server/status",
        GoalStatusArray,
        lambda it: active.put({row.goal_id.id for row in it.status_list if row.status == GoalStatus.ACTIVE}),
    )
    rospy.Subscriber(
        "/musselbed/mission", MissionEvent, lambda it: events.put((it.kind, json.loads(it.data)))
    )

    def until(kind: str, **wanted: Any) -> list[str]:
        """The kinds of the events up to this one."""
        seen = []
        while True:
            found, data = events.get(timeout=PATIENCE_S)
            seen.append(found)
            if found == kind and wanted.items() <= data.items():
                return seen

    client = SimpleActionClient("/apad1/action_server", aPadAction)
    assert client.wait_for_server(rospy.Duration(PATIENCE_S))
    print("listening", flush=True)
    # The event may come before the mission's goal does, which would then send this one away; and one of the two may have
    # been sent before this process was connected. Nor does a goal come to its server when it comes here: the vehicle must
    # follow it.
    key, place, begun = "", (math.inf, math.inf), (0.0, 0.0)
    while math.dist(place, begun) > 0.01:
        kind, data = events.get(timeout=PATIENCE_S)
        if kind == "goal":
            key, place = data["key"], (data["place"].x, data["place"].y)
        elif (kind, data.get("name"), data.get("phase")) == ("primitive", "go to point", "started"):
            begun = data["north_m"], data["east_m"]
    while key not in active.get(timeout=PATIENCE_S):
        pass
    goal = aPadGoal(id=0)
    goal.pose.position.x, goal.pose.position.y = north_m, east_m
    client.send_goal(goal)
    until("override", taken=True)
    assert client.wait_for_result(rospy.Duration(PATIENCE_S))
    state = client.get_state()
    rospy.Subscriber(
        "/apad1/position", NavSts, lambda it: positions.put((it.position.north, it.position.east))
    )
    stayed = [positions.get(timeout=PATIENCE_S) for _ in range(STAYS)]
    away_m = max(math.dist(it, (north_m, east_m)) for it in stayed)
    answer = rospy.ServiceProxy("/musselbed/apad1/give_back", Trigger)()
    aside = until("override", taken=False)
    until("plan")
    print(json.dumps({"state": state, "away_m": away_m, "given_back": answer.success, "aside": aside}))


if __name__ == "__main__":
    main()
