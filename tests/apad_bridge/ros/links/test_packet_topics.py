"""The topics between processes, with the subscribers' messages handed over by the test."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from agents.packet_medium import Medium
from agents.time_scale import TimeScale
from apad_bridge.ros.links import packet_topics
from apad_bridge.ros.links.packet_topics import AMusselTopics, LegacyOrders, PacketTopics
from apad_bridge.supervisor.packet_relay import (
    FLEET_ALONE,
    FLEET_WITH_DOCKS,
    MISSION_ALONE,
    RANGE,
    PacketOrigin,
    RelayedPacket,
    whole_flight,
)
from firmware_model.packets import EVERYONE, Beacon, CommandPacket, Kind, StatusPacket, decode
from firmware_model.packets.codec import load_codec
from firmware_model.power.charge import ChargeModel
from firmware_model.states import State

CURVE = ChargeModel.from_minutes(0.01, ((0.5, 0.02), (1.0, 0.01)))


class Graph:
    """Stands in for rospy: keeps what is published, and gives messages to the subscribers."""

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []
        self.unregistered: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.before_unregistering: Callable[[], object] = lambda: None
        self._takers: dict[str, tuple[Any, tuple[Any, ...]]] = {}

    def Publisher(self, topic: str, kind: Any, queue_size: int) -> Any:
        return SimpleNamespace(
            publish=lambda message: self.published.append((topic, message)),
            unregister=lambda: self._unregister(topic),
        )

    def Subscriber(self, topic: str, kind: Any, take: Any, *args: Any, **_: Any) -> Any:
        self._takers[topic] = take, args
        return SimpleNamespace(unregister=lambda: self._unregister(topic))

    def _unregister(self, topic: str) -> None:
        self.before_unregistering()
        self.unregistered.put(topic)

    @property
    def subscribed(self) -> set[str]:
        return set(self._takers)

    def deliver(self, topic: str, **fields: Any) -> None:
        take, args = self._takers[topic]
        take(SimpleNamespace(**fields), *args)


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    graph = Graph()
    monkeypatch.setattr(packet_topics, "rospy", graph)
    return graph


def test_a_beacon_of_a_mission_alone_reaches_a_fleet_alone(graph: Graph) -> None:
    mission = PacketTopics([3, 4], MISSION_ALONE.peers)
    beacon = Beacon(EVERYONE, 77_000).encode()
    mission.publish(RelayedPacket(PacketOrigin.LOCAL_SUPERVISOR, EVERYONE, Medium.SOUND, beacon, 1_000))
    ((topic, message),) = graph.published
    fleet = PacketTopics([3, 4], FLEET_ALONE.peers)
    assert topic == "musselbed/said"
    assert graph.subscribed == {"musselbed/heard", "musselbed/felt", "musselbed/said"}
    graph.deliver(topic, agent=message.agent, medium=message.medium, data=message.data)
    assert fleet.take(2_000) == [
        RelayedPacket(PacketOrigin.REMOTE_SUPERVISOR, EVERYONE, Medium.SOUND, beacon, 2_000)
    ]
    assert not fleet.dropped


def test_a_contact_of_a_missions_dock_reaches_a_fleet_that_no_aPad_tells(graph: Graph) -> None:
    mission = PacketTopics([3, 4], MISSION_ALONE.peers)
    mission.publish(RelayedPacket(PacketOrigin.LOCAL_DOCK, 3, None, b"[5,1,2]", 1_000))
    ((topic, message),) = graph.published
    fleet = PacketTopics([3, 4], FLEET_WITH_DOCKS.peers)
    graph.deliver(topic, agent=message.agent, medium=message.medium, data=message.data)
    assert fleet.take(2_000) == [RelayedPacket(PacketOrigin.REMOTE_DOCK, 3, None, b"[5,1,2]", 2_000)]


def test_a_ping_reaches_a_bridge_and_its_range_the_mission_which_goes_on_to_read_topics(graph: Graph) -> None:
    mission = PacketTopics([3, 4], whole_flight(frozenset).peers)
    bridge = PacketTopics([3], [PacketOrigin.REMOTE_SUPERVISOR])
    mission.publish(RelayedPacket(PacketOrigin.LOCAL_SUPERVISOR, 3, RANGE, b"", 1_000))
    bridge.publish(RelayedPacket(PacketOrigin.LOCAL_AMUSSEL, 3, RANGE, b"29.600", 0))
    for topic, it in graph.published:
        graph.deliver(topic, agent=it.agent, medium=it.medium, data=it.data)
    assert [(topic, it.medium) for topic, it in graph.published] == [
        ("musselbed/said", "range"),
        ("musselbed/heard", "range"),
    ]
    assert bridge.take(2_000) == [RelayedPacket(PacketOrigin.REMOTE_SUPERVISOR, 3, RANGE, b"", 2_000)]
    assert mission.take(2_000) == [RelayedPacket(PacketOrigin.REMOTE_AMUSSEL, 3, RANGE, b"29.600", 2_000)]
    assert not mission.senders


@pytest.mark.parametrize(
    ("agent", "medium", "data"),
    [(9, "wifi", b"x"), (EVERYONE, "wifi", b"x"), (3, "smoke", b"x"), (3, "sound", bytes(1025))],
)
def test_no_packet_of_this_fleet_is_dropped_and_counted(
    graph: Graph, agent: int, medium: str, data: bytes
) -> None:
    topics = PacketTopics([3, 4], MISSION_ALONE.peers)
    graph.deliver("musselbed/heard", agent=agent, medium=medium, data=data)
    assert topics.take(0) == [] and topics.dropped.total() == 1


def test_legacy_topics_become_a_status_until_the_amussel_sends_packets(graph: Graph) -> None:
    topics = PacketTopics([3, 4], MISSION_ALONE.peers)
    legacy = AMusselTopics(
        [3, 4], load_codec("musselbed-1"), TimeScale(30), lambda agent_id: False, topics.senders, CURVE
    )

    def published() -> list[RelayedPacket]:
        for agent_id in (3, 4):
            place = SimpleNamespace(north=1.5, east=-2.0)
            graph.deliver(f"amussel{agent_id}/position", position=place)
            graph.deliver(f"amussel{agent_id}/battery_level", data=40.0)
        return legacy.take(2_000)

    status = decode(published()[0].data)
    assert isinstance(status, StatusPacket)
    assert (status.agent_id, status.state, status.north_m, status.east_m) == (3, State.FLOATING, 1.5, -2.0)
    assert status.primary == pytest.approx(0.4, abs=1e-4) and status.agent_ms == 60_000
    graph.deliver("musselbed/heard", agent=4, medium="wifi", data=b"status")
    topics.take(3_000)
    assert [it.agent_id for it in published()] == [3]


def test_a_mission_leaves_the_topics_of_an_amussel_that_sends_packets_and_the_others_at_its_end(
    graph: Graph,
) -> None:
    topics = PacketTopics([3, 4], MISSION_ALONE.peers)
    legacy = AMusselTopics(
        [3, 4], load_codec("musselbed-1"), TimeScale(30), lambda _: False, topics.senders, CURVE
    )
    graph.deliver("musselbed/heard", agent=4, medium="wifi", data=b"status")
    for now_ms in (1_000, 2_000):
        topics.take(now_ms)
        legacy.take(now_ms)
    assert {graph.unregistered.get(timeout=20) for _ in range(3)} == {
        "amussel4/position",
        "amussel4/battery_level",
        "amussel4/charging",
    }
    legacy.close()
    assert {graph.unregistered.get(timeout=20) for _ in range(3)} == {
        "amussel3/position",
        "amussel3/battery_level",
        "amussel3/charging",
    }
    assert graph.unregistered.empty()


def test_a_master_out_of_reach_does_not_hold_up_the_flight(graph: Graph) -> None:
    topics = PacketTopics([3], MISSION_ALONE.peers)
    legacy = AMusselTopics(
        [3], load_codec("musselbed-1"), TimeScale(30), lambda _: False, topics.senders, CURVE
    )
    answered = threading.Event()
    graph.before_unregistering = lambda: answered.wait(20)
    graph.deliver("musselbed/heard", agent=3, medium="wifi", data=b"status")
    for now_ms in (1_000, 2_000):
        topics.take(now_ms)
        legacy.take(now_ms)
    assert graph.unregistered.empty()
    answered.set()
    assert {graph.unregistered.get(timeout=20) for _ in range(3)} == {
        "amussel3/position",
        "amussel3/battery_level",
        "amussel3/charging",
    }


def test_an_amussel_known_by_topics_is_charged_while_a_dock_of_ours_holds_it(graph: Graph) -> None:
    """At theta 30 a mission second is half an agent minute: 1 point a second below 50 %, half a point above it."""
    held: set[int] = set()
    topics = PacketTopics([3, 4], MISSION_ALONE.peers)
    legacy = AMusselTopics(
        [3, 4], load_codec("musselbed-1"), TimeScale(30), held.__contains__, topics.senders, CURVE
    )

    def charged(now_ms: int) -> list[tuple[str, float]]:
        graph.published.clear()
        legacy.take(now_ms)
        return [(topic, round(message.data, 9)) for topic, message in graph.published]

    for agent_id, percent in ((3, 40.0), (4, 80.0)):
        graph.deliver(f"amussel{agent_id}/battery_level", data=percent)
    assert charged(1_000) == []
    held |= {3, 4}
    assert charged(2_000) == []
    assert charged(3_000) == [("amussel3/charging", 1.0), ("amussel4/charging", 0.5)]
    assert charged(5_000) == [("amussel3/charging", 2.0), ("amussel4/charging", 1.0)]
    graph.deliver("amussel4/battery_level", data=99.8)
    graph.deliver("musselbed/heard", agent=3, medium="wifi", data=b"status")
    topics.take(6_000)
    assert charged(6_000) == [("amussel4/charging", 0.2)], (
        "no more than full; one with packets has its own charger"
    )
    held.clear()
    assert charged(7_000) == []


def test_legacy_orders_permit_simulated_amussels_to_surface(graph: Graph) -> None:
    orders = LegacyOrders([3, 4], load_codec("musselbed-1"), lambda: {3})
    for agent_id in (3, 4):
        graph.deliver(f"amussel{agent_id}/goto_surface", data=True)
    (packet,) = orders.take(2_000)
    assert (packet.source, packet.agent_id, packet.medium) == (PacketOrigin.LABORATORY, 3, Medium.SOUND)
    assert decode(packet.data) == CommandPacket(Kind.PERMISSION, 3)
    assert not orders.dropped
    graph.deliver("amussel3/goto_surface", data=False)
    graph.deliver("amussel3/charging", data=0.1)
    assert orders.take(3_000) == []
    assert orders.dropped == {
        "goto_surface: false has no effect": 1,
        "charging: a simulated aMussel charges at its dock": 1,
    }
