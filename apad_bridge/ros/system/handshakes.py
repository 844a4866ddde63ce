"""Handshakes of incoming TCPROS connections, bounded in time: a silent connection makes nobody else wait.

rospy reads each handshake in the thread that accepts connections, without a time-out, so one connection that says nothing
keeps out all later ones. Here a connection comes to rospy only when its whole handshake has arrived, and is closed when
that takes longer than `HANDSHAKE_S`, or when too many later ones wait.

A process that can open no further file cannot accept: rospy's thread would end with that error and leave the node deaf.
Here it tries again. `deaf` asks our own node for a handshake, and so notices whatever else keeps it from answering.
"""

from __future__ import annotations

import io
import select
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import rospy
from rosgraph.network import ROSHandshakeException, read_ros_handshake_header, write_ros_handshake_header
from rosgraph.xmlrpc import SilenceableXMLRPCRequestHandler
from rospy.impl import tcpros_base
from rospy.impl.tcpros_base import init_tcpros_server

from agents.hosting.descriptors import SHORT_OF_FILES
from apad_bridge.events.graph_events import GraphDeaf, GraphHears
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.system.lost_links import end_when_unacknowledged

HANDSHAKE_S = 2.0
"""A node sends its handshake with the connection: within milliseconds, or some hundreds over a bad Wi-Fi."""
LARGEST_BYTES = 32_768
"""The longest handshake; it carries a message's definition, of some kilobytes at most. It fits into the socket's buffer."""
_LENGTH = struct.Struct("<I")
_MOST_WAITING = 128
"""Connections whose handshake is awaited; with one more, the oldest is closed."""
_AGAIN_S = 0.1
"""A process that can open no file waits so long before it tries to accept again."""
_XMLRPC_S = 10.0
"""A node that keeps a connection for its next call connects again after such a time without one."""
_ANSWER_S = 3.0
_PERIOD_S = 2.0
_FAILED = 2
"""So many looks in a row without an answer: one alone may be a busy machine."""

Handler = Callable[[socket.socket, Any], None]


def bound_handshakes() -> None:
    """Bounds the handshakes of this process's node; to be called before `rospy.init_node`."""
    server = init_tcpros_server()
    server._tcp_server_callback = Handshakes(server._tcp_server_callback).take
    tcpros_base.TCPServer._create_server_sock = _create_listener
    # A thread serves each connection of the other protocol, and would wait for a silent one for ever.
    SilenceableXMLRPCRequestHandler.timeout = _XMLRPC_S


class Listener(socket.socket):
    """A listening socket whose `accept` outlasts a shortage of descriptors."""

    def accept(self) -> tuple[socket.socket, Any]:
        """TimeoutError, after which rospy tries again, where the process can open no file."""
        try:
            return super().accept()
        except OSError as error:
            if error.errno not in SHORT_OF_FILES:
                raise
            time.sleep(_AGAIN_S)
            raise TimeoutError from error


_create = tcpros_base.TCPServer._create_server_sock


def _create_listener(server: Any) -> Listener:
    return Listener(fileno=_create(server).detach())


def read_handshake(sock: socket.socket, begun: io.BytesIO) -> dict[str, str]:
    """The header that the other side sends; what came behind it is left in `begun`.

    Raises ROSHandshakeException for bytes that are none, and OSError.
    """
    try:
        header: dict[str, str] = read_ros_handshake_header(sock, begun, 4096)
    except (struct.error, UnicodeDecodeError) as error:  # a length that is cut short, or no text
        raise ROSHandshakeException(f"a handshake that cannot be read: {error}") from error
    return header


def deaf(answer_s: float = _ANSWER_S) -> str | None:
    """Asks our own node for a handshake, as any other node would; returns why it gives none, and None where it does."""
    address = tcpros_base.get_tcpros_server_address()
    header = {
        "probe": "1",
        "md5sum": "*",
        "callerid": rospy.get_name(),
        "service": rospy.resolve_name("~get_loggers"),
    }
    try:
        with socket.create_connection(address, answer_s) as link:
            write_ros_handshake_header(link, header)
            return None if read_handshake(link, io.BytesIO()) else "an empty answer"
    except OSError as error:
        return error.strerror or str(error)
    except ROSHandshakeException:
        return "the connection ended without an answer"


