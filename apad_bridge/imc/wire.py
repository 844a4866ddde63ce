"""The sockets of a gateway: one for its consoles, and one that hears their announcements by multicast.

A console is listed with its address, and with its IMC id if it may give orders. An order counts when it comes from that id
and that address, port included, to the gateway's own socket, addressed to the aPad. A console sends from the port at which
it listens, as Neptus does, so another user of its machine cannot send from there while it runs. Ids and addresses can be
forged: IMC has no authentication.
"""

from __future__ import annotations

import re
import selectors
import socket
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from apad_bridge.imc import protocol as imc
from apad_bridge.imc.protocol import Message

GROUP = "224.0.75.69"
ANNOUNCE_PORTS = range(30100, 30105)
_LONGEST_DATAGRAM = 65_535
_MOST_DISCOVERED = 8
_MOST_AT_ONCE = 200
"""Datagrams that are read before the run is shown again, whoever floods the port."""
_CONSOLE = re.compile(r"(?:(?P<id>0[xX][0-9a-fA-F]+|\d+)@)?(?P<host>[^@:\s]+):(?P<port>\d+)")
_SERVICE = re.compile(r"imc\+udp://(?P<host>\d+\.\d+\.\d+\.\d+):(?P<port>\d+)")

Address = tuple[str, int]


@dataclass(frozen=True, slots=True)
class ImcConsole:
    """A listed console. Without an `imc_id` it is shown the run and gives no orders."""

    address: Address
    imc_id: int | None = None

    @classmethod
    def parse(cls, text: str) -> ImcConsole:
        """A console from `[ID@]HOST:PORT`; the id may be hexadecimal. ValueError, one line, for anything else."""
        if (found := _CONSOLE.fullmatch(text)) is None:
            raise ValueError(f"{text}: a console is [ID@]HOST:PORT, as 0x4001@127.0.0.1:6001")
        port, imc_id = int(found["port"]), None if found["id"] is None else int(found["id"], 0)
        if not 0 < port < 65536 or (imc_id is not None and not 0 <= imc_id < 0xFFFF):
            raise ValueError(f"{text}: a port is 1 to 65535, and an IMC id 0 to 0xfffe")
        try:
            host = socket.gethostbyname(found["host"])
        except OSError as error:
            raise ValueError(f"{text}: {found['host']} is no address: {error.strerror}") from error
        return cls((host, port), imc_id)


@dataclass(frozen=True, slots=True)
class ReceivedMessage:
    message: Message
    sender: Address
    by_multicast: bool


class Wire:
    """Sends to every console, and receives. What cannot be read, or sent, is dropped and counted in `dropped`."""

    def __init__(self, listen: Address, consoles: tuple[ImcConsole, ...], *, multicast: bool) -> None:
        """Listens on an address of this machine. OSError, with a line for people, when it cannot be used."""
        self.dropped: Counter[str] = Counter()
        self._consoles = consoles
        self._discovered: dict[int, Address] = {}
        """Consoles that announced themselves, by id: they are shown the run."""
        self._announced: dict[ImcConsole, frozenset[Address]] = {}
        """By listed console, the addresses of its services on its other interfaces, at the port that it is listed with."""
        self._selector = selectors.DefaultSelector()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._group: socket.socket | None = None
        self._multicasts = multicast
        try:
            self._socket.bind(listen)
            self._socket.setblocking(False)
            if multicast:
                own = socket.inet_aton(listen[0])
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, own)
                self._group = _joined(own)
                self._selector.register(self._group, selectors.EVENT_READ, True)
        except OSError as error:
            self.close()
            why = f"cannot listen on {listen[0]} port {listen[1]}: {error.strerror}"
            raise OSError(error.errno, why) from error
        self._selector.register(self._socket, selectors.EVENT_READ, False)

    @property
    def address(self) -> Address:
        host, port = self._socket.getsockname()
        return host, port

    @property
    def services(self) -> str:
        """The address of the gateway, as an announcement states it."""
        host, port = self.address
        return f"imc+udp://{host}:{port}/"

    @property
    def destinations(self) -> list[Address]:
        return list(dict.fromkeys([*(it.address for it in self._consoles), *self._discovered.values()]))

    def send(self, message: Message, *, announces: bool = False) -> bytes:
        """Sends to every console, and what `announces` to the multicast group too; returns the packet."""
        data = imc.packed(message)
        for address in self.destinations:
            self._send(data, address)
        if announces and self._multicasts:
            for port in ANNOUNCE_PORTS:
                self._send(data, (GROUP, port))
        return data

    def send_to(self, message: Message, address: Address) -> bytes:
        data = imc.packed(message)
        self._send(data, address)
        return data

    def receive(self, timeout_s: float) -> Iterator[ReceivedMessage]:
        """Messages that have arrived, after at most `timeout_s` of waiting."""
        for key, _ in self._selector.select(timeout_s):
            link, by_multicast = key.fileobj, key.data
            assert isinstance(link, socket.socket)
            for _ in range(_MOST_AT_ONCE):
                try:
                    data, sender = link.recvfrom(_LONGEST_DATAGRAM)
                except BlockingIOError:
                    break
                except OSError:  # a console that is not there, told by its machine
                    self.dropped["a datagram that no console took"] += 1
                    continue
                if sender == self.address:
                    continue
                try:
                    message = imc.unpacked(data)
                except imc.Unreadable:
                    self.dropped["a datagram that is no IMC"] += 1
                    continue
                yield ReceivedMessage(message, sender, by_multicast)

    def discover(self, received: ReceivedMessage) -> None:
        """Takes an announcement. A console that is heard by multicast is shown the run from now on.

        A listed console's other interfaces are its own, too, if it announces them from its listed host with its listed
        port: a packet may leave a machine by another interface than the one that is listed.
        """
        announced = received.message
        if announced.sys_type != imc.SystemType.CCU:
            return
        services = [(it["host"], int(it["port"])) for it in _SERVICE.finditer(announced.services)]
        for console in self._consoles:
            host, port = console.address
            if console.imc_id == announced.src and received.sender[0] == host:
                self._announced[console] = frozenset(it for it in services if it[1] == port)
        is_known = announced.src in self._discovered
        if received.by_multicast and services and (is_known or len(self._discovered) < _MOST_DISCOVERED):
            self._discovered[announced.src] = services[0]

    def why_not_obeyed(self, received: ReceivedMessage, apad_id: int) -> str | None:
        """Why an order does not count; None for one that does."""
        message = received.message
        if received.by_multicast:
            return "an order by multicast"
        if message.dst != apad_id:
            return "an order that is not addressed to the aPad"
        if not any(
            it.imc_id == message.src
            and (received.sender == it.address or received.sender in self._announced.get(it, ()))
            for it in self._consoles
        ):
            return "an order of a console that is not listed with its id, its address and its port"
        return None

    def close(self) -> None:
        self._selector.close()
        self._socket.close()
        if self._group is not None:
            self._group.close()

    def _send(self, data: bytes, address: Address) -> None:
        try:
            self._socket.sendto(data, address)
        except OSError:
            self.dropped["a datagram that the network refused"] += 1


def _joined(interface: bytes) -> socket.socket:
    """A socket in the multicast group, on the first port of the announcements that is free. OSError for none."""
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        for port in ANNOUNCE_PORTS:
            try:
                link.bind((GROUP, port))
                break
            except OSError:
                if port == ANNOUNCE_PORTS[-1]:
                    raise
        membership = struct.pack("4s4s", socket.inet_aton(GROUP), interface)
        link.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        link.setblocking(False)
    except OSError:
        link.close()
        raise
    return link
