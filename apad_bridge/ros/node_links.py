"""The ways by which real aMussels are reached: a nanomodem, Wi-Fi, and an aPad's own topics of its modem.

Each carries bytes of the nodes' own and knows nothing of what they mean. One thread owns a link.
"""

from __future__ import annotations

import select
import socket
import threading
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.modem.modem_model import metres_of
from agents.packet_medium import Medium
from agents.serial_port import SerialPort
from apad_bridge.acoustics.serial.attached import AttachedModem, NanomodemResult
from apad_bridge.acoustics.serial.nanomodem import (
    Framing,
    ModemNotice,
    ModemRanged,
    PacketDirection,
    PacketDropped,
    PacketReceived,
    PacketSent,
)
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.doctor.modem import check_modem
from apad_bridge.ros.links.laboratory_topics import LaboratoryPublishers, LaboratorySubscribers
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.lab_interface.lab_messages import LaboratoryPacket, MessageKind
from apad_bridge.scenario.lab_interface.lab_names import Names, Publication, Subscription, load_names
from firmware_model.packets import EVERYONE

_WIFI = "udp:"
_LARGEST = 1024
"""Bytes; a longer datagram is no packet of an aMussel."""
_DATAGRAMS = 256
"""The most that are read in one call, so that a flood holds up nothing else."""
_KEPT_MS = 30_000
"""A node's address is kept until the node has been silent for so long, whoever else sends its id."""
_ELSEWHERE = (
    "wifi: a second address of an aMussel: its commands go to the first until that is silent for 30 s"
)
_SKIPPED = "bytes of the modem that belong to no answer"


@dataclass(frozen=True, slots=True)
class FromNode:
    """Bytes that a node sent. `agent_id` is stated beside them; None where only the bytes name their sender."""

    agent_id: int | None
    data: bytes
    sender: Any = None
    """The address from which they came, where the link has addresses."""


@dataclass(frozen=True, slots=True)
class SentToNode:
    pass


@dataclass(frozen=True, slots=True)
class NodeRanged:
    """A node answered a ping from `range_m`."""

    agent_id: int
    range_m: float


@dataclass(frozen=True, slots=True)
class NotCarried:
    reason: str
    count: int = 1


@dataclass(frozen=True, slots=True)
class LinkNotice:
    """A line for a person."""

    text: str


LinkResult = FromNode | SentToNode | NodeRanged | NotCarried | LinkNotice


class NodeLink:
    """One way to nodes, of one medium. It is opened before the bridge's node is on the graph, and begun after."""

    medium: Medium
    name: str
    """For a person."""

    def begin(self) -> None:
        """Does what needs the node on the graph."""

    def wait(self, timeout_s: float) -> None:
        """Waits until something has come, for `timeout_s` at most."""
        raise NotImplementedError

    def poll(self, now_ms: int) -> list[LinkResult]:
        """All results since the last call."""
        raise NotImplementedError

    def send(self, agent_id: int, data: bytes, now_ms: int) -> list[LinkResult]:
        """Sends bytes to an aMussel, or to EVERYONE."""
        raise NotImplementedError

    def ping(self, agent_id: int, now_ms: int) -> list[LinkResult]:
        """Measures the range to an aMussel, where the link can; the range is a later result."""
        return [NotCarried("to an aMussel: a ping, and only a nanomodem on a serial port measures ranges")]

    def found(self, agent_id: int, sender: Any) -> list[LinkResult]:
        """An aMussel's bytes came from the address `sender` in the last `poll`, where the link has addresses."""
        return []

    def close(self) -> None:
        raise NotImplementedError


