"""A reader on ROS 2 that shares no code with musselbed: it runs in .venv-ros2, by rclpy and the wheels' message classes.

Use: judge_ros2.py SECONDS TOPIC=KIND...

It prints a line once each topic is offered. After SECONDS, or for `-` at its input's end, it prints as JSON the
messages of each topic, their arrivals and its QoS.
"""

from __future__ import annotations

import ctypes
import json
import math
import select
import struct
import sys
import time
from importlib import import_module
from typing import Any

import rclpy
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy


def plain(value: Any) -> Any:
    """A message as JSON has it; NaN as null."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value[0]
    if isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return None if math.isnan(value) else value
    return [plain(it) for it in value] if hasattr(value, "__iter__") else float(value)


def tf_class() -> Any:
    """The wheels lack tf2_msgs: a class that nobody uses here gets its name, and its messages are read as bytes."""
    spare = import_module("sensor_msgs.msg").MultiEchoLaserScan
    spare.__class__.__import_type_support__()
    pointer_of = ctypes.pythonapi.PyCapsule_GetPointer
    pointer_of.restype, pointer_of.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
    outer = ctypes.cast(pointer_of(spare.__class__._TYPE_SUPPORT, None), ctypes.POINTER(ctypes.c_void_p))
    find = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)(outer[2])
    inner = ctypes.cast(
        find(ctypes.addressof(outer.contents), b"rosidl_typesupport_fastrtps_c"),
        ctypes.POINTER(ctypes.c_void_p),
    )
    names = ctypes.cast(inner[1], ctypes.POINTER(ctypes.c_char_p))
    names[0], names[1] = b"tf2_msgs::msg", b"TFMessage"
    return spare


class Cdr:
    """Reads CDR by hand: little-endian, each number at a multiple of its size."""

    def __init__(self, data: bytes) -> None:
        assert data[:4] == b"\0\1\0\0", data[:4]
        self.data, self.at = data[4:], 0

    def number(self, code: str) -> Any:
        size = struct.calcsize(code)
        self.at = -(-self.at // size) * size
        (value,) = struct.unpack_from("<" + code, self.data, self.at)
        self.at += size
        return value

    def text(self) -> str:
        length = self.number("I")
        self.at += length
        return self.data[self.at - length : self.at - 1].decode()


def transforms_of(data: bytes) -> list[dict[str, Any]]:
    cdr = Cdr(data)
    return [
        {
            "stamp": cdr.number("i") + cdr.number("I") / 1e9,
            "parent": cdr.text(),
            "child": cdr.text(),
            "numbers": [cdr.number("d") for _ in range(7)],
        }
        for _ in range(cdr.number("I"))
    ]


def main() -> None:
    asked = dict(it.split("=") for it in sys.argv[2:])
    seconds = math.inf if sys.argv[1] == "-" else float(sys.argv[1])
    rclpy.init()
    node = rclpy.create_node("judge")
    came: dict[str, list[Any]] = {topic: [] for topic in asked}
    qos: dict[str, str] = {}

    def follow(topic: str, kind: str, durability: Any) -> None:
        depth = QoSProfile(depth=1000, durability=durability, reliability=QoSReliabilityPolicy.RELIABLE)
        if kind == "tf2_msgs/TFMessage":
            read, known = transforms_of, tf_class()
        else:
            package, name = kind.split("/")
            read, known = plain, getattr(import_module(f"{package}.msg"), name)
        node.create_subscription(
            known,
            topic,
            lambda it: came[topic].append([time.monotonic(), read(it)]),
            depth,
            raw=read is transforms_of,
        )

    until_s = time.monotonic() + 120
    while len(qos) < len(asked) and time.monotonic() < until_s:
        rclpy.spin_once(node, timeout_sec=0.05)
        for topic in asked.keys() - qos.keys():
            for it in node.get_publishers_info_by_topic(topic):
                assert it.topic_type == asked[topic].replace("/", "/msg/"), (topic, it.topic_type)
                durability = it.qos_profile.durability
                qos[topic] = f"{it.qos_profile.reliability.name} {durability.name} {it.topic_type_hash}"
                is_kept = durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
                follow(topic, asked[topic], durability if is_kept else QoSDurabilityPolicy.VOLATILE)
    print("reading", flush=True)
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s and not (
        seconds == math.inf and select.select([sys.stdin], [], [], 0)[0]
    ):
        rclpy.spin_once(node, timeout_sec=0.05)
    print(json.dumps({"came": came, "qos": qos}))


if __name__ == "__main__":
    main()
