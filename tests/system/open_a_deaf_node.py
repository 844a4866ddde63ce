"""Opens a gateway whose accepting thread ends, as rospy's does when no file can be opened; prints how its watch tells it.

Use: open_a_deaf_node.py, on the master at ROS_MASTER_URI
"""

from __future__ import annotations

import errno
import json
import os
import socket
import threading
import time

import rospy
from rospy.impl import tcpros_base

from agents.time_scale import TimeScale
from apad_bridge.ros.gateway.gateway import open_gateway
from apad_bridge.ros.system import handshakes


def main() -> None:
    gateway = open_gateway(range(1, 3), TimeScale(1), node_name="hearing")
    print(json.dumps(handshakes.deaf()), flush=True)
    refused = threading.Event()

    def fail(listener: socket.socket) -> None:
        refused.set()
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    outlasting = handshakes.Listener.accept
    plain, socket.socket.accept = socket.socket.accept, fail  # type: ignore[method-assign,assignment]
    handshakes.deaf(0.1)  # so that the thread is not left in the accept that it had begun
    assert refused.wait(60)
    socket.socket.accept = plain  # type: ignore[method-assign]
    print(json.dumps(handshakes.deaf()), flush=True)  # it outlasted the shortage

    handshakes.Listener.accept = fail  # type: ignore[method-assign,assignment]
    refused.clear()
    threading.excepthook = lambda _: None
    handshakes.deaf(0.1)
    assert refused.wait(60)
    handshakes.Listener.accept = outlasting  # type: ignore[method-assign]
    watch = handshakes.HearingWatch(0.05, lambda: handshakes.deaf(0.2))
    until_s = time.monotonic() + 60
    while not (told := watch.take()) and time.monotonic() < until_s:
        time.sleep(0.05)
    print(json.dumps([[it.kind, it.data] for it in told]), flush=True)
    # As it was before: the same thread's work, begun again.
    tcpros_base._tcpros_server.tcp_ros_server.start()
    while not (told := watch.take()) and time.monotonic() < until_s:
        time.sleep(0.05)
    print(json.dumps([it.kind for it in told]), flush=True)
    watch.close()
    gateway.close()
    rospy.signal_shutdown("done")


if __name__ == "__main__":
    main()
