"""Reads a vehicle's position over two TCP connections, so that a packet lost on one of them makes no silence.

TCP holds back what follows a lost packet until that packet has arrived: four losses in a row make a silence of 3 s on one
connection, though every later message is here. rospy opens one connection to a publisher; this module opens the second.
"""

from __future__ import annotations

import io
import math
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import Any

import rospy
from rosgraph.network import (
    ROSHandshakeException,
    encode_ros_handshake_header,
    is_local_address,
)

from apad_bridge.doctor.network import Unreachable, call, connect
from apad_bridge.ros.system.handshakes import read_handshake
from apad_bridge.ros.system.lost_links import notice_end

_AGAIN_S = 5.0
"""A second connection that was refused, or ended, is tried again after this time."""
_MOST_UNPAIRED = 600
"""A minute of positions at 10 Hz that one connection brought and the other has not."""
_LONGEST = 65_536
"""Bytes of a position: one that is longer is none."""
_SUFFIX = "_again"
"""A rospy publisher ends an older connection of the same caller."""
_SILENT_S = 1.0
"""Ten positions: a connection that was ahead and brings nothing for so long leaves the lead to the other."""
_LENGTH = struct.Struct("<I")


class SecondConnections:
    """One further connection to each publisher of a topic on another machine. On this machine no packet is lost.

    `receive` gets each message as rospy.AnyMsg with its connection's header, in a thread of the connection.
    """

    def __init__(self, receive: Callable[[Any], None]) -> None:
        self._receive = receive
        self._open: dict[str, socket.socket | None] = {}
        """By the publisher's address; None while it connects."""
        self._not_before_s: dict[str, float] = {}
        self._lock = threading.Lock()
        self._is_closed = False

    def follow(self, subscriber: rospy.Subscriber) -> None:
        """Opens what lacks beside the connections of `subscriber`, without waiting."""
        implementation = subscriber.impl
        for first in list(implementation.connections) if implementation is not None else []:
            if first.transport_type == "TCPROS":  # and not within one process
                self._begin(first, subscriber.resolved_name)

    def close(self) -> None:
        with self._lock:
            self._is_closed = True
            sockets = list(self._open.values())
        for sock in sockets:
            if sock is not None:
                with suppress(OSError):  # it has ended already
                    sock.shutdown(socket.SHUT_RDWR)

    def _begin(self, first: Any, topic: str) -> None:
        publisher, address = first.endpoint_id, first.dest_address
        with self._lock:
            waits = time.monotonic() < self._not_before_s.get(publisher, 0.0)
            if self._is_closed or waits or publisher in self._open or address is None:
                return
            self._open[publisher] = None
        threading.Thread(
            target=self._run,
            args=(publisher, address[0], topic),
            name=f"second connection to {topic}",
            daemon=True,
        ).start()

    def _run(self, publisher: str, host: str, topic: str) -> None:
        again_s = time.monotonic() + _AGAIN_S
        try:
            if is_local_address(host):
                again_s = math.inf
            else:
                self._read(publisher, topic)
        except (OSError, Unreachable, ROSHandshakeException):
            pass  # the first connection goes on alone
        finally:
            with self._lock:
                self._not_before_s[publisher] = again_s
                del self._open[publisher]

    def _read(self, publisher: str, topic: str) -> None:
        """Connects, and receives until the connection ends."""
        offered = call(publisher, "requestTopic", topic, [["TCPROS"]])
        if not isinstance(offered, list) or len(offered) != 3:
            raise Unreachable(f"{publisher} offers no TCPROS")
        with connect(f"http://{offered[1]}:{offered[2]}") as sock:
            header = {
                "topic": topic,
                "message_definition": rospy.AnyMsg._full_text,
                "tcp_nodelay": "1",
                "md5sum": rospy.AnyMsg._md5sum,
                "type": rospy.AnyMsg._type,
                "callerid": f"{rospy.get_name()}{_SUFFIX}",
            }
            sock.sendall(encode_ros_handshake_header(header))
            begun = io.BytesIO()
            header = read_handshake(sock, begun)
            with self._lock:
                self._open[publisher] = sock
                if self._is_closed:
                    return
            # A vehicle may publish seldom. The end of its machine shows by the keep-alive.
            sock.settimeout(None)
            notice_end(sock)
            # What came behind the header belongs to the first message.
            stream = io.BufferedReader(_Continued(begun.getvalue()[: begun.tell()], sock))
            while len(size := stream.read(_LENGTH.size)) == _LENGTH.size:
                (length,) = _LENGTH.unpack(size)
                if length > _LONGEST or len(data := stream.read(length)) < length:
                    return
                raw = rospy.AnyMsg()
                raw.deserialize(data)
                raw._connection_header = header
                self._receive(raw)


class _Continued(io.RawIOBase):
    """The bytes of `begun`, and then those of the socket."""

    def __init__(self, begun: bytes, sock: socket.socket) -> None:
        self._begun, self._socket = begun, sock

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        if not self._begun:
            return self._socket.recv_into(buffer)
        count = min(len(buffer), len(self._begun))
        buffer[:count], self._begun = self._begun[:count], self._begun[count:]
        return count


class FirstArrivals:
    """Tells which messages of one publisher are new: each arrives over two connections, and counts when it comes first.

    Each connection keeps the publisher's order. A connection that begins while the other stands still may be ahead of
    messages under way there. So while one leads, the other counts again only from a message that both have brought, or
    when the leader falls silent.
    """

    def __init__(self) -> None:
        self._unpaired: tuple[deque[Hashable], deque[Hashable]] = (deque(), deque())
        """By connection, what came over it and not yet over the other. That of the one that does not lead is empty."""
        self._passed_over: list[Hashable] = [None, None]
        """By connection, the newest message that came over it and did not count."""
        self._came_s = [-math.inf, -math.inf]
        """By connection, when its newest message came."""

    def is_new(self, connection: int, message: Hashable, now_s: float) -> bool:
        """False for a message that came over the other connection before, or is older than one that did.

        `connection` is 0 or 1, `now_s` the time of arrival by a clock that never goes back.
        """
        ours, others = self._unpaired[connection], self._unpaired[1 - connection]
        self._came_s[connection] = now_s
        if message in others:
            while others.popleft() != message:
                pass
            return False
        if others and now_s - self._came_s[1 - connection] < _SILENT_S:
            self._passed_over[connection] = message
            return False
        others.clear()
        if message == self._passed_over[1 - connection]:
            ours.clear()
            return True
        ours.append(message)
        if len(ours) > _MOST_UNPAIRED:
            ours.popleft()
        return True
