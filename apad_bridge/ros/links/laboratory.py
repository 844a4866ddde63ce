"""Exchanges a laboratory's own messages with a flight: alerts of docks, permissions, releases, packets, Wi-Fi.

laboratory = Laboratory(names, "apad1", agent_ids, codec)
link = laboratory.wrap_link(vehicle, None)
relay = laboratory.wrap_relay(relay, link, is_mission=False)
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Protocol, runtime_checkable

from agents.packet_medium import Medium
from apad_bridge.mission.events import Send
from apad_bridge.ros.links.laboratory_topics import LaboratoryPublishers, LaboratorySubscribers
from apad_bridge.scenario.lab_interface.messages import (
    ClearanceMessage,
    DockReport,
    LaboratoryMessage,
    LaboratoryPacket,
    MessageKind,
)
from apad_bridge.scenario.lab_interface.names import Names
from apad_bridge.supervisor.packet_relay import PacketRelay, RelayedEvent
from apad_bridge.vehicle.commands import DockClosed, DockOpened, VehicleCommand
from apad_bridge.vehicle.link import LinkFact, VehicleLink
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import Codec

WIFI_GONE_MS = 10_000
"""An aMussel that has sent nothing by Wi-Fi for so long is reported to be off it."""
_KINDS = {
    MessageKind.PERMISSION: (Kind.PERMISSION, Medium.SOUND),
    MessageKind.CLEAR: (Kind.RELEASE, Medium.WIFI),
}
_WHATS = {kind: what for what, (kind, _) in _KINDS.items()}


@runtime_checkable
class DockAlertReceiver(Protocol):
    """A link whose vehicle does not publish what its docks hold."""

    def receive_dock_report(self, alert: DockReport) -> None: ...


class Laboratory:
    """Raises VehicleNotReady when a message to be published has a type or field that is not known here."""

    def __init__(self, names: Names, apad: str, agent_ids: Iterable[int], codec: Codec) -> None:
        self.ids = list(agent_ids)
        self.codec = codec
        self.subscribers = LaboratorySubscribers(names, apad, self.ids)
        self.publishers = LaboratoryPublishers(names, apad, self.ids)
        self.ignored: Counter[str] = Counter()

    def wrap_link(self, vehicle: VehicleLink, docks: DockAlertReceiver | None) -> LaboratoryLink:
        return LaboratoryLink(self, vehicle, docks)

    def wrap_relay(
        self, relay: PacketRelay | None, link: LaboratoryLink, *, is_mission: bool
    ) -> LaboratoryRelay:
        return LaboratoryRelay(self, relay, link, is_mission=is_mission)

    @property
    def dropped(self) -> Counter[str]:
        """Messages without an effect, by reason."""
        return self.subscribers.dropped + self.ignored

    def close(self) -> None:
        self.subscribers.close()
        self.publishers.close()


class LaboratoryLink:
    """The vehicle's link, which also receives alerts of docks from others, and publishes its own."""

    def __init__(self, laboratory: Laboratory, vehicle: VehicleLink, docks: DockAlertReceiver | None) -> None:
        self._laboratory = laboratory
        self._vehicle = vehicle
        self._docks = docks
        self.messages: list[LaboratoryMessage] = []

    def advance(self, now_ms: int) -> list[LinkFact]:
        laboratory = self._laboratory
        for message in laboratory.subscribers.take(now_ms):
            if not isinstance(message, DockReport):
                self.messages.append(message)
            elif self._docks is not None:
                self._docks.receive_dock_report(message)
            else:
                laboratory.ignored["a docked alert, where the aPad itself tells what it holds"] += 1
        facts = self._vehicle.advance(now_ms)
        for fact in facts:
            if isinstance(fact, DockClosed | DockOpened):
                what = MessageKind.DOCKED if isinstance(fact, DockClosed) else MessageKind.RELEASED
                laboratory.publishers.publish(what, fact.agent_id, now_ms, dock_index=fact.dock_index)
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        self._vehicle.command(command, now_ms)

    def close(self) -> None:
        self._vehicle.close()


class LaboratoryRelay:
    """A PacketRelay that adds the laboratory's topics to `inner`.

    With `is_mission` the aMussels are elsewhere and the packets transmitted here are a supervisor's; otherwise theirs.
    """

    def __init__(
        self, laboratory: Laboratory, inner: PacketRelay | None, link: LaboratoryLink, *, is_mission: bool
    ) -> None:
        self._link = link
        self._laboratory = laboratory
        self._inner = inner
        self._is_mission = is_mission
        self._on_wifi: dict[int, int] = {}
        """The time of the last packet by Wi-Fi of each aMussel that is on it."""

    def advance(self, now_ms: int) -> list[RelayedEvent]:
        messages, self._link.messages = self._link.messages, []
        received: list[RelayedEvent] = [send for message in messages for send in self._sends(message)]
        for agent_id, last_ms in list(self._on_wifi.items()):
            if now_ms - last_ms > WIFI_GONE_MS:
                del self._on_wifi[agent_id]
                self._laboratory.publishers.publish(MessageKind.WIFI, agent_id, now_ms, on=False)
        return received if self._inner is None else [*received, *self._inner.advance(now_ms)]

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        if self._inner is not None:
            self._inner.transmit(medium, agent_id, data, now_ms)
        if self._is_mission:
            self._publish_command(agent_id, data, now_ms)
            return
        if medium is Medium.SOUND:
            self._laboratory.publishers.publish(MessageKind.PACKET, agent_id, now_ms, data=data)
            return
        if agent_id not in self._on_wifi:
            self._laboratory.publishers.publish(MessageKind.WIFI, agent_id, now_ms, on=True)
        self._on_wifi[agent_id] = now_ms

    def forward(self, send: Send, now_ms: int) -> None:
        if self._inner is not None:
            self._inner.forward(send, now_ms)
        self._publish_command(send.agent_id, send.data, now_ms)

    def _publish_command(self, agent_id: int, data: bytes, now_ms: int) -> None:
        packet = self._laboratory.codec.decode(data)
        if isinstance(packet, CommandPacket) and (what := _WHATS.get(packet.kind)) is not None:
            self._laboratory.publishers.publish(what, agent_id, now_ms, data=data)

    def _sends(self, message: LaboratoryMessage) -> list[Send]:
        laboratory = self._laboratory
        match message:
            case ClearanceMessage(what, agent_id):
                kind, medium = _KINDS[what]
                ids = laboratory.ids if agent_id is None else [agent_id]
                return [Send(medium, it, laboratory.codec.encode(CommandPacket(kind, it))) for it in ids]
            case LaboratoryPacket(medium, agent_id, data):
                ids = laboratory.ids if agent_id is None else [agent_id]
                return [Send(medium, it, data) for it in ids]
        return []
