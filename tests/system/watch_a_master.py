"""Opens a gateway with a watch of its master, and prints its events as JSON lines, until its stdin ends.

Use: watch_a_master.py, on the master at ROS_MASTER_URI
"""

from __future__ import annotations

import json
import sys
import threading

import rosgraph
import rospy
from std_msgs.msg import String

from agents.time_scale import TimeScale
from apad_bridge.ros.gateway.gateway import open_gateway
from apad_bridge.ros.system.master_watch import MasterWatch, forget_silent_master


def main() -> None:
    gateway = open_gateway(range(1, 3), TimeScale(1), node_name="watcher")
    rospy.Subscriber("/words", String, lambda message: print(json.dumps(["heard", message.data]), flush=True))
    watch = MasterWatch(rosgraph.get_master_uri(), period_s=0.2)
    print("ready", flush=True)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.wait(0.05):
        for event in watch.take():
            rospy.logwarn("a thread of the flight's says something, too")
            print(json.dumps([event.kind, event.data]), flush=True)
    forget_silent_master(rosgraph.get_master_uri())
    watch.close()
    gateway.close()


if __name__ == "__main__":
    main()
