"""Whose orders count: those of a listed id, from its address, to the gateway's own socket, for the aPad."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import imcpy
import pytest
from imc_codec import Codec

from apad_bridge.imc.wire import ANNOUNCE_PORTS, GROUP, ImcConsole, ReceivedMessage, Wire

NEPTUS, APAD = 0x4001, 0x2A01
PATIENCE_S = 60.0


def local_socket() -> socket.socket:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", 0))
    link.settimeout(PATIENCE_S)
    return link


@pytest.fixture
def console() -> Iterator[socket.socket]:
    with local_socket() as link:
        yield link


@pytest.fixture
def wire(console: socket.socket) -> Iterator[Wire]:
    opened = Wire(("127.0.0.1", 0), (ImcConsole(console.getsockname(), NEPTUS),), multicast=False)
    yield opened
    opened.close()


def received(wire: Wire) -> list[ReceivedMessage]:
    while not (found := list(wire.receive(PATIENCE_S))):
        pass
    return found


def packet(codec: Codec, kind: str, src: int, dst: int = APAD, **fields: object) -> imcpy.Message:
    return imcpy.Packet.deserialize(codec.pack(codec.make(kind, **fields), src, dst))


@pytest.mark.parametrize(
    ("src", "dst", "host", "why"),
    [
        (NEPTUS, APAD, "127.0.0.1", None),
        (0x4002, APAD, "127.0.0.1", "a console that is not listed"),
        (NEPTUS, APAD, "192.0.2.1", "not listed"),
        (NEPTUS, 0xFFFF, "127.0.0.1", "not addressed to the aPad"),
        (NEPTUS, 0x2A02, "127.0.0.1", "not addressed to the aPad"),
    ],
)
def test_only_a_listed_console_gives_orders(
    wire: Wire, console: socket.socket, codec: Codec, src: int, dst: int, host: str, why: str | None
) -> None:
    console.sendto(codec.pack(codec.make("Abort"), src, dst), wire.address)
    (got,) = received(wire)
    assert isinstance(got.message, imcpy.Abort)
    found = wire.why_not_obeyed(replace(got, sender=(host, got.sender[1])), APAD)
    assert found is why or why in found


def test_another_user_of_the_machine_gives_no_orders_by_a_listed_id(wire: Wire, codec: Codec) -> None:
    """It shares the host with the console, and cannot send from its port: nor by announcing its own as the console's."""
    with local_socket() as local:
        mine = "{}:{}".format(*local.getsockname())
        announced = codec.make("Announce", sys_name="n", sys_type=0, services=f"imc+udp://{mine}/")
        local.sendto(codec.pack(announced, NEPTUS, 0xFFFF), wire.address)
        local.sendto(codec.pack(codec.make("Abort"), NEPTUS, APAD), wire.address)
        heard: list[ReceivedMessage] = []
        while len(heard) < 2:
            heard += received(wire)
    wire.discover(heard[0])
    assert "not listed" in str(wire.why_not_obeyed(heard[1], APAD))


def test_a_listed_console_gives_orders_from_its_other_interfaces_once_it_has_announced_them(
    wire: Wire, console: socket.socket, codec: Codec
) -> None:
    host, port = console.getsockname()
    order = packet(codec, "Abort", NEPTUS)
    elsewhere = ReceivedMessage(order, ("10.0.200.9", port), by_multicast=False)
    services = f"imc+udp://172.17.0.1:{port}/;imc+udp://10.0.200.9:{port}/;imc+udp://10.0.200.10:7001/"
    for src, sender, obeyed in (
        (0x4002, (host, port), False),
        (NEPTUS, ("192.0.2.1", port), False),
        (NEPTUS, (host, 40_000), True),
    ):
        announced = packet(codec, "Announce", src, 0xFFFF, sys_name="n", sys_type=0, services=services)
        wire.discover(ReceivedMessage(announced, sender, True))
        assert (wire.why_not_obeyed(elsewhere, APAD) is None) is obeyed
    assert wire.why_not_obeyed(ReceivedMessage(order, ("10.0.200.10", 7001), False), APAD) is not None


def test_a_console_without_an_id_is_shown_the_run_and_gives_no_orders(
    console: socket.socket, codec: Codec
) -> None:
    wire = Wire(("127.0.0.1", 0), (ImcConsole(console.getsockname()),), multicast=False)
    wire.send(imcpy.Heartbeat())
    assert isinstance(imcpy.Packet.deserialize(console.recv(1000)), imcpy.Heartbeat)
    console.sendto(codec.pack(codec.make("Abort"), NEPTUS, APAD), wire.address)
    (got,) = received(wire)
    assert wire.why_not_obeyed(got, APAD) is not None
    wire.close()


def test_what_is_no_imc_is_dropped_and_counted(wire: Wire, console: socket.socket, codec: Codec) -> None:
    whole, draw = codec.pack(codec.make("Announce", sys_name="x"), NEPTUS, APAD), random.Random(1)
    number = int.from_bytes(whole, "little")
    damaged = [
        (number ^ 1 << (8 * draw.randrange(len(whole)) + draw.randrange(8))).to_bytes(len(whole), "little")
        for _ in range(100)
    ]
    sent = [*(whole[:n] for n in range(len(whole))), *damaged]
    for packet in (*sent, codec.pack(codec.make("Abort"), NEPTUS, APAD)):
        console.sendto(packet, wire.address)
    got: list[ReceivedMessage] = []
    while not got:
        got += received(wire)
    assert [type(it.message) for it in got] == [imcpy.Abort]
    assert wire.dropped == {"a datagram that is no IMC": len(sent)}


def test_a_console_is_written_with_its_id_and_its_address() -> None:
    for written, imc_id in (("0x4001@", NEPTUS), ("16385@", NEPTUS), ("", None)):
        assert ImcConsole.parse(f"{written}127.0.0.1:6001") == ImcConsole(("127.0.0.1", 6001), imc_id)


@pytest.fixture
def group_wire(console: socket.socket) -> Iterator[Wire]:
    try:
        opened = Wire(("127.0.0.1", 0), (ImcConsole(console.getsockname(), NEPTUS),), multicast=True)
    except OSError as error:
        pytest.skip(f"this machine has no multicast on its loopback: {error}")
    yield opened
    opened.close()


def test_by_multicast_consoles_are_found_and_nobody_is_obeyed(
    group_wire: Wire, console: socket.socket, codec: Codec, tmp_path: Path
) -> None:
    with local_socket() as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        for port in ANNOUNCE_PORTS:
            sender.sendto(codec.pack(codec.make("Abort"), NEPTUS, APAD), (GROUP, port))
        got = received(group_wire)[0]
        assert got.by_multicast and group_wire.why_not_obeyed(got, APAD) == "an order by multicast"

        service = "imc+udp://127.0.0.1:7001/;imc+tcp://127.0.0.1:7001/"
        for system, kind in ((0x4002, 0), (0x2A05, 3)):
            message = packet(codec, "Announce", system, 0xFFFF, sys_name="n", sys_type=kind, services=service)
            group_wire.discover(ReceivedMessage(message, sender.getsockname(), by_multicast=True))
        assert group_wire.destinations == [console.getsockname(), ("127.0.0.1", 7001)]
        # Found, and yet not obeyed: it is not listed.
        abort = ReceivedMessage(packet(codec, "Abort", 0x4002), ("127.0.0.1", 7001), False)
        assert group_wire.why_not_obeyed(abort, APAD) is not None
