"""The heartbeat's number, when there is none, and the one bench that may send it."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from apad_bridge.doctor.network import Unreachable
from apad_bridge.events.event import Event
from apad_bridge.ros.gateway import heartbeat
from apad_bridge.ros.gateway.fleet_guard import SecondFleet
from apad_bridge.ros.gateway.heartbeat import OFF, Heartbeat, number_of
from apad_bridge.vehicle.guards.stops import Latch, Stops


@pytest.mark.parametrize(
    ("heard_ms", "is_off", "number"),
    [
        # It is the position's age, and ends with a stale one.
        (None, False, None),
        (4_600, False, 0.4),
        (5_100, False, 0.0),
        (2_000, False, 3.0),
        (1_999, False, None),
        # An OFF in force is told whatever the position: a vehicle without thrust is where the watchdog has to leave it, and
        # a lossy link brings no position.
        (None, True, OFF),
        (1_000, True, OFF),
        (4_900, True, OFF),
    ],
)
def test_the_heartbeat_s_number(heard_ms: int | None, is_off: bool, number: float | None) -> None:
    assert number_of(heard_ms, 5_000, is_off=is_off) == number


@pytest.mark.parametrize(
    ("living", "refused"),
    [
        (["/musselbed_1"], False),
        ([], False),
        (["/musselbed_1", "/musselbed_101"], True),
    ],
)
def test_a_bench_beside_another_of_the_same_vehicle_does_not_begin(
    monkeypatch: pytest.MonkeyPatch, living: list[str], refused: bool
) -> None:
    """The node's own registration is no other bench, nor is that of a supervisor whom it follows under the same name."""
    graph = SimpleNamespace(living_publishers=lambda topic: living if topic == "/musselbed/heartbeat" else [])
    second = pytest.raises(
        SecondFleet, match=r"^/musselbed_101 publishes /musselbed/heartbeat: .*end that run"
    )
    with second if refused else nullcontext():
        heart(monkeypatch, lambda uri: graph)


def test_a_master_that_does_not_answer_is_told_of_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    heart(monkeypatch, MagicMock(side_effect=Unreachable("no answer")))


def heart(monkeypatch: pytest.MonkeyPatch, read: object) -> Heartbeat:
    """A heartbeat of the node /musselbed_1 on a graph that `read` gives."""
    node = SimpleNamespace(
        resolve_name=lambda name: f"/{name}",
        get_name=lambda: "/musselbed_1",
        Publisher=lambda *_, **__: None,
    )
    monkeypatch.setattr(heartbeat, "rospy", node)
    monkeypatch.setattr(heartbeat.Graph, "read", read)
    events: list[Event] = []
    return Heartbeat(Stops(events, Latch()), lambda: True)
