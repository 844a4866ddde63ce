"""A ROS node that a campaign gives orders to while it runs: `serve` is its loop."""

from __future__ import annotations

import json
import os
import socket
import sys
from collections.abc import Callable
from typing import Any, Protocol

import rospy


class Ordered(Protocol):
    def obey(self, order: dict[str, Any]) -> None: ...

    def step(self) -> None:
        """Called again and again between orders."""
        ...


def serve(make: Callable[[], Ordered], step_s: float) -> None:
    """Makes the node argv[1], and obeys the lines of JSON that come to the datagram socket argv[2]. It does not return."""
    try:
        name, path = sys.argv[1:3]
        orders = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        orders.bind(path)
        orders.settimeout(step_s)
        rospy.init_node(name, disable_signals=True)
        node = make()
        print("ready", flush=True)
        while True:
            try:
                node.obey(json.loads(orders.recv(4096)))
            except TimeoutError:
                node.step()
    finally:
        sys.excepthook(*sys.exc_info())
        os._exit(1)  # rospy's threads wait for a master that may be gone
