"""The process of somebody's firmware: a child of this one, which ends with it, on a socket pair."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import time
import weakref
from collections.abc import Sequence

from agents.hosting.link_protocol import readable
from agents.mussel.board_link import FrameToBoard
from agents.mussel.firmware_failure import FirmwareFailed
from firmware_model.port_frames import BadFrame, Frame, FrameReader, ToBoard, counter_at

PORT_VARIABLE = "MUSSELBED_PORT"
"""The environment variable with the number of the board's descriptor."""
_ENDING_S = 1.0
"""The wall time in which a process whose link has ended is expected to end."""
_PORT_FD = 3
_NO_PROGRAM = 127
"""The exit status of a child that could not become the program, as a shell's."""
_PR_SET_PDEATHSIG = 1
_LIBC = ctypes.CDLL(None)
_AT_ONCE = 65_536


class FirmwareProcess:
    """A `BoardLink` to a program that it starts. FirmwareFailed if there can be no process."""

    def __init__(self, command: Sequence[str], timeout_s: float) -> None:
        """`command` is an executable and its arguments."""
        self._child = _Child(command, timeout_s)
        weakref.finalize(self, self._child.end)
        self.pid: int | None = self._child.pid
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


class _Child:
    """The process and this end of its link. FirmwareFailed if there can be none."""

    def __init__(self, command: Sequence[str], timeout_s: float) -> None:
        self.link, theirs = socket.socketpair()
        self.link.settimeout(timeout_s)
        parent = os.getpid()
        with theirs:
            try:
                self.pid = os.fork()
            except OSError as error:
                self.link.close()
                raise FirmwareFailed(f"no process: {error.strerror}") from None
            if self.pid == 0:
                _become(command, theirs.fileno(), parent)
        self._owner = parent
        self._is_over = False

    def end(self, patience_s: float = 0.0) -> int | None:
        """Ends the process, after so long for it to end by itself: its wait status, or None if it has ended before."""
        if self._is_over or os.getpid() != self._owner:
            return None
        self._is_over = True
        self.link.close()
        descriptor = os.pidfd_open(self.pid)
        try:
            if not readable(descriptor, patience_s):
                os.kill(self.pid, signal.SIGKILL)
            return os.waitpid(self.pid, 0)[1]
        finally:
            os.close(descriptor)


def _become(command: Sequence[str], fd: int, parent: int) -> None:
    """The child's steps up to its program; it never returns."""
    try:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(0)
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGPIPE, signal.SIGINT, signal.SIGTERM, signal.SIGCHLD):
            signal.signal(number, signal.SIG_DFL)
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, 0)
        os.dup2(null, 1)
        os.dup2(fd, _PORT_FD)
        os.set_inheritable(_PORT_FD, True)
        os.closerange(_PORT_FD + 1, os.sysconf("SC_OPEN_MAX"))
        os.execve(command[0], list(command), {**os.environ, PORT_VARIABLE: str(_PORT_FD)})
    finally:
        os._exit(_NO_PROGRAM)