class HearingWatch:
    """Looks every `period_s` whether our node answers others, in a thread that ends with `close`."""

    def __init__(self, period_s: float = _PERIOD_S, look: Callable[[], str | None] = deaf) -> None:
        """`look` returns why the node answers nobody, None where it does."""
        self._period_s = period_s
        self._look = look
        self._events: Inbox[GraphHears | GraphDeaf] = Inbox()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watch of the node", daemon=True)
        self._thread.start()

    def take(self) -> list[GraphHears | GraphDeaf]:
        """The events since the last call; the second kind when the first is over."""
        return self._events.take()

    def close(self) -> None:
        self._ended.set()
        self._thread.join(2 * _ANSWER_S)

    def _watch(self) -> None:
        failed, since_s = 0, 0.0
        while not self._ended.wait(self._period_s) and not rospy.is_shutdown():
            begun_s, why = time.monotonic(), self._look()
            if why is None:
                if failed >= _FAILED:
                    self._events.put(GraphHears(round(begun_s - since_s, 1)), always=True)
                failed = 0
                continue
            since_s = since_s if failed else begun_s
            failed += 1
            if failed == _FAILED:
                self._events.put(GraphDeaf(why), always=True)


@dataclass(slots=True)
class _Waiting:
    sock: socket.socket
    address: Any
    until_s: float


class Handshakes:
    """Hands each connection to `handler` when its handshake is there, one after another, in a thread of its own."""

    def __init__(
        self, handler: Handler, handshake_s: float = HANDSHAKE_S, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._handler = handler
        self._handshake_s = handshake_s
        self._clock = clock
        self._poll = select.epoll()
        self._lock = threading.Lock()
        self._waiting: dict[int, _Waiting] = {}
        self._thread = threading.Thread(target=self._run, name="handshakes", daemon=True)
        self._thread.start()

    def take(self, sock: socket.socket, address: Any) -> None:
        """Takes a new connection; for rospy's accepting thread."""
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, _LENGTH.size)
        with self._lock:
            if len(self._waiting) >= _MOST_WAITING:
                oldest = next(iter(self._waiting))
                # The other thread may be looking at it, and closes it. As the newest it is not met again meanwhile.
                self._waiting[oldest] = self._waiting.pop(oldest)
                with suppress(OSError):  # it has ended by itself
                    self._waiting[oldest].sock.shutdown(socket.SHUT_RDWR)
            self._waiting[sock.fileno()] = _Waiting(sock, address, self._clock() + self._handshake_s)
            self._poll.register(sock, select.EPOLLIN)

    def _run(self) -> None:
        while True:
            # A connection may come at any time during the wait, which is why it is short.
            for descriptor, _ in self._poll.poll(self._handshake_s / 4):
                self._look(descriptor)
            now_s = self._clock()
            with self._lock:
                overdue = [number for number, it in self._waiting.items() if it.until_s <= now_s]
            for descriptor in overdue:
                self._forget(descriptor).sock.close()

    def _look(self, descriptor: int) -> None:
        waiting = self._waiting[descriptor]
        try:
            head = waiting.sock.recv(_LENGTH.size, socket.MSG_PEEK | socket.MSG_DONTWAIT)
            needed = _LENGTH.size + _LENGTH.unpack(head)[0]
            if needed > LARGEST_BYTES:
                raise ValueError(f"a handshake of {needed} bytes")
            here = len(waiting.sock.recv(needed, socket.MSG_PEEK | socket.MSG_DONTWAIT))
            if here < needed:
                # Without this a part of a handshake would wake us again and again.
                waiting.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, needed)
                return
        except (OSError, ValueError, struct.error):  # it ended, or is no handshake
            self._forget(descriptor).sock.close()
            return
        self._forget(descriptor)
        waiting.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVLOWAT, 1)
        end_when_unacknowledged(waiting.sock)
        self._handler(waiting.sock, waiting.address)

    def _forget(self, descriptor: int) -> _Waiting:
        with self._lock:
            self._poll.unregister(descriptor)
            return self._waiting.pop(descriptor)
