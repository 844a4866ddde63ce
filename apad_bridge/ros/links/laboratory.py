"""A laboratory's own words on the graph, both ways: docks by others' hands, permissions, releases, packets, Wi-Fi.

laboratory = Laboratory(names, "apad1", agent_ids, codec)
vehicle, ether = laboratory.beside(vehicle), laboratory.around(ether)
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Protocol, runtime_checkable

from agents.packet_medium import Medium
from apad_bridge.mission.events import Send
from apad_bridge.ros.links.laboratory_topics import LaboratoryPublishers, LaboratorySubscribers
from apad_bridge.scenario.lab_interface.messages import DockSaid, PacketSaid, Said, What, WordSaid
from apad_bridge.scenario.lab_interface.names import Names
from apad_bridge.supervisor.packet_relay import Came, PacketRelay
from apad_bridge.vehicle.commands import DockClosed, DockOpened, VehicleCommand
from apad_bridge.vehicle.link import LinkFact, VehicleLink
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import Codec

WIFI_GONE_MS = 10_000
"""An aMussel that has sent nothing by Wi-Fi for so long is told to be off it."""
_KINDS = {What.PERMISSION: (Kind.PERMISSION, Medium.SOUND), What.CLEAR: (Kind.RELEASE, Medium.WIFI)}
_WHATS = {kind: what for what, (kind, _) in _KINDS.items()}


@runtime_checkable
class HearsOfDocks(Protocol):
    """A link whose vehicle does not tell itself what its docks hold."""

    def said(self, word: DockSaid) -> None: ...


class Laboratory:
    """VehicleNotReady when something that shall be told has a type or field that is not known here."""

    def __init__(self, names: Names, apad: str, agent_ids: Iterable[int], codec: Codec) -> None:
        self.ids = list(agent_ids)
        self.codec = codec
        self.subscribers = LaboratorySubscribers(names, apad, self.ids)
        self.publishers = LaboratoryPublishers(names, apad, self.ids)
        self.useless: Counter[str] = Counter()

    def beside(self, vehicle: VehicleLink, hears: HearsOfDocks | None) -> LaboratoryLink:
        return LaboratoryLink(self, vehicle, hears)

    def around(self, relay: PacketRelay | None, link: LaboratoryLink, *, is_mission: bool) -> LaboratoryRelay:
        return LaboratoryRelay(self, relay, link, is_mission=is_mission)

    @property
    def dropped(self) -> Counter[str]:
        """Words that came to nothing, by reason."""
        return self.subscribers.dropped + self.useless

    def close(self) -> None:
        self.subscribers.close()
        self.publishers.close()


class LaboratoryLink:
    """The vehicle's link, which also hears of docks from others, and tells of its own."""

    def __init__(self, laboratory: Laboratory, vehicle: VehicleLink, hears: HearsOfDocks | None) -> None:
        self._laboratory = laboratory
        self._vehicle = vehicle
        self._hears = hears
        self.words: list[Said] = []

    def advance(self, now_ms: int) -> list[LinkFact]:
        laboratory = self._laboratory
        for word in laboratory.subscribers.take(now_ms):
            if not isinstance(word, DockSaid):
                self.words.append(word)
            elif self._hears is not None:
                self._hears.said(word)
            else:
                laboratory.useless["a docked alert, where the aPad itself tells what it holds"] += 1
        facts = self._vehicle.advance(now_ms)
        for fact in facts:
            if isinstance(fact, DockClosed | DockOpened):
                what = What.DOCKED if isinstance(fact, DockClosed) else What.RELEASED
                laboratory.publishers.tell(what, fact.agent_id, now_ms, dock_index=fact.dock_index)
        return facts

    def command(self, command: VehicleCommand, now_ms: int) -> None:
        self._vehicle.command(command, now_ms)

    def close(self) -> None:
        self._vehicle.close()


class LaboratoryRelay:
    """What passes between aMussels and supervisors, with the laboratory's topics listening and speaking in.

    With `is_mission` the aMussels are elsewhere, and what is transmitted here is a supervisor's; otherwise it is theirs.
    """

    def __init__(
        self, laboratory: Laboratory, inner: PacketRelay | None, link: LaboratoryLink, *, is_mission: bool
    ) -> None:
        self._link = link
        self._laboratory = laboratory
        self._inner = inner
        self._is_mission = is_mission
        self._on_wifi: dict[int, int] = {}
        """When each aMussel that is on the Wi-Fi last sent something."""

    def advance(self, now_ms: int) -> list[Came]:
        words, self._link.words = self._link.words, []
        heard: list[Came] = [send for word in words for send in self._sends(word)]
        for agent_id, last_ms in list(self._on_wifi.items()):
            if now_ms - last_ms > WIFI_GONE_MS:
                del self._on_wifi[agent_id]
                self._laboratory.publishers.tell(What.WIFI, agent_id, now_ms, on=False)
        return heard if self._inner is None else [*heard, *self._inner.advance(now_ms)]

    def transmit(self, medium: Medium, agent_id: int, data: bytes, now_ms: int) -> None:
        if self._inner is not None:
            self._inner.transmit(medium, agent_id, data, now_ms)
        if self._is_mission:
            self._tell_word(agent_id, data, now_ms)
            return
        if medium is Medium.SOUND:
            self._laboratory.publishers.tell(What.PACKET, agent_id, now_ms, data=data)
            return
        if agent_id not in self._on_wifi:
            self._laboratory.publishers.tell(What.WIFI, agent_id, now_ms, on=True)
        self._on_wifi[agent_id] = now_ms

    def said(self, send: Send, now_ms: int) -> None:
        if self._inner is not None:
            self._inner.said(send, now_ms)
        self._tell_word(send.agent_id, send.data, now_ms)

    def _tell_word(self, agent_id: int, data: bytes, now_ms: int) -> None:
        packet = self._laboratory.codec.decode(data)
        if isinstance(packet, CommandPacket) and (what := _WHATS.get(packet.kind)) is not None:
            self._laboratory.publishers.tell(what, agent_id, now_ms, data=data)

    def _sends(self, word: Said) -> list[Send]:
        laboratory = self._laboratory
        match word:
            case WordSaid(what, agent_id):
                kind, medium = _KINDS[what]
                ids = laboratory.ids if agent_id is None else [agent_id]
                return [Send(medium, it, laboratory.codec.encode(CommandPacket(kind, it))) for it in ids]
            case PacketSaid(medium, agent_id, data):
                ids = laboratory.ids if agent_id is None else [agent_id]
                return [Send(medium, it, data) for it in ids]
        return []
