"""Ports for programs that need their number before they bind it."""

from __future__ import annotations

import errno
import random
import socket
from pathlib import Path

import pytest

from apad_bridge.ros.system.route import free_port
from apad_bridge.vehicle.errors import PeerFailed


def test_no_outgoing_connection_is_given_a_free_port_before_a_node_binds_it() -> None:
    first, last = map(int, Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split())
    assert not any(first <= free_port() <= last for _ in range(100))


def test_a_port_in_use_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    with socket.create_server(("127.0.0.1", port)):
        monkeypatch.setattr(random, "sample", lambda ports, count: [port, *ports[:count]])
        assert free_port() != port


def test_with_every_port_in_use_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def none_is_free(address: tuple[str, int]) -> None:
        raise OSError(errno.EADDRINUSE, "Address already in use")

    monkeypatch.setattr(socket, "create_server", none_is_free)
    with pytest.raises(PeerFailed, match="all in use"):
        free_port()


def test_too_few_descriptors_are_no_port_in_use(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_descriptor(address: tuple[str, int]) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(socket, "create_server", no_descriptor)
    with pytest.raises(OSError, match="Too many open files"):
        free_port()
