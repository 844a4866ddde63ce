"""The boat of the template of a stack, as a node that follows /clock: lab_boat.py NAME NORTH_M EAST_M ORDERS.

It writes each order that it hears into the file ORDERS, as a line. It knows nothing of musselbed but the texts of messages.
"""

import math
import sys

import rospy
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Bool
from std_srvs.srv import Trigger, TriggerResponse

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from auv_msgs.msg import NavSts  # noqa: E402

STEP_S, SPEED_M_S, THERE_M = 0.1, 0.5, 0.1


def main(name: str, north_m: float, east_m: float, orders: str) -> None:
    rospy.init_node("lab_boat")
    place, goal = [north_m, east_m], [north_m, east_m]
    thrust = [True]

    def say(order: str) -> None:
        with open(orders, "a") as file:
            file.write(f"{order}\n")

    def take_goal(message: PoseStamped) -> None:
        goal[:] = message.pose.position.x, message.pose.position.y
        thrust[0] = True
        say(f"goal {goal[0]:.2f} {goal[1]:.2f}")

    def off(_: Trigger) -> TriggerResponse:
        thrust[0] = False
        say("off")
        return TriggerResponse(success=True)

    position = rospy.Publisher(f"{name}/position", NavSts, queue_size=10)
    under_way = rospy.Publisher(f"{name}/is_under_way", Bool, queue_size=10)
    rospy.Subscriber(f"{name}/helm/goal", PoseStamped, take_goal)
    rospy.Service(f"{name}/helm/off", Trigger, off)

    def step(_: rospy.timer.TimerEvent) -> None:
        left_m = math.dist(place, goal)
        goes = thrust[0] and left_m > THERE_M
        if goes:
            part = min(1.0, SPEED_M_S * STEP_S / left_m)
            place[:] = [here + part * (there - here) for here, there in zip(place, goal, strict=True)]
        message = NavSts()
        message.header.stamp = rospy.Time.now()
        message.position.north, message.position.east = place
        message.status = NavSts.STATUS_ALL_OK
        position.publish(message)
        under_way.publish(Bool(goes))

    rospy.Timer(rospy.Duration(STEP_S), step)
    rospy.spin()


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), float(sys.argv[3]), sys.argv[4])
