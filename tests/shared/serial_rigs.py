"""A real board on a serial line for tests: our C board behind two ptys, with a cable between them that tests disturb."""

from __future__ import annotations

import os
import select
import subprocess
import threading
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from native_boards import NATIVE

_COMPILE_TIMEOUT_S = 120
_AT_ONCE = 4096
Cable = Callable[[bytes], bytes]


def compiled_for_serial(factory: pytest.TempPathFactory, *, is_whole: bool = False) -> Path:
    """A board with the serial line below its library, compiled once for all tests of this process, with all warnings."""
    board = factory.getbasetemp() / ("serial_whole" if is_whole else "serial_board")
    if board.exists():
        return board
    own = sorted((NATIVE / "whole").glob("*.c")) if is_whole else [NATIVE / "worst_case.c"]
    sources = [*map(str, own), str(NATIVE / "musselbed.c"), str(NATIVE / "serial_line.c")]
    warnings = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
    options = ["-std=c99", "-D_POSIX_C_SOURCE=200809L", "-O2", *warnings, "-Wl,--wrap=read,--wrap=write"]
    subprocess.run(["cc", *options, "-o", str(board), *sources], check=True, timeout=_COMPILE_TIMEOUT_S)
    return board


class SerialRig:
    """A board with power, and its line to `device`, which the bench opens."""

    def __init__(self, program: Path, device: Path, from_board: Cable = bytes) -> None:
        """`from_board` disturbs the line from the board's first word on, which it says as soon as it has power."""
        self.device = device
        self.from_board = from_board
        self.to_board: Cable = bytes
        self._program = program
        self._master, self._slave = _raw_pty()
        self._bench: tuple[int, int] | None = None
        self._lock = threading.Lock()
        self._waker, self._woken = os.pipe()[::-1]
        self._ends = False
        self._power_on()
        self.plug_in()
        self._thread = threading.Thread(target=self._relay, daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """The board's process, as a reset of the board gives it another one."""
        return self._board.pid

    def reset(self) -> None:
        """The board resets by itself: nothing of its memory stays."""
        self._board.kill()
        self._board.wait()
        self._power_on()

    def pull_out(self) -> None:
        """The cable leaves the bench's side; the board keeps its power."""
        with self._lock:
            assert self._bench is not None
            for descriptor in self._bench:
                os.close(descriptor)
            self._bench = None
            self.device.unlink()

    def plug_in(self) -> None:
        with self._lock:
            self._bench = _raw_pty()
            fresh = self.device.with_suffix(".new")
            fresh.symlink_to(os.ttyname(self._bench[1]))
            fresh.replace(self.device)
        os.write(self._waker, b"x")

    def close(self) -> None:
        self._ends = True
        os.write(self._waker, b"x")
        self._thread.join()
        self._board.kill()
        self._board.wait()
        for descriptor in (self._master, self._slave, self._waker, self._woken, *(self._bench or ())):
            os.close(descriptor)

    def _power_on(self) -> None:
        self._board = subprocess.Popen(
            [str(self._program)],
            pass_fds=[self._slave],
            stdin=subprocess.DEVNULL,
            env={**os.environ, "MUSSELBED_PORT": str(self._slave)},
        )

    def _relay(self) -> None:
        """Carries bytes both ways, through the cable."""
        while not self._ends:
            poll = select.poll()
            for descriptor in (self._woken, self._master, *(self._bench or ())[:1]):
                poll.register(descriptor, select.POLLIN)
            # While the cable is being pulled out, its end may be gone before this thread has left the poll.
            ready = {descriptor for descriptor, _ in poll.poll(50)}
            with self._lock:
                bench = -1 if self._bench is None else self._bench[0]
                if self._woken in ready:
                    os.read(self._woken, _AT_ONCE)
                if self._master in ready:
                    data = self.from_board(os.read(self._master, _AT_ONCE))
                    if bench >= 0:
                        os.write(bench, data)
                if bench in ready:
                    with suppress(BlockingIOError):  # another cable's end has the number of the former one
                        os.write(self._master, self.to_board(os.read(bench, _AT_ONCE)))


def _raw_pty() -> tuple[int, int]:
    """Both ends. The device's end stays open here, so that bytes wait for whoever opens it next."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    return master, slave
