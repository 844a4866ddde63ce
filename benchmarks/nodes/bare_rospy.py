"""A rospy node with one status topic and no other work. It reads commands on stdin, and prints a line when each is done.

Use: bare_rospy.py NUMBER; "publish N" publishes N statuses; the end of stdin ends the node.
"""

from __future__ import annotations

import sys

import rospy
from std_msgs.msg import String


def main() -> None:
    rospy.init_node(f"bare_{sys.argv[1]}", disable_signals=True)
    publisher = rospy.Publisher(f"/bare{sys.argv[1]}/status", String, queue_size=1)
    for line in sys.stdin:
        for number in range(int(line.removeprefix("publish "))):
            publisher.publish(String(f"status {number}"))
        print("done", flush=True)
    rospy.signal_shutdown("told to end")


if __name__ == "__main__":
    main()
