"""Opens modems of simulated aMussels as serial devices: a pty each, under a fixed name in the run's directory.

    RUN/modems/amussel7 -> /dev/pts/4

A thread reads the devices and puts bursts on a queue. A burst is a row of bytes without a pause, so that a modem judges
slow bytes independently of the flight's polling. Output is lost while nobody has the device open, as on any serial line.
"""

from __future__ import annotations

import errno
import os
import queue
import select
import threading
import tty
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

FOLDER = "modems"
_PAUSE_MS = 5
"""The pause that ends a burst. A host writes a command at once, and its kernel passes it on with shorter pauses."""
_BURST_BYTES = 4096
_UNOPENED_POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class Burst:
    """Bytes that a host wrote to an aMussel's modem after a pause."""

    agent_id: int
    data: bytes


class OpenedModems:
    """The opened modems, owned by one thread beside the reader thread. `close` closes the ptys and removes their names."""

    def __init__(self, folder: Path, agent_ids: Iterable[int], name: str = "amussel") -> None:
        """Creates `folder` if needed; replaces the names that a former supervisor left. Each is `name` and the id."""
        folder.mkdir(exist_ok=True)
        self.lost_bytes = 0
        """The output lost because a host has the device open and does not read."""
        self._bursts: queue.SimpleQueue[Burst] = queue.SimpleQueue()
        self._masters: dict[int, int] = {}
        self._names: dict[int, Path] = {}
        for agent_id in agent_ids:
            self._masters[agent_id], device = _open_pty()
            self._names[agent_id] = _link(folder / f"{name}{agent_id}", device)
        self._wake_reader, self._waker = os.pipe()
        self._thread = threading.Thread(target=self._read, name="modems", daemon=True)
        self._thread.start()

    @property
    def agent_ids(self) -> list[int]:
        return list(self._masters)

    def path(self, agent_id: int) -> Path:
        return self._names[agent_id]

    def take(self) -> list[Burst]:
        """The bursts since the last call, in order."""
        bursts = []
        while True:
            try:
                bursts.append(self._bursts.get_nowait())
            except queue.Empty:
                return bursts

    def write(self, agent_id: int, data: bytes) -> None:
        """Writes to the host that has the device open."""
        master = self._masters[agent_id]
        if _is_unopened(master):
            return
        try:
            written = os.write(master, data)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise
            written = 0
        self.lost_bytes += len(data) - written

    def close(self) -> None:
        os.write(self._waker, b"x")
        self._thread.join(timeout=5.0)
        for name in self._names.values():
            name.unlink(missing_ok=True)
        for descriptor in (*self._masters.values(), self._wake_reader, self._waker):
            os.close(descriptor)
        self._masters.clear()

    def _read(self) -> None:
        """Runs the reader thread.

        A device that nobody has open always polls as hung up, so it is left out and checked again at intervals.
        """
        agents = {master: agent_id for agent_id, master in self._masters.items()}
        while True:
            poll = select.poll()
            poll.register(self._wake_reader, select.POLLIN)
            for master in agents:
                if not _is_unopened(master) or _has_bytes(master):
                    poll.register(master, select.POLLIN)
            for descriptor, event in poll.poll(_UNOPENED_POLL_S * 1000):
                if descriptor == self._wake_reader:
                    return
                if event & select.POLLIN and (data := _burst(descriptor)):
                    self._bursts.put(Burst(agents[descriptor], data))


def _open_pty() -> tuple[int, str]:
    """The master's descriptor and the device's path. The device is raw, and stays so while the master is open."""
    master, slave = os.openpty()
    tty.setraw(slave)
    device = os.ttyname(slave)
    os.close(slave)
    os.set_blocking(master, False)
    return master, device


def _link(name: Path, device: str) -> Path:
    fresh = name.with_name(f".{name.name}.new")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(device)
    fresh.replace(name)
    return name


def _is_unopened(master: int) -> bool:
    poll = select.poll()
    poll.register(master, 0)
    return any(event & select.POLLHUP for _, event in poll.poll(0))


def _has_bytes(master: int) -> bool:
    poll = select.poll()
    poll.register(master, select.POLLIN)
    return any(event & select.POLLIN for _, event in poll.poll(0))


def _burst(master: int) -> bytes:
    """Reads until there is a pause."""
    taken = b""
    poll = select.poll()
    poll.register(master, select.POLLIN)
    while len(taken) < _BURST_BYTES:
        try:
            data = os.read(master, _BURST_BYTES - len(taken))
        except OSError:
            break  # nobody has it open any more
        taken += data
        if not data or not any(event & select.POLLIN for _, event in poll.poll(_PAUSE_MS)):
            break
    return taken
