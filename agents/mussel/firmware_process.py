"""The process of somebody's firmware: a child of this one, which ends with it, on a socket pair."""

from __future__ import annotations

import os
import signal
import socket
import time
import weakref
from collections.abc import Sequence
from typing import Protocol

from agents.hosting.link_protocol import readable
from agents.mussel.board_link import FrameToBoard
from agents.mussel.firmware_failure import FirmwareFailed
from firmware_model.port_frames import BadFrame, Frame, FrameReader, ToBoard, counter_at

PORT_VARIABLE = "MUSSELBED_PORT"
"""The environment variable with the number of the board's descriptor."""
_ENDING_S = 1.0
"""The wall time in which a process whose link has ended is expected to end."""
_PORT_FD = 3
_SETPRIV = ("/usr/bin/setpriv", "--pdeathsig", "KILL", "--")
"""A program of util-linux, which no Debian is without."""
_AT_ONCE = 65_536


class StreamEnd(Protocol):
    """This end of a stream socket."""

    def fileno(self) -> int: ...

    def sendall(self, data: bytes, /) -> None: ...


class Program(Protocol):
    """Somebody's firmware as it runs."""

    pid: int

    @property
    def link(self) -> StreamEnd: ...

    def end(self, patience_s: float = 0.0) -> int | None:
        """Ends it, after so long for it to end by itself: its wait status, or None if it has ended before."""
        ...


class FirmwareProcess:
    """A `BoardLink` to a program, which ends with it."""

    def __init__(self, program: Program, timeout_s: float) -> None:
        self._child = program
        weakref.finalize(self, program.end)
        self.pid: int | None = program.pid
        self._timeout_s = timeout_s
        self._deadline_s = 0.0
        self._reader = FrameReader()
        self._sent = self._received = 0

    def close(self) -> None:
        self._child.end()

    def send(self, frames: Sequence[FrameToBoard], now_ms: int) -> None:
        if frames[0][0] in (ToBoard.HELLO, ToBoard.RUN):
            self._deadline_s = time.monotonic() + self._timeout_s
        data = b""
        for kind, port, payload in frames:
            data += Frame(kind, port, counter_at(now_ms), self._sent, payload).encode()
            self._sent = self._sent + 1 & 0xFFFF_FFFF
        try:
            self._child.link.sendall(data)
        except TimeoutError:
            raise FirmwareFailed(f"it read nothing for {self._timeout_s:g} s", hung=True) from None
        except OSError:
            raise FirmwareFailed(self._ending()) from None

    def receive(self) -> list[Frame]:
        try:
            if not readable(self._child.link.fileno(), self._deadline_s - time.monotonic()):
                raise TimeoutError
            data = os.read(self._child.link.fileno(), _AT_ONCE)
        except TimeoutError:
            raise FirmwareFailed(f"it did not end its turn within {self._timeout_s:g} s", hung=True) from None
        except OSError:
            data = b""
        if not data:
            raise FirmwareFailed(self._ending())
        try:
            frames = list(self._reader.feed(data))
        except BadFrame as error:
            raise FirmwareFailed(f"it sent {error}") from None
        for frame in frames:
            if frame.sequence != self._received:
                raise FirmwareFailed(f"frame {frame.sequence} came where {self._received} was due")
            self._received = self._received + 1 & 0xFFFF_FFFF
        return frames

    def _ending(self) -> str:
        status = self._child.end(_ENDING_S)
        if status is not None and os.WIFSIGNALED(status):
            return f"it was killed by {signal.Signals(os.WTERMSIG(status)).name}"
        return (
            "it ended" if status is None else f"it ended with exit status {os.waitstatus_to_exitcode(status)}"
        )


class FirmwareChild:
    """The process of a program that it starts, and this end of its link. FirmwareFailed if there can be none."""

    link: StreamEnd

    def __init__(self, command: Sequence[str], timeout_s: float) -> None:
        """`command` is an executable and its arguments."""
        link, theirs = socket.socketpair()
        link.settimeout(timeout_s)
        self.link, self._close = link, link.close
        with theirs:
            try:
                self.pid = _spawned(command, theirs.fileno())
            except OSError as error:
                link.close()
                raise FirmwareFailed(f"no process: {error.strerror}") from None
        self._owner = os.getpid()
        self._is_over = False

    def end(self, patience_s: float = 0.0) -> int | None:
        if self._is_over or os.getpid() != self._owner:
            return None
        self._is_over = True
        self._close()
        descriptor = os.pidfd_open(self.pid)
        try:
            if not readable(descriptor, patience_s):
                os.kill(self.pid, signal.SIGKILL)
            return os.waitpid(self.pid, 0)[1]
        finally:
            os.close(descriptor)


def _spawned(command: Sequence[str], fd: int) -> int:
    """The process of a program whose port is `fd`, and which the kernel ends with this process.

    A fork would copy the page tables of this process, and then each page that one of both writes: five times the work.
    `setpriv` asks for the death signal and becomes the program; a stream that has ended tells the program the same.
    """
    return os.posix_spawn(
        _SETPRIV[0],
        [*_SETPRIV, *command],
        {**os.environ, PORT_VARIABLE: str(_PORT_FD)},
        file_actions=[
            (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDWR, 0),
            (os.POSIX_SPAWN_DUP2, 0, 1),
            (os.POSIX_SPAWN_DUP2, fd, _PORT_FD),
        ],
        setsigmask=(),
        setsigdef=(signal.SIGPIPE, signal.SIGINT, signal.SIGTERM, signal.SIGCHLD),
    )
