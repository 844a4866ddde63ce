"""Publishes messages by a laboratory's names and prints those received, as JSON lines, until stdin ends.

Use: hear_a_laboratory.py NAMES.yaml, on the master at ROS_MASTER_URI
"""

from __future__ import annotations

import json
import sys
import threading
from dataclasses import astuple
from pathlib import Path

import rospy

from apad_bridge.ros.links.laboratory import Laboratory
from apad_bridge.scenario.lab_interface.lab_messages import MessageKind
from apad_bridge.scenario.lab_interface.lab_names import load_names
from firmware_model.packets.codec import load_codec


def main() -> None:
    rospy.init_node("laboratory", disable_signals=True)
    laboratory = Laboratory(load_names(Path(sys.argv[1])), "apad1", range(1, 20), load_codec("musselbed-1"))
    print("ready", flush=True)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    now_ms = 0
    while not ended.wait(0.05):
        now_ms += 50
        laboratory.publishers.publish(MessageKind.WIFI, 3, now_ms, on=True)
        for message in laboratory.subscribers.take(now_ms):
            print(json.dumps([type(message).__name__, *map(str, astuple(message)[-3:])]), flush=True)
    print(json.dumps(dict(laboratory.dropped)), flush=True)
    laboratory.close()
    rospy.signal_shutdown("asked to end")


if __name__ == "__main__":
    main()
