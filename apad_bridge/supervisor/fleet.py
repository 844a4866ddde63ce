"""A flight's aMussels with their host, their coordinator and the water between them; and the file of acoustic links."""

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
from firmware_model.config import Timeslots


@dataclass(frozen=True, slots=True)
class Changed:
    """A change of the links file; if it cannot be read, `topology` is None and `problem` gives the reason."""

    topology: Topology | None
    problem: str | None


class LinksFile:
    """A file of links that a person may change during a run.

    A change shows in the file's time and size; a file that cannot be read leaves the links as they were.
    """

    def __init__(self, path: Path, theta: int) -> None:
        self.path = path
        self._theta = theta
        self._seen = self._stamp()

    def read(self) -> Topology:
        """Reads the links. OSError, or ValueError with `line N: ...`."""
        return read_links(self.path, self._theta)

    def look(self) -> Changed | None:
        """The change since the last look; None without one."""
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
    """The agents of a flight, their host, the clock authority over them, and the water that carries their sound.

    Without a `sea` every packet is received. Packets are counted in `timeslots`; `links` is checked at each tick.
    """

    coordinator: Coordinator
    host: Host
    sea: Sea | None = None
    timeslots: Timeslots | None = None
    links: LinksFile | None = None

    def advance(self, now_ms: int) -> Sequence[SeaResult]:
        return self.coordinator.advance(now_ms) if self.sea is None else self.sea.advance(now_ms)

    @property
    def dropped(self) -> Counter[str]:
        """Counts of losses in the water that are not the outcome of a packet."""
        return Counter() if self.sea is None else self.sea.dropped

    def take_truths(self) -> list[Truth]:
        return self.host.take_truths() if self.sea is None else self.sea.take_truths()
