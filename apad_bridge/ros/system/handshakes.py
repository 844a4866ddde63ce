"""Handshakes of incoming TCPROS connections, bounded in time: a silent connection makes nobody else wait.

rospy reads each handshake in the thread that accepts connections, without a time-out, so one connection that says nothing
keeps out all later ones. Here a connection comes to rospy only when its whole handshake has arrived, and is closed when
that takes longer than `HANDSHAKE_S`.
"""

from __future__ import annotations

import select
import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rospy.impl.tcpros_base import init_tcpros_server

from apad_bridge.ros.system.lost_links import end_when_unacknowledged

HANDSHAKE_S = 2.0
"""A node sends its handshake with the connection: within milliseconds, or some hundreds over a bad Wi-Fi."""
LARGEST_BYTES = 32_768
"""The longest handshake; it carries a message's definition, of some kilobytes at most. It fits into the socket's buffer."""
_LENGTH = struct.Struct("<I")

Handler = Callable[[socket.socket, Any], None]


def bound_handshakes() -> None:
    """Bounds the handshakes of this process's node; to be called before `rospy.init_node`."""
    server = init_tcpros_server()
    server._tcp_server_callback = Handshakes(server._tcp_server_callback).take


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
            self._waiting[sock.fileno()] = _Waiting(sock, address, self._clock() + self._handshake_s)
            self._poll.register(sock, select.EPOLLIN)

    def _run(self) -> None:
        while True:
            # A connection may come at any time during the wait, which is why it is short.
            ready = self._poll.poll(self._handshake_s / 4)
            for descriptor, _ in ready:
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
