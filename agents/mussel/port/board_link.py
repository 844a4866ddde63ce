"""The link from an agent to the firmware on its board: a process of its own, or a real board on a serial line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from firmware_model.port_frames import Frame, ToBoard

TURN_TIMEOUT_S = 8.0
"""The wall time that a turn may take. It is shorter than the patience of the fleet's watchdog with an agent."""
BENCH_TIMEOUT_S = 60.0
"""The same on a bench, where no fleet waits: a machine that is too slow for a while is no fault of the firmware."""
SERIAL_BAUD = 115_200
SERIAL = "serial:"
"""The beginning of a serial line's name, where the name of a program may stand, too."""

FrameToBoard = tuple[ToBoard, int, bytes]
"""Type, port and payload of a frame."""


class BoardLink(Protocol):
    """Frames to the firmware and from it, in order and without a gap.

    Methods raise FirmwareFailed where the firmware can do no more.
    """

    pid: int | None
    """The process; None for a real board."""

    def send(self, frames: Sequence[FrameToBoard], now_ms: int) -> None:
        """Sends frames, with the board's counter at agent time `now_ms`; HELLO or RUN at their head begins a turn."""

    def receive(self) -> list[Frame]:
        """Waits for the next frames, up to the time that the turn may take."""

    def close(self) -> None:
        """Ends the link, and the firmware's process."""


def serial_line(executable: str) -> tuple[str, int] | None:
    """The device and the baud rate of `serial:DEVICE` or `serial:DEVICE@BAUD`; None for a program.

    ValueError for a serial line without a device, or with another baud rate than a number.
    """
    if not executable.startswith(SERIAL):
        return None
    device, _, baud = executable.removeprefix(SERIAL).partition("@")
    if not device or (baud and not (baud.isdecimal() and int(baud))):
        raise ValueError("a serial line is serial:DEVICE or serial:DEVICE@BAUD, as serial:/dev/ttyUSB0")
    return device, int(baud or SERIAL_BAUD)
