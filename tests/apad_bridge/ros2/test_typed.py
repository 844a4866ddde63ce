"""CDR by hand, and hashes as ROS 2 Jazzy states them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from apad_bridge.ros2.topics import hash_of, make, serialized


@pytest.mark.parametrize(
    ("kind", "hexadecimal"),
    [
        ("std_msgs/String", "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        ("tf2_msgs/TFMessage", "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"),
    ],
)
def test_a_hash_is_the_one_of_ros_2(kind: str, hexadecimal: str) -> None:
    assert hash_of(kind) == hexadecimal


@pytest.mark.parametrize(
    ("kind", "fields", "hexadecimal"),
    [
        (
            "rosgraph_msgs/Clock",
            {"clock": make("builtin_interfaces/Time", sec=258, nanosec=3)},
            "00010000" + "02010000" + "03000000",
        ),
        ("std_msgs/String", {"data": "ab"}, "00010000" + "03000000" + "616200"),
    ],
)
def test_a_message_is_little_endian_after_a_header_of_four_bytes(
    kind: str, fields: dict[str, Any], hexadecimal: str
) -> None:
    assert serialized(kind, make(kind, **fields)).hex() == hexadecimal


def test_fields_that_are_not_given_are_0_or_empty() -> None:
    battery, again = (make("sensor_msgs/BatteryState", **it) for it in ({"voltage": 4.0}, {}))
    assert (battery.voltage, battery.current, battery.present, battery.location) == (4.0, 0.0, False, "")
    assert (battery.header.frame_id, battery.header.stamp.sec, again.voltage) == ("", 0, 0.0)
    assert (battery.cell_voltage.dtype, len(battery.cell_voltage)) == ("float32", 0)
    assert make("sensor_msgs/NavSatFix", altitude=math.nan).position_covariance.tolist() == [0.0] * 9
    assert (make("tf2_msgs/TFMessage").transforms, make("sensor_msgs/JointState").name) == ([], [])
