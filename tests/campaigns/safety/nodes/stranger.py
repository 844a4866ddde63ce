"""Another client of the vehicle, or its pilot: publishes and calls what it is told to.

    python stranger.py NAME SOCKET    (a Python with rospy and the vehicle's messages on its path)

Orders are lines of JSON to the datagram socket:
    {"do": "manual", "steers": true, "times": 1}     times: 0 for again and again, five times a second
    {"do": "goal", "generation": "a", "place": [NORTH, EAST]}
    {"do": "docked", "name": "amussel3"}             says at 20 Hz that the vehicle holds it (generation A)
"""

from __future__ import annotations

import time
from typing import Any

import rospy
from apad.msg import aPadActionGoal
from auv_msgs.msg import NavSts
from geometry_msgs.msg import Point
from misc_msgs.srv import Go2pointPrimitiveService
from std_msgs.msg import Bool, Float32MultiArray

from safety.nodes.ordered import serve

STEP_S = 0.05
MANUAL_STEPS = 4
SPEED_M_S = 0.5


class Stranger:
    def __init__(self) -> None:
        # Latched, as a joystick's node that knows its part: nobody has to guess from its silence.
        self._manual = rospy.Publisher("/apad1/manual", Bool, queue_size=1, latch=True)
        self._manual.publish(Bool(False))
        # As the vehicle's own drivers of its arms.
        rospy.Subscriber("/apad1/dock_out", Float32MultiArray, lambda arms: None)
        self._goals: Any = None
        self._steers: bool | None = None
        self._docked: Any = None
        self._steps = 0

    def obey(self, order: dict[str, Any]) -> None:
        if order["do"] == "manual":
            self._steers = order["steers"] if order["times"] == 0 else None
            self._manual.publish(Bool(order["steers"]))
        elif order["do"] == "docked":
            self._docked = rospy.Publisher(f"/{order['name']}/position_static", NavSts, queue_size=1)
        else:
            self._order(order["generation"], *order["place"])

    def _order(self, generation: str, north_m: float, east_m: float) -> None:
        if generation == "b":
            go = rospy.ServiceProxy("/apad1/commander/primitive/go2point", Go2pointPrimitiveService)
            point = Point(north_m, east_m, 0.0)
            go(point=point, speed=SPEED_M_S, victory_radius=0.5, north_enable=True, east_enable=True)
            return
        if self._goals is None:
            self._goals = rospy.Publisher("/apad1/action_server/goal", aPadActionGoal, queue_size=1)
        until_s = time.monotonic() + 5
        while not self._goals.get_num_connections() and time.monotonic() < until_s:
            time.sleep(STEP_S)
        goal = aPadActionGoal()
        goal.header.stamp = goal.goal_id.stamp = rospy.Time.now()
        goal.goal_id.id = f"{rospy.get_name()}-{time.monotonic():.3f}"
        goal.goal.pose.position.x, goal.goal.pose.position.y = north_m, east_m
        self._goals.publish(goal)

    def step(self) -> None:
        self._steps += 1
        if self._steers is not None and self._steps % MANUAL_STEPS == 0:
            self._manual.publish(Bool(self._steers))
        if self._docked is not None:
            self._docked.publish(NavSts())


if __name__ == "__main__":
    serve(Stranger, STEP_S)
