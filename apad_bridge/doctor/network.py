"""The network between this machine and a ROS master's, in plain sockets and XML-RPC. Every wait ends."""

from __future__ import annotations

import os
import queue
import socket
import threading
import xmlrpc.client
from collections.abc import Callable
from http.client import HTTPConnection, HTTPException
from typing import Any, TypeVar
from urllib.parse import urlsplit

TIMEOUT_S = 2.0
CALLER = f"/musselbed_doctor_{os.getpid()}"
"""A node name of this process's own: a master ends the elder of two nodes of one name."""
T = TypeVar("T")


class Unreachable(Exception):
    """Somebody did not answer, or not as asked; the text says who and how."""


def within(timeout_s: float, work: Callable[[], T]) -> T:
    """What `work` returns or raises; TimeoutError when it takes longer. It is left to itself then, on a daemon thread.

    For what has no time-out of its own, as looking up a name.
    """
    done: queue.SimpleQueue[tuple[T | None, BaseException | None]] = queue.SimpleQueue()

    def run() -> None:
        try:
            done.put((work(), None))
        except BaseException as error:
            done.put((None, error))

    threading.Thread(target=run, daemon=True).start()
    try:
        result, error = done.get(timeout=timeout_s)
    except queue.Empty:
        raise TimeoutError(f"no answer within {timeout_s:g} s") from None
    if error is not None:
        raise error
    return result  # type: ignore[return-value]


def address_of(host: str) -> str:
    """The IPv4 address of a name or address. Unreachable when nobody knows it."""
    try:
        found = within(TIMEOUT_S, lambda: socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM))
    except (OSError, UnicodeError) as error:
        raise Unreachable(f"the name {host!r} cannot be resolved here ({error})") from None
    return str(found[0][4][0])


def host_and_port(uri: str) -> tuple[str, int]:
    """Of http://HOST:PORT/ or rosrpc://HOST:PORT. Unreachable for anything else."""
    try:
        parts = urlsplit(uri)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise Unreachable(f"{uri!r} is no address of the form http://HOST:PORT")
    return host, port


def route_address(address: str) -> str:
    """The address of this machine that packets to `address` leave from. Nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, 9))
        except OSError as error:
            raise Unreachable(f"no route to {address} ({error})") from None
        return str(probe.getsockname()[0])


def connect(uri: str) -> socket.socket:
    """A connection to the port that `uri` names, with a time-out on whatever follows. Unreachable when there is none."""
    host, port = host_and_port(uri)
    address = address_of(host)
    try:
        return socket.create_connection((address, port), timeout=TIMEOUT_S)
    except OSError as error:
        where = host if host == address else f"{host} ({address})"
        raise Unreachable(f"port {port} of {where} does not answer ({error})") from None


def call(uri: str, method: str, *arguments: Any) -> Any:
    """The value of a ROS XML-RPC call: what stands third in its [code, message, value]. Unreachable with the reason."""
    code, message, value = call_whole(uri, method, *arguments)
    if code != 1:
        raise Unreachable(f"{method} at {uri}: {message}")
    return value


def call_whole(uri: str, method: str, *arguments: Any) -> tuple[int, str, Any]:
    connect(uri).close()
    transport = Timed(TIMEOUT_S)

    def ask() -> Any:
        with xmlrpc.client.ServerProxy(uri, transport=transport) as server:
            return getattr(server, method)(CALLER, *arguments)

    try:
        answer = within(TIMEOUT_S, ask)
    except (OSError, HTTPException, xmlrpc.client.Error, ValueError) as error:
        raise Unreachable(f"{method} at {uri}: {error}") from None
    if not isinstance(answer, list) or len(answer) != 3:
        raise Unreachable(f"{method} at {uri}: {answer!r} is no answer of a ROS program")
    return answer[0], str(answer[1]), answer[2]


class Timed(xmlrpc.client.Transport):
    def __init__(self, timeout_s: float) -> None:
        super().__init__()
        self._timeout_s = timeout_s

    def make_connection(self, host: xmlrpc.client._HostType) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = self._timeout_s
        return connection
