"""A log as the toolchain's own vehicles write it: `Data.lsf`, the packets that were sent and received, one after the other.

A review of Neptus opens the folder. Its name is the time at which it was begun, as DUNE names its logs.
"""

from __future__ import annotations

import time
from pathlib import Path

from apad_bridge.imc import protocol as imc
from apad_bridge.imc.protocol import Message

FOLDER = "imc"


class LsfLog:
    """Appends packets; they reach the file at `flush`. A kill can tear only the last one."""

    def __init__(self, run_dir: Path, begun_s: float) -> None:
        """Makes the log's folder below the run's directory. `begun_s` is Unix time."""
        begun = time.gmtime(begun_s)
        below = run_dir / FOLDER / time.strftime("%Y%m%d", begun)
        stem, n = time.strftime("%H%M%S", begun), 1
        while True:
            self.folder = below / (stem if n == 1 else f"{stem}-{n}")
            try:
                self.folder.mkdir(parents=True)
                break
            except FileExistsError:
                n += 1
        self._file = (self.folder / "Data.lsf").open("xb")

    @property
    def name(self) -> str:
        """The log's name, as a review shows it."""
        return f"{self.folder.parent.name}/{self.folder.name}"

    def append(self, packet: bytes) -> None:
        self._file.write(packet)

    def append_received(self, message: Message, now_s: float) -> None:
        """Appends a message that was received, in this machine's byte order, at the time of its arrival.

        Its own time is that of another clock, and of a moment before the newest messages that were sent.
        """
        theirs = message.timestamp
        message.timestamp = now_s
        self.append(imc.packed(message))
        message.timestamp = theirs

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        self._file.close()
