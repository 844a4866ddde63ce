"""Asks a live publisher or service for its definition: TCPROS as far as the first header and message, past the master."""

from __future__ import annotations

import contextlib
import io
import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass

from rosgraph.network import ROSHandshakeException, encode_ros_handshake_header

from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.live_apad import NotAnnounced
from apad_bridge.doctor.network import CALLER, TIMEOUT_S, Unreachable, call, connect
from apad_bridge.ros.system.handshakes import read_handshake

_LENGTH = struct.Struct("<I")
_HEADER = struct.Struct("<III")
"""The begin of every message with a std_msgs/Header: sequence, seconds, nanoseconds."""


def topic_md5(graph: Graph, topic: str) -> str:
    """The md5 that the first living publisher of `topic` announces. NotAnnounced after a time-out."""
    with _errors_as_unanswered(), _subscribed(graph, topic) as (_, _, header):
        return _md5_in(header)


@dataclass(frozen=True, slots=True)
class Spoken:
    """A publisher's announcement: its type, the md5, and the definition with those of all types in it."""

    kind: str
    md5: str
    text: str


def topic_definition(graph: Graph, topic: str) -> Spoken:
    """The announcement of the first living publisher of `topic`. NotAnnounced after a time-out."""
    with _errors_as_unanswered(), _subscribed(graph, topic) as (_, _, header):
        return _spoken(header)


def service_md5(graph: Graph, service: str) -> str:
    """The md5 that the server of `service` announces to a probe, which it does not take for a call."""
    service = graph.name_there(service)
    with _errors_as_unanswered(), connect(str(call(graph.uri, "lookupService", service))) as connection:
        request = {"callerid": CALLER, "service": service, "md5sum": "*", "probe": "1"}
        return _md5_in(_handshake(connection, request, io.BytesIO()))


def next_messages(graph: Graph, topic: str, count: int, timeout_s: float) -> list[bytes]:
    """The next `count` messages of the first living publisher, serialised; the first may be a latched one.

    NotAnnounced if they do not come within `timeout_s`.
    """
    messages = []
    with _errors_as_unanswered(), _subscribed(graph, topic) as (connection, rest, _):
        stream = _Stream(connection, rest, time.monotonic() + timeout_s)
        for _ in range(count):
            messages.append(stream.read(*_LENGTH.unpack(stream.read(_LENGTH.size))))
    return messages


def messages_within(graph: Graph, topic: str, seconds: float) -> tuple[Spoken, list[tuple[float, bytes]]]:
    """All that the first living publisher sends within `seconds`, as (time.monotonic, serialised), and its definition.

    NotAnnounced if it cannot be subscribed to; a silent one sends nothing.
    """
    messages: list[tuple[float, bytes]] = []
    with _errors_as_unanswered(), _subscribed(graph, topic) as (connection, rest, header):
        spoken = _spoken(header)
        stream = _Stream(connection, rest, time.monotonic() + seconds)
        while True:
            try:
                data = stream.read(*_LENGTH.unpack(stream.read(_LENGTH.size)))
            except NotAnnounced:
                return spoken, messages
            messages.append((time.monotonic(), data))


def call_without_words(graph: Graph, service: str, md5: str) -> bytes:
    """Calls a service whose request is empty; its serialised answer. NotAnnounced if it refuses, or falls silent."""
    service = graph.name_there(service)
    with _errors_as_unanswered(), connect(str(call(graph.uri, "lookupService", service))) as connection:
        rest = io.BytesIO()
        _md5_in(_handshake(connection, {"callerid": CALLER, "service": service, "md5sum": md5}, rest))
        connection.sendall(_LENGTH.pack(0))
        stream = _Stream(connection, rest, time.monotonic() + TIMEOUT_S)
        is_answered = stream.read(1) == b"\x01"
        answer = stream.read(*_LENGTH.unpack(stream.read(_LENGTH.size)))
    if not is_answered:
        raise NotAnnounced(answer.decode(errors="replace"))
    return answer


