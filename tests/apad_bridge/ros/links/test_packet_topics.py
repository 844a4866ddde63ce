"""The topics between processes, with the subscribers' messages handed over by the test."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from agents.packet_medium import Medium
from apad_bridge.ros.links import packet_topics
from apad_bridge.ros.links.packet_topics import AMusselTopics, PacketTopics
from apad_bridge.supervisor.packet_relay import FLEET_ALONE, MISSION_ALONE, RelayedPacket, Source
from firmware_model.packets import EVERYONE, Beacon, StatusPacket, decode
from firmware_model.packets.codec import load_codec
from firmware_model.states import State


class Graph:
    """Stands in for rospy: keeps what is published, and gives messages to the subscribers."""

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []
        self._takers: dict[str, tuple[Any, tuple[Any, ...]]] = {}

    def Publisher(self, topic: str, kind: Any, queue_size: int) -> Any:  # noqa: N802: rospy's name
        return SimpleNamespace(publish=lambda message: self.published.append((topic, message)))

    def Subscriber(self, topic: str, kind: Any, take: Any, *args: Any, **_: Any) -> Any:
        self._takers[topic] = take, args
        return SimpleNamespace(unregister=lambda: None)

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
    mission.publish(RelayedPacket(Source.LOCAL_SUPERVISOR, EVERYONE, Medium.SOUND, beacon, 1_000))
    ((topic, message),) = graph.published
    fleet = PacketTopics([3, 4], FLEET_ALONE.peers)
    assert graph.subscribed == {"musselbed/heard", "musselbed/said"} and topic == "musselbed/said"
    graph.deliver(topic, agent=message.agent, medium=message.medium, data=message.data)
    assert fleet.take(2_000) == [
        RelayedPacket(Source.REMOTE_SUPERVISOR, EVERYONE, Medium.SOUND, beacon, 2_000)
    ]
    assert not fleet.dropped


@pytest.mark.parametrize(
    ("agent", "medium", "data"),
    [(9, "wifi", b"x"), (EVERYONE, "wifi", b"x"), (3, "smoke", b"x"), (3, "sound", bytes(1025))],
)
def test_no_packet_of_this_fleet_is_dropped_and_counted(
    graph: Graph, agent: int, medium: str, data: bytes
) -> None:
    topics = PacketTopics([3, 4], MISSION_ALONE.peers)
    graph.deliver("musselbed/heard", agent=agent, medium=medium, data=data)
    assert topics.take(0) == []
    assert topics.dropped.total() == 1


def test_legacy_topics_become_a_status_until_the_amussel_sends_packets(graph: Graph) -> None:
    topics = PacketTopics([3, 4], MISSION_ALONE.peers)
    legacy = AMusselTopics([3, 4], load_codec("musselbed-1"), 30, lambda agent_id: False, topics.senders)

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
