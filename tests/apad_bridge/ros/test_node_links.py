"""Datagrams of nodes on loopback, where two sockets stand for a node and a stranger."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing

import pytest

from apad_bridge.ros.node_links import FromNode, NotCarried, SentToNode, WifiLink

NODE, PATIENCE_S = 7, 10.0


@pytest.fixture
def sockets() -> Iterator[list[socket.socket]]:
    with ExitStack() as stack:
        made = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(3)]
        for it in made:
            it.bind(("127.0.0.1", 0))
            it.settimeout(PATIENCE_S)
        yield made


def test_a_stranger_with_a_nodes_id_gets_its_commands_only_after_a_silence(
    sockets: list[socket.socket],
) -> None:
    free, node, stranger = sockets
    port = free.getsockname()[1]
    free.close()
    steps: list[tuple[socket.socket, int, bool, socket.socket]] = [
        # Who sends with the node's id, when, if that is told as a second address, and who is then told.
        (node, 1_000, False, node),
        (stranger, 2_000, True, node),
        (node, 20_000, False, node),
        (stranger, 49_999, True, node),
        # The stranger's own packets prolong nothing: the node has been silent for 30 s.
        (stranger, 50_000, False, stranger),
    ]
    with closing(WifiLink(f"udp:{port}")) as link:
        for sender, at_ms, is_told, whom in steps:
            sender.sendto(b"a packet", ("127.0.0.1", port))
            link.wait(PATIENCE_S)
            (packet,) = link.poll(at_ms)
            assert isinstance(packet, FromNode) and packet.data == b"a packet"
            reported = link.found(NODE, packet.sender)
            assert ["second address" in it.reason for it in reported if isinstance(it, NotCarried)] == [
                True
            ] * is_told
            assert link.send(NODE, b"%d" % at_ms, 0) == [SentToNode()]
            assert whom.recv(100) == b"%d" % at_ms
