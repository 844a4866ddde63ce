"""A laboratory's messages between topics and the flight, with the topics simulated by the test."""

from __future__ import annotations

from typing import Any
from unittest.mock import MagicMock

import pytest

from agents.packet_medium import Medium
from apad_bridge.mission.facts import Send
from apad_bridge.ros.links.laboratory import WIFI_GONE_MS, Laboratory, LaboratoryLink
from apad_bridge.scenario.lab_interface.lab_messages import (
    ClearanceMessage,
    DockReport,
    LaboratoryMessage,
    LaboratoryPacket,
    MessageKind,
)
from apad_bridge.supervisor.packet_relay import PacketRelay, whole_flight
from apad_bridge.vehicle.commands import DockClosed, DockOpened
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import load_codec

CODEC = load_codec("musselbed-1")


class Topics:
    """Stands in for the subscribers, with messages to receive, and for the publishers, with those published."""

    def __init__(self) -> None:
        self.to_receive: list[LaboratoryMessage] = []
        self.published: list[tuple[Any, ...]] = []
        self.dropped: Any = None

    def take(self, now_ms: int) -> list[LaboratoryMessage]:
        received, self.to_receive = self.to_receive, []
        return received

    def publish(self, what: MessageKind, agent_id: int, now_ms: int, **more: Any) -> None:
        self.published.append((what, agent_id, *more.values()))

    def close(self) -> None:
        pass


@pytest.fixture
def topics() -> Topics:
    return Topics()


@pytest.fixture
def laboratory(topics: Topics, monkeypatch: pytest.MonkeyPatch) -> Laboratory:
    monkeypatch.setattr("apad_bridge.ros.links.laboratory.LaboratorySubscribers", lambda *_: topics)
    monkeypatch.setattr("apad_bridge.ros.links.laboratory.LaboratoryPublishers", lambda *_: topics)
    return Laboratory(None, "apad1", [3, 4], CODEC)  # type: ignore[arg-type]


def relay_of(laboratory: Laboratory) -> PacketRelay:
    """The relay of a flight that simulates both aMussels."""
    return PacketRelay(whole_flight(lambda: frozenset({3, 4})), [laboratory.take], laboratory.outlets)


@pytest.mark.parametrize("takes_alerts", [True, False])
def test_docks_by_others_reach_a_vehicle_that_needs_them_and_its_own_are_told(
    laboratory: Laboratory, topics: Topics, takes_alerts: bool
) -> None:
    facts, alerts = [DockClosed(1_000, 2, 3), DockOpened(1_000, 1, 4)], list[DockReport]()
    vehicle = MagicMock(advance=lambda now_ms: facts)
    link = LaboratoryLink(laboratory, vehicle, alerts.append if takes_alerts else None)
    topics.to_receive = [DockReport(1_000, None, 2, True)]
    assert link.advance(1_000) == facts
    link.command("an order", 1_000)
    assert vehicle.command.call_args.args == ("an order", 1_000)
    assert alerts == [DockReport(1_000, None, 2, True)] * takes_alerts
    assert laboratory.ignored.total() == (not takes_alerts)
    assert topics.published == [(MessageKind.DOCKED, 3, 2), (MessageKind.RELEASED, 4, 1)]


def test_words_and_packets_become_what_aMussels_hear(laboratory: Laboratory, topics: Topics) -> None:
    link = LaboratoryLink(laboratory, MagicMock(advance=lambda now_ms: []), None)
    relay = relay_of(laboratory)
    topics.to_receive = [
        ClearanceMessage(MessageKind.PERMISSION, 3),
        ClearanceMessage(MessageKind.CLEAR, None),
        LaboratoryPacket(Medium.SOUND, 4, b"bytes"),
    ]
    link.advance(1_000)
    permission = CODEC.encode(CommandPacket(Kind.PERMISSION, 3))
    first, second = (CODEC.encode(CommandPacket(Kind.RELEASE, agent_id)) for agent_id in (3, 4))
    assert relay.advance(1_000) == [
        Send(Medium.SOUND, 3, permission),
        Send(Medium.WIFI, 3, first),
        Send(Medium.WIFI, 4, second),
        Send(Medium.SOUND, 4, b"bytes"),
    ]
    assert relay.advance(2_000) == []


def test_what_is_said_to_amussels_and_by_them_is_told(laboratory: Laboratory, topics: Topics) -> None:
    relay = relay_of(laboratory)
    data = CODEC.encode(CommandPacket(Kind.RELEASE, 3))
    relay.forward(Send(Medium.WIFI, 3, data), 0)
    relay.transmit(Medium.SOUND, 4, b"status", 0)
    assert topics.published == [(MessageKind.CLEAR, 3, data), (MessageKind.PACKET, 4, b"status")]


def test_the_wifis_status_is_told_when_it_changes(laboratory: Laboratory, topics: Topics) -> None:
    relay = relay_of(laboratory)
    for now_ms in (0, 1_000, 2_000):
        relay.transmit(Medium.WIFI, 3, b"status", now_ms)
        relay.advance(now_ms)
    relay.advance(2_000 + WIFI_GONE_MS)
    assert topics.published == [(MessageKind.WIFI, 3, True)]
    relay.advance(2_001 + WIFI_GONE_MS)
    assert topics.published == [(MessageKind.WIFI, 3, True), (MessageKind.WIFI, 3, False)]
