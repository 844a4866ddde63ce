"""Hears `/musselbed/mission` until its standard input ends, and then prints (mission time, kind) of each event as JSON."""

from __future__ import annotations

import json
import sys

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

import rospy  # noqa: E402
from musselbed_msgs.msg import MissionEvent  # noqa: E402


def main() -> None:
    heard: list[tuple[int, str]] = []
    rospy.init_node("somebody", disable_signals=True)
    rospy.Subscriber(
        "/musselbed/mission", MissionEvent, lambda it: heard.append((it.mission_time_ms, it.kind))
    )
    print("listening", flush=True)
    sys.stdin.read()
    print(json.dumps(heard))


if __name__ == "__main__":
    main()