def stamp_offset_s(graph: Graph, topic: str, count: int, timeout_s: float) -> list[float]:
    """The next stamps of `topic` minus this machine's clock. NotAnnounced if none comes, or it has no stamp."""
    offsets_s: list[float] = []
    with _errors_as_unanswered(), _subscribed(graph, topic) as (connection, rest, _):
        stream = _Stream(connection, rest, time.monotonic() + timeout_s)
        while len(offsets_s) < count:
            try:
                message = stream.read(*_LENGTH.unpack(stream.read(_LENGTH.size)))
            except NotAnnounced:
                if offsets_s:
                    break
                raise
            now_s = time.time()
            if len(message) < _HEADER.size:
                raise NotAnnounced("its messages are not stamped")
            _, seconds, nanoseconds = _HEADER.unpack_from(message)
            if seconds == 0:
                raise NotAnnounced("its messages are not stamped")
            offsets_s.append(float(seconds + nanoseconds / 1e9 - now_s))
    return offsets_s


class _Stream:
    """Reads whole pieces of a connection until a time of `time.monotonic`."""

    def __init__(self, connection: socket.socket, rest: io.BytesIO, until_s: float) -> None:
        self._connection = connection
        self._data = rest.getvalue()
        self._until_s = until_s

    def read(self, size: int) -> bytes:
        while len(self._data) < size:
            if (left_s := self._until_s - time.monotonic()) <= 0:
                raise NotAnnounced("no message came in time")
            self._connection.settimeout(left_s)
            try:
                piece = self._connection.recv(65_536)
            except TimeoutError:
                raise NotAnnounced("no message came in time") from None
            if not piece:
                raise NotAnnounced("the connection ended before a message came")
            self._data += piece
        read, self._data = self._data[:size], self._data[size:]
        return read


@contextlib.contextmanager
def _errors_as_unanswered() -> Iterator[None]:
    try:
        yield
    except (Unreachable, ROSHandshakeException, OSError) as error:
        raise NotAnnounced(str(error)) from None


def _spoken(header: dict[str, str]) -> Spoken:
    return Spoken(header.get("type", "*"), _md5_in(header), header.get("message_definition", ""))


def _md5_in(header: dict[str, str]) -> str:
    if "md5sum" not in header:
        raise NotAnnounced(header.get("error", "its answer has no md5sum"))
    return header["md5sum"]


@contextlib.contextmanager
def _subscribed(graph: Graph, topic: str) -> Iterator[tuple[socket.socket, io.BytesIO, dict[str, str]]]:
    """A short subscription without the master: the connection, the bytes after the header, the header."""
    with connect(_publisher_of(graph, topic)) as connection:
        topic = graph.name_there(topic)
        rest = io.BytesIO()
        request = {"callerid": CALLER, "topic": topic, "md5sum": "*", "type": "*", "tcp_nodelay": "1"}
        yield connection, rest, _handshake(connection, request, rest)


def _publisher_of(graph: Graph, topic: str) -> str:
    """The address of the first publisher that lives and offers the topic: the master keeps the dead ones, too."""
    why_not = "nobody publishes it"
    for node in graph.living_publishers(topic):
        try:
            api = str(call(graph.uri, "lookupNode", node))
            answer = call(api, "requestTopic", graph.name_there(topic), [["TCPROS"]])
        except Unreachable as error:
            why_not = str(error)
            continue
        if isinstance(answer, list) and len(answer) == 3:
            return f"rosrpc://{answer[1]}:{answer[2]}"
        why_not = f"{node} offers no TCPROS"
    raise NotAnnounced(why_not)


def _handshake(connection: socket.socket, request: dict[str, str], rest: io.BytesIO) -> dict[str, str]:
    connection.sendall(encode_ros_handshake_header(request))
    return read_handshake(connection, rest)
