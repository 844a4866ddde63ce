"""The process of somebody's firmware: a child of this one, which ends with it, on a socket pair."""

from __future__ import annotations

import os
import select
import signal
import socket
import stat
import time
import weakref
from collections.abc import Sequence
from typing import Protocol

from agents.hosting.link_protocol import readable
from agents.mussel.firmware_failure import FirmwareFailed
from agents.mussel.port.board_link import FrameToBoard
from firmware_model.control_characters import shown
from firmware_model.port_frames import BadFrame, Frame, FrameReader, ToBoard, counter_at

PORT_VARIABLE = "MUSSELBED_PORT"
"""The environment variable with the number of the board's descriptor."""
_ENDING_S = 1.0
"""The wall time in which a process whose link has ended is expected to end."""
_PORT_FD = 3
_SETPRIV = ("/usr/bin/setpriv", "--no-new-privs", "--pdeathsig", "KILL", "--")
"""A program of util-linux, which no Debian is without. No program that a board starts gets more rights than it has."""
_AT_ONCE = 65_536
_MOST_SHOWN = 65_536
"""Bytes of a program's stderr that are passed on; the rest is read and left out."""
_LONGEST_LOG = 16 << 20
"""Bytes of a log in a file, as that of a nursery: a longer one takes nothing more from programs, and so from none of the
many that a board may begin."""


class StreamEnd(Protocol):
    """This end of a stream socket."""

    def fileno(self) -> int: ...

    def send(self, data: bytes, flags: int, /) -> int: ...


class RunningFirmware(Protocol):
    """Somebody's firmware as it runs."""

    pid: int

    @property
    def link(self) -> StreamEnd: ...

    @property
    def has_ended(self) -> bool: ...

    def awaits(self, timeout_s: float, *, writes: bool) -> bool:
        """Waits until the link can be read, or with `writes` written, or the program has ended; False after so long.

        Meanwhile it passes on what the program says to people.
        """

    def end(self, patience_s: float = 0.0) -> int | None:
        """Ends it, after so long for it to end by itself: its wait status, or None if it has ended before."""


class FirmwareProcess:
    """A `BoardLink` to a program, which ends with it."""

    def __init__(self, program: RunningFirmware, timeout_s: float) -> None:
        self._child = program
        weakref.finalize(self, program.end)
        self.pid: int | None = program.pid
        self._timeout_s = timeout_s
        self._deadline_s = 0.0
        self._reader = FrameReader()
        self._sent = self._received = 0
        self._unsent = b""

    def close(self) -> None:
        self._child.end()

    def send(self, frames: Sequence[FrameToBoard], now_ms: int) -> None:
        if frames[0][0] in (ToBoard.HELLO, ToBoard.RUN):
            self._deadline_s = time.monotonic() + self._timeout_s
        for kind, port, payload in frames:
            self._unsent += Frame(kind, port, counter_at(now_ms), self._sent, payload).encode()
            self._sent = self._sent + 1 & 0xFFFF_FFFF
        self._flush()

    def receive(self) -> list[Frame]:
        if not (data := self._read()):
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

    def _flush(self) -> None:
        """Sends as much as the program has room for: one that only writes is judged by its frames, and not by this."""
        try:
            if self._unsent:
                self._unsent = self._unsent[self._child.link.send(self._unsent, socket.MSG_DONTWAIT) :]
        except BlockingIOError:
            pass
        except OSError:
            raise FirmwareFailed(self._ending()) from None

    def _read(self) -> bytes:
        """The next bytes; none at the end of the link."""
        while self._child.awaits(self._deadline_s - time.monotonic(), writes=self._unsent != b""):
            try:
                return os.read(self._child.link.fileno(), _AT_ONCE)
            except BlockingIOError:
                if self._child.has_ended:
                    return b""  # a process that it left behind may hold the link open
                self._flush()
            except OSError:
                return b""
        late = f"within {self._timeout_s:g} s"
        why = f"it did not read {late}" if self._unsent else f"it did not end its turn {late}"
        raise FirmwareFailed(why, hung=True)

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

    def __init__(self, command: Sequence[str]) -> None:
        """`command` is an executable and its arguments."""
        link, theirs = socket.socketpair()
        link.setblocking(False)
        self.link, self._close = link, link.close
        self._words = _Words()
        with theirs:
            try:
                self.pid = _spawned(command, theirs.fileno(), self._words.writing)
            except OSError as error:
                link.close()
                self._words.close()
                raise FirmwareFailed(f"no process: {error.strerror}") from None
        os.close(self._words.writing)
        self._process = os.pidfd_open(self.pid)
        self._owner = os.getpid()
        self._is_over = False

    @property
    def has_ended(self) -> bool:
        return readable(self._process, 0.0)

    def awaits(self, timeout_s: float, *, writes: bool) -> bool:
        return self._words.pass_on_until((self.link.fileno(), self._process), timeout_s, writes=writes)

    def end(self, patience_s: float = 0.0) -> int | None:
        if self._is_over or os.getpid() != self._owner:
            return None
        self._is_over = True
        self._close()
        try:
            if not readable(self._process, patience_s):
                os.kill(self.pid, signal.SIGKILL)
            return os.waitpid(self.pid, 0)[1]
        finally:
            os.close(self._process)
            self._words.pass_on()
            os.close(self._words.reading)


