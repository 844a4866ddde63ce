"""Calls an aPad's services without waiting for them, and without the master.

rospy asks the master before each call and has no time-out, so a master that died would keep a stop from the vehicle. Here
an address is looked up once, and a connection to each service stays open. A call that is not answered in time ends with
its connection. A stop does not wait behind other calls: those end, too.
"""

from __future__ import annotations

import io
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

import rosgraph
import rospy
from rosgraph.network import ROSHandshakeException, encode_ros_handshake_header, read_ros_handshake_header

from apad_bridge.doctor.network import Unreachable, call, connect
from apad_bridge.ros.system.lost_links import end_when_unacknowledged

PATIENCE_S = 5.0
"""A call waits so long for the one before it, and for its answer."""
STOP_PATIENCE_S = 3.0
_LENGTH = struct.Struct("<I")
_ANSWER = struct.Struct("<BI")
_CLOSED = "the connection ended"


class CallFailed(Exception):
    """The vehicle has not answered, or refused. The text is the reason."""


class _Service:
    """One service: its address, its kept connection, and a lock, because a connection carries one call at a time."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._address = ""
        self._socket: socket.socket | None = None
        self._lock = threading.Lock()

    def look_up(self) -> None:
        """Keeps the address that the master names. Unreachable without one."""
        self._address = str(call(rosgraph.get_master_uri(), "lookupService", self.name))

    @property
    def is_connected(self) -> bool:
        """The kept connection stands, as far as this end can tell."""
        sock = self._socket
        if sock is None:
            return False
        try:
            poll = select.poll()
            poll.register(sock, select.POLLIN)
            # An idle connection has nothing to read but its end.
            return not poll.poll(0) or sock.recv(1, socket.MSG_PEEK) != b""
        except (OSError, ValueError):
            return False

    def cut(self) -> None:
        """Ends the connection, and with it a call that waits for its answer."""
        sock, self._socket = self._socket, None
        if sock is not None:
            with suppress(OSError):  # it has ended already
                sock.shutdown(socket.SHUT_RDWR)
            sock.close()

    def keep_open(self, kind: Any, timeout_s: float) -> None:
        """Opens the connection before it is needed. CallFailed where that cannot be."""
        with self._lock:
            if not self.is_connected:
                self._open(kind, time.monotonic() + timeout_s)

    def call(self, kind: Any, request: Any, timeout_s: float) -> Any:
        """The answer to one call. CallFailed after `timeout_s`, by whatever reason."""
        until_s = time.monotonic() + timeout_s
        if not self._lock.acquire(timeout=timeout_s):
            raise CallFailed("the call before it is not over")
        try:
            was_open = self.is_connected
            try:
                return self._ask(kind, request, until_s)
            except CallFailed as failed:
                # A connection that the vehicle has closed meanwhile, as when its node was started again.
                if not was_open or str(failed) != _CLOSED:
                    raise
                return self._ask(kind, request, until_s)
        finally:
            self._lock.release()

    def _ask(self, kind: Any, request: Any, until_s: float) -> Any:
        sock = self._socket if self.is_connected else self._open(kind, until_s)
        assert sock is not None
        data = io.BytesIO()
        request.serialize(data)
        try:
            sock.settimeout(_left_s(until_s))
            sock.sendall(_LENGTH.pack(len(data.getvalue())) + data.getvalue())
            is_answered, length = _ANSWER.unpack(_read(sock, _ANSWER.size, until_s))
            answer = _read(sock, length, until_s)
        except TimeoutError:
            self.cut()
            raise CallFailed("the vehicle did not answer in time") from None
        except (OSError, ValueError) as error:
            self.cut()
            raise CallFailed(_CLOSED if isinstance(error, ConnectionError) else str(error)) from None
        if not is_answered:
            raise CallFailed(answer.decode(errors="replace"))
        return kind._response_class().deserialize(answer)

    def _open(self, kind: Any, until_s: float) -> socket.socket:
        self.cut()
        try:
            if not self._address:
                self.look_up()
            sock = connect(self._address)
        except Unreachable:
            try:
                self.look_up()  # the node was started again, at another address
                sock = connect(self._address)
            except Unreachable as unreachable:
                raise CallFailed(str(unreachable)) from None
        try:
            sock.settimeout(_left_s(until_s))
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.sendall(
                encode_ros_handshake_header(
                    {
                        "callerid": rospy.get_name(),
                        "service": self.name,
                        "md5sum": kind._md5sum,
                        "type": kind._type,
                        "persistent": "1",
                    }
                )
            )
            header = read_ros_handshake_header(sock, io.BytesIO(), 4096)
        except (OSError, ROSHandshakeException, ValueError) as error:
            sock.close()
            raise CallFailed(f"its server does not take the connection: {error}") from None
        if "error" in header:
            sock.close()
            raise CallFailed(header["error"])
        end_when_unacknowledged(sock)
        self._socket = sock
        return sock


def _left_s(until_s: float) -> float:
    left_s = until_s - time.monotonic()
    if left_s <= 0:
        raise TimeoutError
    return left_s


def _read(sock: socket.socket, size: int, until_s: float) -> bytes:
    data = b""
    while len(data) < size:
        sock.settimeout(_left_s(until_s))
        piece = sock.recv(size - len(data))
        if not piece:
            raise ConnectionResetError
        data += piece
    return data


class ServiceCalls:
    """Calls services in the order in which they are sent, without waiting for the answers.

    A thread of the call runs `answered` with the response, and with the reason if the call was refused or not answered.
    """

    def __init__(self) -> None:
        self._services: dict[str, _Service] = {}
        self._motions: list[_Service] = []
        """The services of the calls under way that are no stops."""
        self._last: threading.Thread | None = None

    def prepare(self, services: dict[str, Any]) -> None:
        """Connects to these services, by name with their definitions, so that a call needs no master any more.

        CallFailed, with the service's name, for one that cannot be reached.
        """
        for name, kind in services.items():
            try:
                self._service(name).keep_open(kind, PATIENCE_S)
            except CallFailed as failed:
                raise CallFailed(f"{name}: {failed}") from None

    def are_connected(self, services: Iterable[str]) -> bool:
        return all(self._service(name).is_connected for name in services)

    def send(
        self,
        service: str,
        kind: Any,
        request: Any,
        answered: Callable[[Any, str | None], None],
        *,
        is_stop: bool = False,
    ) -> None:
        """Calls the service. A stop goes at once, and ends every call that is under way."""
        before = None if is_stop else self._last
        if is_stop:
            for waiting in list(self._motions):
                waiting.cut()
        timeout_s = STOP_PATIENCE_S if is_stop else PATIENCE_S

        def ask() -> None:
            if before is not None:
                before.join(PATIENCE_S)
            response: Any = None
            refused: str | None = None
            called = self._service(service)
            if not is_stop:
                self._motions.append(called)
            try:
                response = called.call(kind, request, timeout_s)
            except CallFailed as failed:
                refused = f"{service}: {failed}"
            finally:
                if not is_stop:
                    self._motions.remove(called)
            answered(response, refused)

        thread = threading.Thread(target=ask, name=f"call of {service}", daemon=True)
        if not is_stop:
            self._last = thread
        thread.start()

    def close(self) -> None:
        for service in self._services.values():
            service.cut()

    def _service(self, name: str) -> _Service:
        resolved: str = rospy.resolve_name(name)
        return self._services.setdefault(resolved, _Service(resolved))
