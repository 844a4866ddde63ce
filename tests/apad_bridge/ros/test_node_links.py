"""Datagrams of nodes on loopback, where two sockets stand for a node and a stranger."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing

import pytest

from apad_bridge.ros.node_links import FromNode, LinkResult, NotCarried, SentToNode, WifiLink

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

    def heard(sender: socket.socket, at_ms: int) -> list[LinkResult]:
        sender.sendto(b"a packet", ("127.0.0.1", port))
        link.wait(PATIENCE_S)
        (packet,) = link.poll(at_ms)
        assert isinstance(packet, FromNode) and packet.data == b"a packet"
        return link.found(NODE, packet.sender)

    def told(words: bytes, whom: socket.socket) -> None:
        assert link.send(NODE, words, 0) == [SentToNode()]
        assert whom.recv(100) == words

    with closing(WifiLink(f"udp:{port}")) as link:
        assert heard(node, 1_000) == []
        (reported,) = heard(stranger, 2_000)
        assert isinstance(reported, NotCarried) and "second address" in reported.reason
        told(b"one", node)
        assert heard(node, 20_000) == [] and heard(stranger, 49_999) != []
        told(b"two", node)
        # The stranger's own packets prolong nothing: the node has been silent for 30 s.
        assert heard(stranger, 50_000) == []
        told(b"three", stranger)
