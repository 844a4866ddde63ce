"""The heartbeat's number, when there is none, and the one bench that may send it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from apad_bridge.doctor.network import Unreachable
from apad_bridge.events.event import Event
from apad_bridge.ros.gateway import heartbeat
from apad_bridge.ros.gateway.fleet_guard import SecondFleet
from apad_bridge.ros.gateway.heartbeat import OFF, Heartbeat, number_of
from apad_bridge.vehicle.guards.stops import Latch, Stops


@pytest.mark.parametrize(
    ("heard_ms", "now_ms", "age_s"),
    [
        (None, 5_000, None),
        (4_600, 5_000, 0.4),
        (5_100, 5_000, 0.0),
        (2_000, 5_000, 3.0),
        (1_999, 5_000, None),
    ],
)
def test_it_is_the_position_s_age_and_ends_with_a_stale_one(
    heard_ms: int | None, now_ms: int, age_s: float | None
) -> None:
    assert number_of(heard_ms, now_ms, is_off=False) == age_s


@pytest.mark.parametrize("heard_ms", [None, 1_000, 4_900])
def test_an_off_in_force_is_told_whatever_the_position(heard_ms: int | None) -> None:
    """A vehicle without thrust is where the watchdog has to leave it, and a lossy link brings no position."""
    assert number_of(heard_ms, 5_000, is_off=True) == OFF


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
    if not refused:
        heart(monkeypatch, lambda uri: graph)
        return
    with pytest.raises(SecondFleet, match=r"^/musselbed_101 publishes /musselbed/heartbeat: .*end that run"):
        heart(monkeypatch, lambda uri: graph)


def test_a_master_that_does_not_answer_is_told_of_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    def silent(uri: str) -> object:
        raise Unreachable("no answer")

    heart(monkeypatch, silent)


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
