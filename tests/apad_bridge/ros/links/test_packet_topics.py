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
        return self._registered(topic, publish=lambda message: self.published.append((topic, message)))

    def Subscriber(self, topic: str, kind: Any, take: Any, *args: Any, **_: Any) -> Any:
        self._takers[topic] = take, args
        return self._registered(topic)

    def _registered(self, topic: str, **methods: Any) -> Any:
        left = (lambda: self.before_unregistering(), lambda: self.unregistered.put(topic))
        return SimpleNamespace(unregister=lambda: [step() for step in left], **methods)

    def deliver(self, topic: str, **fields: Any) -> None:
        take, args = self._takers[topic]
        take(SimpleNamespace(**fields), *args)


@pytest.fixture
def graph(monkeypatch: pytest.MonkeyPatch) -> Graph:
    graph = Graph()
    monkeypatch.setattr(packet_topics, "rospy", graph)
    return graph


BRIDGE = [PacketOrigin.REMOTE_SUPERVISOR]
BEACON = Beacon(EVERYONE, 77_000).encode()


@pytest.mark.parametrize(
    ("origin", "agent_id", "medium", "data", "topic", "peers", "heard"),
    [
        pytest.param(
            PacketOrigin.LOCAL_SUPERVISOR,
            EVERYONE,
            Medium.SOUND,
            BEACON,
            "musselbed/said",
            FLEET_ALONE.peers,
            PacketOrigin.REMOTE_SUPERVISOR,
            id="a beacon of a mission reaches a fleet alone",
        ),
        pytest.param(
            PacketOrigin.LOCAL_DOCK,
            3,
            None,
            b"[5,1,2]",
            "musselbed/felt",
            FLEET_WITH_DOCKS.peers,
            PacketOrigin.REMOTE_DOCK,
            id="a contact of a mission's dock reaches a fleet that no aPad tells",
        ),
        pytest.param(
            PacketOrigin.LOCAL_SUPERVISOR,
            3,
            RANGE,
            b"",
            "musselbed/said",
            BRIDGE,
            PacketOrigin.REMOTE_SUPERVISOR,
            id="a ping reaches a bridge",
        ),
        pytest.param(
            PacketOrigin.LOCAL_AMUSSEL,
            3,
            RANGE,
            b"29.600",
            "musselbed/heard",
            whole_flight(frozenset).peers,
            PacketOrigin.REMOTE_AMUSSEL,
            id="a range reaches a mission, which goes on to read topics",
        ),
    ],
)
def test_a_packet_reaches_another_process(
    graph: Graph,
    origin: PacketOrigin,
    agent_id: int,
    medium: Medium | None,
    data: bytes,
    topic: str,
    peers: Any,
    heard: PacketOrigin,
) -> None:
    ours = BRIDGE if origin is PacketOrigin.LOCAL_AMUSSEL else MISSION_ALONE.peers
    PacketTopics([3, 4], ours).publish(RelayedPacket(origin, agent_id, medium, data, 1_000))
    ((published, message),) = graph.published
    other = PacketTopics([3, 4], peers)
    graph.deliver(published, agent=message.agent, medium=message.medium, data=message.data)
    assert (published, other.take(2_000)) == (topic, [RelayedPacket(heard, agent_id, medium, data, 2_000)])
    assert not other.dropped and not other.senders


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


class Mission:
    """A mission that reads packets, and the topics of aMussels 3 and 4 until they send packets. At theta 30."""

    def __init__(self, graph: Graph) -> None:
        self.graph, self.held = graph, set[int]()
        self.packets = PacketTopics([3, 4], MISSION_ALONE.peers)
        self._legacy = AMusselTopics(
            [3, 4],
            load_codec("musselbed-1"),
            TimeScale(30),
            self.held.__contains__,
            self.packets.senders,
            CURVE,
        )
        self.close = self._legacy.close

    def take(self, now_ms: int) -> list[RelayedPacket]:
        self.packets.take(now_ms)
        return self._legacy.take(now_ms)

    def sends_a_packet(self, agent_id: int) -> None:
        self.graph.deliver("musselbed/heard", agent=agent_id, medium="wifi", data=b"status")

    def published(self, now_ms: int) -> list[RelayedPacket]:
        for agent_id in (3, 4):
            self.graph.deliver(f"amussel{agent_id}/position", position=SimpleNamespace(north=1.5, east=-2.0))
            self.graph.deliver(f"amussel{agent_id}/battery_level", data=40.0)
        return self.take(now_ms)

    def left(self) -> set[str]:
        """The next three topics that it leaves."""
        return {self.graph.unregistered.get(timeout=20) for _ in range(3)}


@pytest.fixture
def mission(graph: Graph) -> Mission:
    return Mission(graph)


def topics_of(agent_id: int) -> set[str]:
    return {f"amussel{agent_id}/{leaf}" for leaf in ("position", "battery_level", "charging")}


def test_legacy_topics_become_a_status_until_the_amussel_sends_packets(mission: Mission) -> None:
    status = decode(mission.published(2_000)[0].data)
    assert isinstance(status, StatusPacket)
    assert (status.agent_id, status.state, status.north_m, status.east_m) == (3, State.FLOATING, 1.5, -2.0)
    assert status.primary == pytest.approx(0.4, abs=1e-4) and status.agent_ms == 60_000
    mission.sends_a_packet(4)
    assert [it.agent_id for it in mission.published(3_000)] == [3]


def test_a_mission_leaves_the_topics_of_an_amussel_that_sends_packets_and_the_others_at_its_end(
    mission: Mission,
) -> None:
    mission.sends_a_packet(4)
    for now_ms in (1_000, 2_000):
        mission.take(now_ms)
    assert mission.left() == topics_of(4)
    mission.close()
    assert mission.left() == topics_of(3) and mission.graph.unregistered.empty()


def test_a_master_out_of_reach_does_not_hold_up_the_flight(mission: Mission) -> None:
    answered = threading.Event()
    mission.graph.before_unregistering = lambda: answered.wait(20)
    mission.sends_a_packet(3)
    for now_ms in (1_000, 2_000):
        mission.take(now_ms)
    assert mission.graph.unregistered.empty()
    answered.set()
    assert mission.left() == topics_of(3)


def test_an_amussel_known_by_topics_is_charged_while_a_dock_of_ours_holds_it(mission: Mission) -> None:
    """A mission second is half an agent minute: 1 point a second below 50 %, half a point above it."""

    def charged(now_ms: int) -> dict[str, float]:
        mission.graph.published.clear()
        mission.take(now_ms)
        return {topic: round(message.data, 9) for topic, message in mission.graph.published}

    for agent_id, percent in ((3, 40.0), (4, 80.0)):
        mission.graph.deliver(f"amussel{agent_id}/battery_level", data=percent)
    not_held = charged(1_000)
    mission.held.update((3, 4))
    assert [not_held, *map(charged, (2_000, 3_000, 5_000))] == [
        {},
        {},
        {"amussel3/charging": 1.0, "amussel4/charging": 0.5},
        {"amussel3/charging": 2.0, "amussel4/charging": 1.0},
    ]
    mission.graph.deliver("amussel4/battery_level", data=99.8)
    mission.sends_a_packet(3)
    assert charged(6_000) == {"amussel4/charging": 0.2}, (
        "no more than full; one with packets has its own charger"
    )
    mission.held.clear()
    assert charged(7_000) == {}


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
