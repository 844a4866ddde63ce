"""Opens a gateway with a watch of its master, and prints its events as JSON lines, until its stdin ends.

Use: watch_a_master.py, on the master at ROS_MASTER_URI. It publishes the number of lines that it has read on `/orders`,
by an order sender, and on `/said`; at each line it ends every connection of these two.
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
from apad_bridge.ros.links.order_sender import OrderSender, end_at_once
from apad_bridge.ros.system.master_watch import MasterWatch, forget_silent_master


def main() -> None:
    gateway = open_gateway(range(1, 3), TimeScale(1), node_name="watcher")
    rospy.Subscriber("/words", String, lambda message: print(json.dumps(["heard", message.data]), flush=True))
    sender = OrderSender(lambda order: True)
    orders = sender.add_topic("orders", "/orders", String).publisher
    publishers = [orders, rospy.Publisher("/said", String, queue_size=1)]
    sender.begin()
    watch = MasterWatch(rosgraph.get_master_uri(), period_s=0.2)
    ended, losses = threading.Event(), list[str]()

    def lose() -> None:
        """A connection that ends before the watch has seen it is not called back."""
        for line in sys.stdin:
            while not {"/orders", "/said"} & {topic for topic, _ in watch._readers}:
                ended.wait(0.05)
            for connection in [it for publisher in publishers for it in publisher.impl.connections]:
                end_at_once(connection.socket)
            losses.append(line)
        ended.set()

    threading.Thread(target=lose, daemon=True).start()
    print("ready", flush=True)
    while not ended.wait(0.05):
        for publisher in publishers:
            publisher.publish(f"{len(losses)}")
        for event in watch.take():
            rospy.logwarn("a thread of the flight's says something, too")
            print(json.dumps([event.kind, event.data]), flush=True)
    forget_silent_master(rosgraph.get_master_uri())
    watch.close()
    sender.close()
    gateway.close()


if __name__ == "__main__":
    main()
