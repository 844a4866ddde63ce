"""A file of links that a person may change while a run flies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from agents.water.topology import Topology
from apad_bridge.scenario.links import read_links


@dataclass(frozen=True, slots=True)
class Changed:
    """The file says something else now; `topology` is None, and `problem` says why, where it cannot be read."""

    topology: Topology | None
    problem: str | None


class LinksFile:
    """Looks at the file's time and size; a file that cannot be read leaves the links as they were."""

    def __init__(self, path: Path, theta: int) -> None:
        self.path = path
        self._theta = theta
        self._seen = self._stamp()

    def read(self) -> Topology:
        """OSError, or ValueError, `line N: ...`."""
        return read_links(self.path, self._theta)

    def look(self) -> Changed | None:
        """What changed since the last look, if anything did."""
        stamp = self._stamp()
        if stamp == self._seen:
            return None
        self._seen = stamp
        try:
            return Changed(self.read(), None)
        except OSError as error:
            return Changed(None, f"{error.strerror}: {self.path}")
        except ValueError as error:
            return Changed(None, str(error))

    def _stamp(self) -> tuple[int, int] | None:
        try:
            status = self.path.stat()
        except OSError:
            return None
        return status.st_mtime_ns, status.st_size
