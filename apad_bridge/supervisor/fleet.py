"""A flight's aMussels: where they live, who lets their time pass, and the water between them.

A file of links that a person may change while a run flies.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from agents.coordinator import Coordinator
from agents.hosting.host import Host
from agents.mussel.outputs import Truth
from agents.water.sea import Sea
from agents.water.sea_events import SeaResult
from agents.water.topology import Topology
from apad_bridge.scenario.links import read_links
from firmware_model.config import Slots


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


@dataclass(frozen=True, slots=True)
class Fleet:
    """The agents of a flight, where they live, the clock authority over them, and the water that carries their sound.

    Without a `sea` whatever is said is heard. `timeslots` are those that packets are counted in, `links`
    is looked at at each tick.
    """

    coordinator: Coordinator
    host: Host
    sea: Sea | None = None
    timeslots: Slots | None = None
    links: LinksFile | None = None

    def advance(self, now_ms: int) -> Sequence[SeaResult]:
        return self.coordinator.advance(now_ms) if self.sea is None else self.sea.advance(now_ms)

    @property
    def dropped(self) -> Counter[str]:
        """What the water swallowed that is no packet's outcome."""
        return Counter() if self.sea is None else self.sea.dropped

    def take_truths(self) -> list[Truth]:
        return self.host.take_truths() if self.sea is None else self.sea.take_truths()
