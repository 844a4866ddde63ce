"""Asks a live publisher or service for its definition: TCPROS as far as the first header and message, past the master."""

from __future__ import annotations

import contextlib
import io
import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass

from rosgraph.network import ROSHandshakeException, encode_ros_handshake_header, read_ros_handshake_header

from apad_bridge.doctor.graph import Graph
from apad_bridge.doctor.network import CALLER, TIMEOUT_S, Unreachable, call, connect

_HEADER = struct.Struct("<III")
"""The begin of every message with a std_msgs/Header: sequence, seconds, nanoseconds."""


class NotAnnounced(Exception):
    """The node gave no answer. The text is the reason."""


def topic_md5(graph: Graph, topic: str) -> str:
    """The md5 that the first publisher of `topic` announces. NotAnnounced after a time-out."""
    with _errors_as_not_told(), _subscribed(graph, topic) as (_, _, header):
        return _md5_in(header)


@dataclass(frozen=True, slots=True)
class Spoken:
    """A publisher's announcement: its type, the md5, and the definition with those of all types in it."""

    kind: str
    md5: str
    text: str


def topic_definition(graph: Graph, topic: str) -> Spoken:
    """The announcement of the first publisher of `topic`. NotAnnounced after a time-out."""
    with _errors_as_not_told(), _subscribed(graph, topic) as (_, _, header):
        return Spoken(header.get("type", "*"), _md5_in(header), header.get("message_definition", ""))


def service_md5(graph: Graph, service: str) -> str:
    """The md5 that the server of `service` announces to a probe, which it does not take for a call."""
    with _errors_as_not_told(), connect(str(call(graph.uri, "lookupService", service))) as connection:
        request = {"callerid": CALLER, "service": service, "md5sum": "*", "probe": "1"}
        return _md5_in(_handshake(connection, request, io.BytesIO()))


def stamp_offset_s(graph: Graph, topic: str) -> float:
    """The next stamp of `topic` minus this machine's clock. NotAnnounced if no message comes, or it has no stamp."""
    with _errors_as_not_told(), _subscribed(graph, topic) as (connection, rest, _):
        data = rest.getvalue()
        until_s = time.monotonic() + TIMEOUT_S
        while len(data) < 4 + _HEADER.size:
            connection.settimeout(max(0.001, until_s - time.monotonic()))
            piece = connection.recv(4096)
            if not piece:
                raise NotAnnounced("the connection ended before a message came")
            data += piece
        now_s = time.time()
        _, seconds, nanoseconds = _HEADER.unpack_from(data, 4)
    if seconds == 0:
        raise NotAnnounced("its messages are not stamped")
    return float(seconds + nanoseconds / 1e9 - now_s)


@contextlib.contextmanager
def _errors_as_not_told() -> Iterator[None]:
    try:
        yield
    except (Unreachable, ROSHandshakeException, OSError) as error:
        raise NotAnnounced(str(error)) from None


def _md5_in(header: dict[str, str]) -> str:
    if "md5sum" not in header:
        raise NotAnnounced(header.get("error", "its answer has no md5sum"))
    return header["md5sum"]


@contextlib.contextmanager
def _subscribed(graph: Graph, topic: str) -> Iterator[tuple[socket.socket, io.BytesIO, dict[str, str]]]:
    """A short subscription without the master: the connection, the bytes after the header, the header."""
    nodes = graph.publishers.get(topic)
    if not nodes:
        raise NotAnnounced("nobody publishes it")
    answer = call(str(call(graph.uri, "lookupNode", nodes[0])), "requestTopic", topic, [["TCPROS"]])
    if not isinstance(answer, list) or len(answer) != 3:
        raise NotAnnounced(f"{nodes[0]} offers no TCPROS")
    with connect(f"rosrpc://{answer[1]}:{answer[2]}") as connection:
        rest = io.BytesIO()
        request = {"callerid": CALLER, "topic": topic, "md5sum": "*", "type": "*", "tcp_nodelay": "1"}
        header = _handshake(connection, request, rest)
        yield connection, rest, header


def _handshake(connection: socket.socket, request: dict[str, str], rest: io.BytesIO) -> dict[str, str]:
    connection.sendall(encode_ros_handshake_header(request))
    header: dict[str, str] = read_ros_handshake_header(connection, rest, 4096)
    return header