class _Words:
    """The stderr of a program, passed on to ours: bounded, and with its control characters shown."""

    def __init__(self) -> None:
        self.reading, self.writing = os.pipe()
        os.set_blocking(self.reading, False)
        self._room = _MOST_SHOWN
        self._is_open = True

    def close(self) -> None:
        os.close(self.reading)
        os.close(self.writing)

    def pass_on_until(self, awaited: Sequence[int], timeout_s: float, *, writes: bool) -> bool:
        """Until one of these can be read, or with `writes` written, or for so long; False for the latter."""
        deadline_s = time.monotonic() + max(0.0, timeout_s)
        poll = select.poll()
        for descriptor in awaited:
            poll.register(descriptor, select.POLLIN | (select.POLLOUT if writes else 0))
        while True:
            if self._is_open:
                poll.register(self.reading, select.POLLIN)
            left_s = deadline_s - time.monotonic()
            ready = {descriptor for descriptor, _ in poll.poll(max(0.0, left_s) * 1000)}
            if self.reading in ready:
                self.pass_on()
                if not self._is_open:
                    poll.unregister(self.reading)
            if not ready.isdisjoint(awaited):
                return True
            # A program that only writes here does not end its turn by that.
            if left_s <= 0:
                return False

    def pass_on(self) -> None:
        """Takes what is there: not more than a pipe holds, however fast the program writes."""
        try:
            data = os.read(self.reading, _AT_ONCE)
        except BlockingIOError:
            return
        self._is_open = data != b""
        if not data or not self._room or _is_long(2):
            return
        told, self._room = data[: self._room], max(0, self._room - len(data))
        os.write(2, shown(told.decode("utf-8", "replace")).encode())
        if not self._room:
            os.write(2, b"\nthe rest of what this program writes to its stderr is left out\n")


def _is_long(log: int) -> bool:
    found = os.fstat(log)
    return stat.S_ISREG(found.st_mode) and found.st_size > _LONGEST_LOG


def _spawned(command: Sequence[str], fd: int, errors: int) -> int:
    """The process of a program with the port `fd` and the stderr `errors`, which the kernel ends with this process.

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
            (os.POSIX_SPAWN_DUP2, errors, 2),
            (os.POSIX_SPAWN_DUP2, fd, _PORT_FD),
        ],
        setsigmask=(),
        setsigdef=(signal.SIGPIPE, signal.SIGINT, signal.SIGTERM, signal.SIGCHLD),
    )
