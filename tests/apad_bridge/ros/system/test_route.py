"""Ports for programs that need their number before they bind it."""

from __future__ import annotations

import errno
import os
import random
import socket
from pathlib import Path

import pytest

from apad_bridge.ros.system.route import free_port
from apad_bridge.vehicle.link_errors import PeerFailed


def test_no_outgoing_connection_is_given_a_free_port_before_a_node_binds_it() -> None:
    first, last = map(int, Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split())
    assert not any(first <= free_port() <= last for _ in range(100))


def test_a_port_in_use_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    with socket.create_server(("127.0.0.1", port)):
        monkeypatch.setattr(random, "sample", lambda ports, count: [port, *ports[:count]])
        assert free_port() != port


@pytest.mark.parametrize(
    ("number", "error", "words"),
    [(errno.EADDRINUSE, PeerFailed, "all in use"), (errno.EMFILE, OSError, "Too many open files")],
)
def test_only_ports_in_use_are_passed_over(
    monkeypatch: pytest.MonkeyPatch, number: int, error: type[Exception], words: str
) -> None:
    def refuse(address: tuple[str, int]) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(socket, "create_server", refuse)
    with pytest.raises(error, match=words):
        free_port()
