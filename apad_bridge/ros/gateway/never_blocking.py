"""Publishers that never wait for a subscriber: a stalled one loses its own messages, then its connection.

rospy offers two ways. With a queue every connection has a thread: a reader of a thousand aMussels' topics makes two
thousand threads, which reach 11 000 to 12 000 messages a second at most. Without a queue a write waits for the slowest
reader. Here a write goes as far as the socket takes it; with a full socket, the message is left out for that reader and
counted.
"""

from __future__ import annotations

import socket
import time
import warnings
from collections import Counter
from collections.abc import Callable
from typing import Any

import rospy
from rospy.exceptions import TransportTerminated

STALLED_S = 0.8
"""A reader whose socket took nothing for so long is disconnected: within a second, at ten messages a second. One of roscpp
connects again when it reads again, one of rospy when the master names us again."""
_SEND_BUFFER_BYTES = 8192
"""Requested from the kernel, which doubles it: some 10 s of an aMussel's positions, which a pausing reader does not lose;
the reader's own buffer comes on top. A larger one would only delay the disconnection of a stalled reader."""


class Stalls:
    """Counts missed messages and disconnections by the reader's node. Only the publishing thread writes it."""

    def __init__(self) -> None:
        self.left_out: Counter[str] = Counter()
        self.disconnected: Counter[str] = Counter()
        self.longest_s = 0.0
        """The longest time from the first message left out to the disconnection."""


class NeverBlocking:
    """Wraps a publisher's TCPROS connection, as rospy's own QueuedConnection does, and behaves like one."""

    def __init__(self, connection: Any, stalls: Stalls, now_s: Callable[[], float] = time.monotonic) -> None:
        self._connection = connection
        self._stalls = stalls
        self._now_s = now_s
        self._rest = b""
        """The rest of a message that the socket took in part: the stream breaks if it is not sent before the next."""
        self._stuck_since_s: float | None = None
        connection.socket.setblocking(False)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._connection, name)

    def write_data(self, data: bytes) -> bool:
        """Sends the whole message, at once or in parts, or nothing of it. TransportTerminated when the connection ended."""
        if self._rest:
            self._rest = self._send(self._rest)
        if not self._rest:
            rest = self._send(data)
            if len(rest) < len(data):
                self._rest = rest
                self._stuck_since_s = None
                return True
        now_s = self._now_s()
        self._stalls.left_out[self._connection.endpoint_id] += 1
        if self._stuck_since_s is None:
            self._stuck_since_s = now_s
        elif now_s - self._stuck_since_s >= STALLED_S:
            self._stalls.disconnected[self._connection.endpoint_id] += 1
            self._stalls.longest_s = max(self._stalls.longest_s, now_s - self._stuck_since_s)
            raise TransportTerminated(f"nothing was read for {STALLED_S} s")
        return True

    def _send(self, data: bytes) -> bytes:
        """Returns the part that the socket did not take."""
        sock = self._connection.socket
        if self._connection.done or sock is None:
            raise TransportTerminated("connection closed")
        try:
            sent = sock.send(data)
        except BlockingIOError:
            return data
        except OSError as error:
            raise TransportTerminated(str(error)) from error
        if sent == len(data):
            self._connection.stat_num_msg += 1
        self._connection.stat_bytes += sent
        self._stuck_since_s = None
        return data[sent:]


def never_blocking_publisher(
    topic: str, kind: Any, stalls: Stalls, prepare: Callable[[socket.socket], None] = lambda sock: None
) -> rospy.Publisher:
    """A publisher of `kind` whose connections are NeverBlocking, each after `prepare`. Only one thread may use it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)  # rospy warns of a publisher without a queue
        publisher = rospy.Publisher(topic, kind)
    impl = publisher.impl
    plain = type(impl).add_connection

    def wrapped(connection: Any) -> NeverBlocking:
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        prepare(connection.socket)
        return NeverBlocking(connection, stalls)

    def add_connection(connection: Any) -> bool:
        added: bool = plain(impl, wrapped(connection))
        return added

    impl.add_connection = add_connection
    with impl.c_lock:  # readers that were faster than this line
        impl.connections = [it if isinstance(it, NeverBlocking) else wrapped(it) for it in impl.connections]
    return publisher
