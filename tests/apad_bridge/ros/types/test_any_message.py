"""Messages of any definition, decoded."""

from __future__ import annotations

from std_msgs.msg import Float64

from apad_bridge.ros.types.any_message import AnyMessages


def test_a_message_that_rospy_decoded_for_another_subscriber_is_taken_as_it_is() -> None:
    message = Float64(0.5)
    assert AnyMessages().decode(message) is message
