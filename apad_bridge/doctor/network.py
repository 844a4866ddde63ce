"""Calls over the network to a ROS master's machine, by plain sockets and XML-RPC. Every wait ends."""

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

TIMEOUT_S = 5.0
"""A poor Wi-Fi that takes 0.2 s each way may lose two packets in a row: TCP then needs 4 s for a call that arrives."""
CALLER = f"/musselbed_doctor_{os.getpid()}"
"""A node name of this process's own, because a master ends the older of two nodes with one name."""
T = TypeVar("T")


class Unreachable(Exception):
    """A host, master or node did not answer, or gave a wrong answer; the text names it and the reason."""


class ConnectionRefused(Unreachable):
    """The machine is there, and no process listens at that port: the one that did has ended."""


def within(timeout_s: float, work: Callable[[], T]) -> T:
    """Returns or raises the result of `work`; raises TimeoutError if it takes longer and leaves it on a daemon thread.

    It serves calls without a time-out of their own, such as the look-up of a name.
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
    """Returns the IPv4 address of a name or address. Raises Unreachable if the name cannot be resolved."""
    try:
        found = within(TIMEOUT_S, lambda: socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_STREAM))
    except (OSError, UnicodeError) as error:
        raise Unreachable(f"the name {host!r} cannot be resolved here ({error})") from None
    return str(found[0][4][0])


def host_and_port(uri: str) -> tuple[str, int]:
    """Splits http://HOST:PORT/ or rosrpc://HOST:PORT. Raises Unreachable for anything else."""
    try:
        parts = urlsplit(uri)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise Unreachable(f"{uri!r} is no address of the form http://HOST:PORT")
    return host, port


def is_loopback(uri: str) -> bool:
    """True if the URI's host is this machine by its loopback address; False for a name that cannot be resolved."""
    try:
        return address_of(host_and_port(uri)[0]).startswith("127.")
    except Unreachable:
        return False


def address_towards(uri: str) -> str:
    """Returns this machine's source address of packets to the URI's host, without sending any: the kernel has the route.

    Raises Unreachable if there is none.
    """
    address = address_of(host_and_port(uri)[0])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, 9))
        except OSError as error:
            raise Unreachable(f"no route to {address} ({error})") from None
        return str(probe.getsockname()[0])


def connect(uri: str) -> socket.socket:
    """Connects to the port that `uri` names, with a time-out on all that follows.

    Raises Unreachable if it cannot, and Refused where nobody listens.
    """
    host, port = host_and_port(uri)
    address = address_of(host)
    try:
        return socket.create_connection((address, port), timeout=TIMEOUT_S)
    except OSError as error:
        where = host if host == address else f"{host} ({address})"
        kind = ConnectionRefused if isinstance(error, ConnectionRefusedError) else Unreachable
        raise kind(f"port {port} of {where} does not answer ({error})") from None


def call(uri: str, method: str, *arguments: Any) -> Any:
    """Returns the value in the [code, message, value] of a ROS XML-RPC call. Raises Unreachable with the reason."""
    code, message, value = call_for_reply(uri, method, *arguments)
    if code != 1:
        raise Unreachable(f"{method} at {uri}: {message}")
    return value


def call_for_reply(uri: str, method: str, *arguments: Any) -> tuple[int, str, Any]:
    """Returns the [code, message, value] of a ROS XML-RPC call. Raises Unreachable with the reason."""
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
    """Bounds each wait, except with None. An answer that is no XML-RPC raises ResponseError, whatever is wrong with it."""

    def __init__(self, timeout_s: float | None) -> None:
        super().__init__()
        self._timeout_s = timeout_s

    def make_connection(self, host: xmlrpc.client._HostType) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = self._timeout_s
        return connection

    def parse_response(self, response: Any) -> Any:
        try:
            return super().parse_response(response)
        except (OSError, HTTPException, xmlrpc.client.Error):
            raise
        except Exception as error:
            # Whatever the bytes make the parser raise, as ExpatError of XML that is cut short.
            response.close()  # what is unread would keep it open
            raise xmlrpc.client.ResponseError(f"its answer is no XML-RPC: {error}") from error
