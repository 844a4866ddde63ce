"""Exchanges a laboratory's own messages with a flight: alerts of docks, permissions, releases, packets, Wi-Fi.

laboratory = Laboratory(names, "apad1", agent_ids, codec)
link = LaboratoryLink(laboratory, vehicle, None)
relay = PacketRelay(division, [laboratory.take], laboratory.outlets)
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

from agents.packet_medium import medium_of
from agents.time_scale import MissionMs
from apad_bridge.ros.links.laboratory_topics import LaboratoryPublishers, LaboratorySubscribers
from apad_bridge.scenario.lab_interface.lab_messages import (
    DockReport,
    LaboratoryMessage,
    LaboratoryPacket,
    MessageKind,
)
from apad_bridge.scenario.lab_interface.lab_names import Names
from apad_bridge.supervisor.packet_relay import Outlet, PacketOrigin, RelayedPacket, RelayOutcome
from apad_bridge.vehicle.commands import DockClosed, DockOpened, VehicleCommand
from apad_bridge.vehicle.vehicle_link import Cleared, LinkFact, VehicleLink
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import Codec

WIFI_GONE_MS = 10_000
"""An aMussel that has sent nothing by Wi-Fi for so long is reported to be off it."""
_KINDS = {MessageKind.PERMISSION: Kind.PERMISSION, MessageKind.CLEAR: Kind.RELEASE}
_WHATS = {kind: what for what, kind in _KINDS.items()}


class Laboratory:
    """Raises VehicleNotReady when a message to be published has a type or field that is not known here."""

    def __init__(self, names: Names, apad: str, agent_ids: Iterable[int], codec: Codec) -> None:
        self.subscribers = LaboratorySubscribers(names, apad, agent_ids)
        self.publishers = LaboratoryPublishers(names, apad, agent_ids)
        self.ignored: Counter[str] = Counter()
        self.messages: list[LaboratoryMessage] = []
        """The messages for aMussels that the link has received."""
        self._ids = tuple(agent_ids)
        self._codec = codec
        self._on_wifi: dict[int, int] = {}
        """The time of the last packet by Wi-Fi of each aMussel that is on it."""

    @property
    def dropped(self) -> Counter[str]:
        """Messages without an effect, by reason."""
        return self.subscribers.dropped + self.ignored

    @property
    def outlets(self) -> dict[RelayOutcome, Outlet]:
        return {
            RelayOutcome.PUBLISH_PACKET: self._publish_packet,
            RelayOutcome.PUBLISH_WIFI: self._publish_wifi,
            RelayOutcome.PUBLISH_COMMAND: self._publish_command,
        }

    def take(self, now_ms: MissionMs) -> list[RelayedPacket]:
        """The packets for aMussels. It also publishes which aMussels have left the Wi-Fi."""
        messages, self.messages = self.messages, []
        for agent_id, last_ms in list(self._on_wifi.items()):
            if now_ms - last_ms > WIFI_GONE_MS:
                del self._on_wifi[agent_id]
                self.publishers.publish(MessageKind.WIFI, agent_id, now_ms, on=False)
        return [packet for message in messages for packet in self._packets(message, now_ms)]

    def close(self) -> None:
        self.subscribers.close()
        self.publishers.close()

    def _publish_packet(self, packet: RelayedPacket) -> None:
        self.publishers.publish(MessageKind.PACKET, packet.agent_id, packet.at_ms, data=packet.data)

    def _publish_wifi(self, packet: RelayedPacket) -> None:
        if packet.agent_id not in self._on_wifi:
            self.publishers.publish(MessageKind.WIFI, packet.agent_id, packet.at_ms, on=True)
        self._on_wifi[packet.agent_id] = packet.at_ms

    def _publish_command(self, packet: RelayedPacket) -> None:
        command = self._codec.decode(packet.data)
        if isinstance(command, CommandPacket) and (what := _WHATS.get(command.kind)) is not None:
            self.publishers.publish(what, packet.agent_id, packet.at_ms, data=packet.data)

    def _packets(self, message: LaboratoryMessage, now_ms: MissionMs) -> list[RelayedPacket]:
        if isinstance(message, DockReport):
            return []
        ids = self._ids if message.agent_id is None else (message.agent_id,)
        if isinstance(message, LaboratoryPacket):
            contents = [(agent_id, message.medium, message.data) for agent_id in ids]
        else:
            kind = _KINDS[message.what]
            contents = [(it, medium_of(kind), self._codec.encode(CommandPacket(kind, it))) for it in ids]
        return [RelayedPacket(PacketOrigin.LABORATORY, *content, now_ms) for content in contents]


class LaboratoryLink:
    """The vehicle's link, which also receives alerts of docks from others, and publishes its own."""

    def __init__(
        self, laboratory: Laboratory, vehicle: VehicleLink, dock_report: Callable[[DockReport], None] | None
    ) -> None:
        self._laboratory = laboratory
        self._vehicle = vehicle
        self._dock_report = dock_report

    def advance(self, now_ms: int) -> list[LinkFact]:
        laboratory = self._laboratory
        for message in laboratory.subscribers.take(now_ms):
            if not isinstance(message, DockReport):
                laboratory.messages.append(message)
            elif self._dock_report is not None:
                self._dock_report(message)
            else:
                laboratory.ignored["a docked alert, though the aPad itself reports what it holds"] += 1
        facts = self._vehicle.advance(now_ms)
        for fact in facts:
            if isinstance(fact, DockClosed | DockOpened):
                what = MessageKind.DOCKED if isinstance(fact, DockClosed) else MessageKind.RELEASED
                laboratory.publishers.publish(what, fact.agent_id, now_ms, dock_index=fact.dock_index)
        return facts

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        self._vehicle.command(cleared, now_ms)

    def close(self) -> None:
        self._vehicle.close()