def open_links(
    ports: Sequence[str], apad: str, ids: Iterable[int], *, has_header: bool, sound_speed_m_s: float
) -> list[NodeLink]:
    """Opens a link by each of `ports`, which are as `musselbed bridge` takes them.

    Raises UserError for two of one medium, and for one that cannot be opened.
    """
    links: list[NodeLink] = []
    try:
        for port in ports:
            links.append(_link(port, apad, ids, has_header, sound_speed_m_s))
            if len({it.medium for it in links}) < len(links):
                medium = links[-1].medium.value
                raise UserError(
                    f"{port}: a bridge has one port by {medium}: begin another bridge for its aMussels"
                )
    except BaseException:
        for link in links:
            link.close()
        raise
    return links


def _link(port: str, apad: str, ids: Iterable[int], has_header: bool, sound_speed_m_s: float) -> NodeLink:
    if port.startswith(_WIFI):
        return WifiLink(port)
    if port.endswith((".yaml", ".yml")):
        return TopicLink(Path(port), apad, ids)
    return ModemLink(port, Framing.HEADER if has_header else Framing.BARE, sound_speed_m_s)


class ModemLink(NodeLink):
    """A nanomodem on a serial port."""

    medium = Medium.SOUND

    def __init__(self, port: str, framing: Framing, sound_speed_m_s: float) -> None:
        """Raises UserError where no modem answers."""
        (finding,) = check_modem(Path(port), None)
        if finding.status is not CheckStatus.OK:
            raise UserError(f"{finding.found}: {finding.mend}")
        self.name = finding.found
        self._modem = AttachedModem(SerialPort(port), framing=framing)
        self._sound_speed_m_s = sound_speed_m_s
        self._skipped = 0

    def wait(self, timeout_s: float) -> None:
        self._modem.port.wait(timeout_s)

    def poll(self, now_ms: int) -> list[LinkResult]:
        results = [self._result(it) for it in self._modem.poll(now_ms)]
        if (skipped := self._modem.queue.skipped_bytes) > self._skipped:
            results.append(NotCarried(_SKIPPED, skipped - self._skipped))
            self._skipped = skipped
        return results

    def send(self, agent_id: int, data: bytes, now_ms: int) -> list[LinkResult]:
        return [self._result(it) for it in self._modem.command(agent_id, data, now_ms)]

    def ping(self, agent_id: int, now_ms: int) -> list[LinkResult]:
        return [self._result(it) for it in self._modem.ping(agent_id, now_ms)]

    def close(self) -> None:
        self._modem.close()

    def _result(self, result: NanomodemResult) -> LinkResult:
        match result:
            case PacketReceived(_, packet):
                if packet.direction is not PacketDirection.FROM_AMUSSEL:
                    return NotCarried("heard: another bridge's packet to an aMussel")
                return FromNode(None if packet.agent_id == EVERYONE else packet.agent_id, packet.data)
            case PacketSent():
                return SentToNode()
            case ModemRanged(_, agent_id, steps):
                return NodeRanged(agent_id, metres_of(steps, self._sound_speed_m_s))
            case PacketDropped(_, reason):
                return NotCarried(reason)
            case ModemNotice(_, what):
                return LinkNotice(what)


