"""What a position on the wire becomes in the inbox."""

from __future__ import annotations

import math
import time
from contextlib import closing
from dataclasses import replace
from typing import Any

import genpy
import pytest

from apad_bridge.ros.links.vehicle_subscribers import NavSts, VehicleSubscribers
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.stack_messages import UNSTAMPED


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize(("stamp", "stamp_ms"), [(genpy.Time(7, 250_000_000), 7_250), (genpy.Time(), None)])
def test_a_position_keeps_its_own_stamp_and_on_our_clock_its_time(
    stamp: genpy.Time, stamp_ms: int | None, stamped: bool
) -> None:
    inbox: Inbox[Any] = Inbox()
    message = NavSts()
    message.header.stamp = stamp
    message.position.north, message.position.east, message.orientation.yaw = 1.0, 2.0, 0.5
    message.gbody_velocity.x, message.gbody_velocity.y = 0.3, 0.4
    message._connection_header = {"callerid": "/nav"}
    with closing(VehicleSubscribers("apad1", inbox, stamped=stamped)) as subscribers:
        before_ms = math.floor(1000 * time.monotonic())
        subscribers._take_pose(message, 0)
    after_ms = math.ceil(1000 * time.monotonic())
    (pose,) = inbox.take()
    at_ms = stamp_ms or 0 if stamped else UNSTAMPED
    assert replace(pose, heard_ms=None) == PoseReported(at_ms, 1.0, 2.0, 0.5, stamp_ms, 0.5, "/nav")
    assert pose.heard_ms is None if stamped else before_ms <= pose.heard_ms <= after_ms
