"""Opens connections to an aPad's services, and calls a service by one.

rospy asks the master before each call and has no time-out, so a master that died would keep a stop from the vehicle. Here
an address is looked up once, and a connection stays open. The orders to a vehicle go by `order_sender.py`.
"""

from __future__ import annotations

import io
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any

import genpy
import rosgraph
import rospy
from rosgraph.network import ROSHandshakeException, encode_ros_handshake_header

from apad_bridge.doctor.network import Unreachable, call, connect
from apad_bridge.ros.system.handshakes import read_handshake
from apad_bridge.ros.system.lost_links import end_when_unacknowledged
from firmware_model.entry_points import in_one_line

PATIENCE_S = 5.0
"""A question waits so long for its answer."""
LENGTH = struct.Struct("<I")
ANSWER = struct.Struct("<BI")
"""The head of an answer: whether the call was carried out, and the length of what follows."""
LONGEST = 1_000_000
"""Bytes of an answer: one that is longer is none."""


class CallFailed(Exception):
    """The vehicle has not answered, or refused. The text is the reason."""


class ServiceAddress:
    """Finds a service at the address that the master named last, and asks the master again where nobody is there."""

    def __init__(self, name: str, kind: Any) -> None:
        self.name: str = rospy.resolve_name(name)
        self.kind = kind
        self._address = ""

    def open(self) -> socket.socket:
        """A connection that takes calls, with a time-out on all that follows. CallFailed where there can be none."""
        sock = self._connect()
        try:
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            sock.sendall(
                encode_ros_handshake_header(
                    {
                        "callerid": rospy.get_name(),
                        "service": self.name,
                        "md5sum": self.kind._md5sum,
                        "type": self.kind._type,
                        "persistent": "1",
                    }
                )
            )
            header = read_handshake(sock, io.BytesIO())
        except (OSError, ROSHandshakeException) as error:
            sock.close()
            raise CallFailed(f"its server does not take the connection: {error}") from None
        if "error" in header:
            sock.close()
            raise CallFailed(header["error"])
        end_when_unacknowledged(sock)
        return sock

    def _connect(self) -> socket.socket:
        try:
            if not self._address:
                self._look_up()
            return connect(self._address)
        except Unreachable:
            try:
                self._look_up()  # the node was started again, at another address
                return connect(self._address)
            except Unreachable as unreachable:
                raise CallFailed(str(unreachable)) from None

    def _look_up(self) -> None:
        self._address = str(call(rosgraph.get_master_uri(), "lookupService", self.name))


def request_bytes(request: Any) -> bytes:
    """The bytes of a service's request, as they go out."""
    data = io.BytesIO()
    request.serialize(data)
    return LENGTH.pack(len(data.getvalue())) + data.getvalue()


class Answers:
    """Cuts the bytes that come back on a connection into answers."""

    def __init__(self, kind: Any) -> None:
        self._kind = kind
        self._data = b""

    def take(self, data: bytes) -> list[tuple[Any, str | None]]:
        """The answers that are whole by now: a response and None, or None and the server's error.

        ValueError for bytes that are no answers.
        """
        self._data += data
        answers: list[tuple[Any, str | None]] = []
        while len(self._data) >= ANSWER.size:
            is_answered, length = ANSWER.unpack_from(self._data)
            if length > LONGEST:
                raise ValueError(f"an answer of {length} bytes")
            if len(self._data) < ANSWER.size + length:
                break
            body, self._data = (
                self._data[ANSWER.size : ANSWER.size + length],
                self._data[ANSWER.size + length :],
            )
            answers.append(self._answer(body) if is_answered else (None, body.decode(errors="replace")))
        return answers

    def _answer(self, body: bytes) -> tuple[Any, str | None]:
        try:
            return self._kind._response_class().deserialize(body), None
        except genpy.DeserializationError as error:
            return None, f"its answer cannot be read: {error}"


def ask_service(
    address: ServiceAddress, request: Any, answered: Callable[[Any, str | None], None]
) -> threading.Thread:
    """Asks a service that moves nothing, in a thread, which runs `answered` with the response, or with the reason."""

    def ask() -> None:
        response = why = None
        try:
            response = _asked(address, request)
        except CallFailed as failed:
            why = str(failed)
        except BaseException as defect:  # whoever asks still waits for an end
            why = in_one_line(defect)
            raise
        finally:
            answered(response, None if why is None else f"{address.name}: {why}")

    thread = threading.Thread(target=ask, name=f"question to {address.name}", daemon=True)
    thread.start()
    return thread


def _asked(address: ServiceAddress, request: Any) -> Any:
    until_s = time.monotonic() + PATIENCE_S
    answers = Answers(address.kind)
    with address.open() as sock:
        try:
            sock.sendall(request_bytes(request))
            while (left_s := until_s - time.monotonic()) > 0:
                sock.settimeout(left_s)
                if not (data := sock.recv(65_536)):
                    raise CallFailed("the connection ended")
                for response, error in answers.take(data):
                    if error is not None:
                        raise CallFailed(error)
                    return response
        except TimeoutError:
            pass
        except (OSError, ValueError) as error:
            raise CallFailed(str(error)) from None
    raise CallFailed("the vehicle did not answer in time")
