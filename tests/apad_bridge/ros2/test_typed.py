"""CDR by hand, and hashes as ROS 2 Jazzy states them."""

from __future__ import annotations

import math

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


def test_a_message_is_little_endian_after_a_header_of_four_bytes() -> None:
    clock = make("rosgraph_msgs/Clock", clock=make("builtin_interfaces/Time", sec=258, nanosec=3))
    assert serialized("rosgraph_msgs/Clock", clock).hex() == "00010000" + "02010000" + "03000000"
    text = make("std_msgs/String", data="ab")
    assert serialized("std_msgs/String", text).hex() == "00010000" + "03000000" + "616200"


def test_fields_that_are_not_given_are_0_or_empty() -> None:
    battery = make("sensor_msgs/BatteryState", voltage=4.0)
    assert (battery.voltage, battery.current, battery.present, battery.location) == (4.0, 0.0, False, "")
    assert (battery.header.frame_id, battery.header.stamp.sec) == ("", 0)
    assert (battery.cell_voltage.dtype, len(battery.cell_voltage)) == ("float32", 0)
    assert make("sensor_msgs/BatteryState").voltage == 0.0
    fix = make("sensor_msgs/NavSatFix", altitude=math.nan)
    assert fix.position_covariance.tolist() == [0.0] * 9
    assert make("tf2_msgs/TFMessage").transforms == []
    assert make("sensor_msgs/JointState").name == []
