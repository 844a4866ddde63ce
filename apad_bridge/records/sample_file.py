"""samples.jsonl: what the aMussels measured, as it was uploaded; a line a sample, appended, never written over.

A line is in the file before its record is acknowledged, so that whatever kills the supervisor, an aMussel forgets nothing
that is not here. Times are agent time; counts are raw, and the values are what the built-in calibrations make of them.

What the mission is for, counted: samples that were taken, that came ashore, and that never will.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from pathlib import Path
from types import MappingProxyType
from typing import Any

from apad_bridge.records.line_file import Line, LineFile, read_lines
from firmware_model.packets.sample_record import SampleRecord
from firmware_model.sampling.flash import PAGE_BYTES, PAGES, Ring
from firmware_model.sampling.sensors import SENSORS, Quantity, values

SAMPLE_KEYS = ("samples_taken", "samples_uploaded", "samples_lost", "samples_waiting")


def sample_figures(
    taken: Mapping[int, int],
    kept: Mapping[int, Set[int]],
    gone: Mapping[int, Set[int]],
    apart: Mapping[int, Sequence[range]] = MappingProxyType({}),
) -> dict[str, Any]:
    """The summary's keys. `taken` is from the truth, and empty where there is none: then only what came is known.

    `apart` are the sequences that were taken by a twin of a real aMussel, or out of the water: they count as nothing. Nor
    does what a real one uploaded in the name of a simulated one, beyond what that has taken.

    A sample is one reading of all four sensors, written into the log. Lost are those that the log has overwritten before
    they were uploaded, whether anybody has heard of that or not, and those that became unreadable.
    """
    if not taken:
        uploaded, lost = (sum(map(len, it.values())) for it in (kept, gone))
        return dict(zip(SAMPLE_KEYS, (None, uploaded, lost, None), strict=True))
    ring, nothing = Ring(PAGES, PAGE_BYTES), frozenset[int]()
    total = uploaded = lost = 0
    for agent_id, count in taken.items():
        own = set(range(count)).difference(*apart.get(agent_id, ()))
        came = own & kept.get(agent_id, nothing)
        never = (own & gone.get(agent_id, nothing)) | (own & set(range(ring.oldest(count))))
        total, uploaded, lost = total + len(own), uploaded + len(came), lost + len(never - came)
    return dict(zip(SAMPLE_KEYS, (total, uploaded, lost, total - uploaded - lost), strict=True))


_UNITS = ("oxygen_mg_l", "pressure_mbar", "temperature_c", "turbidity_ntu")
"""By `Quantity`."""


class SampleFile:
    """The samples of a run. The file is made with the first sample; a torn last line, of a kill, is cut off."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: LineFile | None = None
        self.kept: dict[int, set[int]] = {}
        """By aMussel, the sequences that are in the file."""
        self.unreadable = 0
        """Lines that somebody has damaged: their samples are taken again, if the aMussels still have them."""
        if path.exists():
            self._file = LineFile(path)
            for line in read_lines(path):
                if line is None or type(line.get("id")) is not int or type(line.get("sequence")) is not int:
                    self.unreadable += 1
                else:
                    self.kept.setdefault(line["id"], set()).add(line["sequence"])

    def append(self, agent_id: int, records: Iterable[SampleRecord]) -> None:
        """On disk when it returns. A record that is there already is left out."""
        kept = self.kept.setdefault(agent_id, set())
        new = [record for record in records if record.sequence not in kept]
        if not new:
            return
        if self._file is None:
            self._file = LineFile(self._path)
        for record in new:
            self._file.append(sample_line(agent_id, record))
            kept.add(record.sequence)
        self._file.flush()

    def close(self) -> None:
        """A second call does nothing."""
        if self._file is not None:
            self._file.close()


def sample_line(agent_id: int, record: SampleRecord) -> Line:
    """One sample as its line: raw counts, values in their units, and which readings lay outside their sensor's range."""
    readings = zip(_UNITS, values(SENSORS, record.counts), strict=True)
    return {
        "id": agent_id,
        "sequence": record.sequence,
        "agent_ms": record.agent_ms,
        **{unit: round(value, 4) for unit, value in readings},
        "counts": list(record.counts),
        "saturated": [it.name.lower() for it in Quantity if record.saturated >> it & 1],
    }