class WifiLink(NodeLink):
    """Datagrams (UDP): a packet each, from nodes on the same Wi-Fi. A node is answered where it sends from."""

    medium = Medium.WIFI

    def __init__(self, name: str) -> None:
        """`name` is `udp:PORT`, on loopback, or `udp:ADDRESS:PORT`. UserError if nobody can listen there."""
        self.name = name
        host, _, port = name.removeprefix(_WIFI).rpartition(":")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._now_ms = 0
        self._senders: dict[int, tuple[Any, int]] = {}
        """A node's address, and the time at which it last sent from there."""
        try:
            self._socket.bind((host or "127.0.0.1", int(port)))
        except (OSError, ValueError, OverflowError) as error:
            self._socket.close()
            mend = f"give {_WIFI}ADDRESS:PORT, with an address of this computer and a free port"
            raise UserError(f"{name}: nobody can listen there ({error}): {mend}") from None
        self._socket.setblocking(False)

    def wait(self, timeout_s: float) -> None:
        select.select([self._socket], [], [], timeout_s)

    def poll(self, now_ms: int) -> list[LinkResult]:
        self._now_ms = now_ms
        results: list[LinkResult] = []
        for _ in range(_DATAGRAMS):
            try:
                data, sender = self._socket.recvfrom(_LARGEST + 1)
            except BlockingIOError:
                break
            except OSError as error:  # what an earlier datagram of ours met
                results.append(NotCarried(f"wifi: {error.strerror}"))
                continue
            large = len(data) > _LARGEST
            results.append(NotCarried("wifi: too large") if large else FromNode(None, data, sender))
        return results

    def send(self, agent_id: int, data: bytes, now_ms: int) -> list[LinkResult]:
        them = self._senders if agent_id == EVERYONE else {agent_id} & self._senders.keys()
        if not them:
            return [NotCarried("wifi: to an aMussel that has not sent yet, so that its address is not known")]
        results: list[LinkResult] = []
        for one in sorted(them):
            try:
                self._socket.sendto(data, self._senders[one][0])
                results.append(SentToNode())
            except OSError as error:
                results.append(NotCarried(f"wifi: {error.strerror}"))
        return results

    def found(self, agent_id: int, sender: Any) -> list[LinkResult]:
        kept, heard_ms = self._senders.get(agent_id, (sender, 0))
        if sender != kept and self._now_ms - heard_ms < _KEPT_MS:
            return [NotCarried(_ELSEWHERE)]
        self._senders[agent_id] = sender, self._now_ms
        return []

    def close(self) -> None:
        self._socket.close()


class TopicLink(NodeLink):
    """An aPad's own topics, on which its modem says what it heard and is told what to send."""

    def __init__(self, path: Path, apad: str, ids: Iterable[int]) -> None:
        """`path` is a file of a laboratory's names (`scenario.lab_interface`), of packets of one medium alone.

        Raises UserError for another file.
        """
        self.name = str(path)
        self._names, self._apad, self._ids = _names_of_packets(path), apad, tuple(ids)
        self.medium = self._names.hear[0].medium
        self._counted: Counter[str] = Counter()
        self._pause = threading.Event()
        self._begun: list[LaboratorySubscribers | LaboratoryPublishers] = []

    def begin(self) -> None:
        """Raises VehicleNotReady for a message type that is known nowhere."""
        self._publishers = LaboratoryPublishers(self._names, self._apad, self._ids)
        self._subscribers = LaboratorySubscribers(self._names, self._apad, self._ids)
        self._begun = [self._subscribers, self._publishers]

    def wait(self, timeout_s: float) -> None:
        self._pause.wait(timeout_s)

    def poll(self, now_ms: int) -> list[LinkResult]:
        results: list[LinkResult] = []
        for message in self._subscribers.take(now_ms):
            assert isinstance(message, LaboratoryPacket), "the names are of packets alone"
            results.append(FromNode(message.agent_id, message.data))
        dropped = self._subscribers.dropped
        results += [NotCarried(reason, count) for reason, count in (dropped - self._counted).items()]
        self._counted = dropped
        return results

    def send(self, agent_id: int, data: bytes, now_ms: int) -> list[LinkResult]:
        self._publishers.publish(MessageKind.PACKET, agent_id, now_ms, data=data)
        return [SentToNode()]

    def close(self) -> None:
        for it in self._begun:
            it.close()


def _names_of_packets(path: Path) -> Names:
    mend = "see launch_scripts/interfaces/nodes.yaml"
    try:
        names = load_names(path)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: {error}; {mend}") from None
    entries: list[Subscription | Publication] = [*names.hear, *names.tell]
    if any(it.what is not MessageKind.PACKET for it in entries) or not (names.hear and names.tell):
        raise UserError(f"{path}: a bridge hears packets and tells packets, and nothing else: {mend}")
    if len({it.medium for it in entries}) > 1:
        raise UserError(f"{path}: all its packets need one medium: {mend}")
    return names
