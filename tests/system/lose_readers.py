"""Publishes on two topics, ends every connection whenever it reads a line on stdin, and publishes on. It ends with stdin.

Use: lose_readers.py, on the master at ROS_MASTER_URI. `/orders` has an order sender, `/words` the watch of the master.
"""

from __future__ import annotations

import sys
import threading

import rosgraph
import rospy
from std_msgs.msg import String

from apad_bridge.ros.links.order_sender import OrderSender, end_at_once
from apad_bridge.ros.system.master_watch import MasterWatch


def main() -> None:
    rospy.init_node("loser", disable_signals=True)
    sender = OrderSender(lambda order: True)
    publishers = [
        sender.add_topic("orders", "/orders", String).publisher,
        rospy.Publisher("/words", String, queue_size=1),
    ]
    sender.begin()
    watch = MasterWatch(rosgraph.get_master_uri(), period_s=0.2)
    ended = threading.Event()

    def publish() -> None:
        while not ended.wait(0.1):
            for publisher in publishers:
                publisher.publish(f"{len(losses)}")

    losses: list[str] = []
    threading.Thread(target=publish, daemon=True).start()
    print("ready", flush=True)
    for line in sys.stdin:
        for publisher in publishers:
            for connection in list(publisher.impl.connections):
                end_at_once(connection.socket)
        losses.append(line)
    ended.set()
    watch.close()
    sender.close()


if __name__ == "__main__":
    main()
