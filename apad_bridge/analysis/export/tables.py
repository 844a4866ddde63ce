"""Every series of a run as tables of named columns: samples from its bags, events from its journal, uploads, figures.

Names end in their unit, as the records have them (docs/records.md). A value that a row lacks is None.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.typesys.store import Typestore

from apad_bridge.events.fleet_events import BeliefChanged, TruthChanged
from apad_bridge.events.run_events import TickPassed
from apad_bridge.events.sound_events import PacketPassed
from apad_bridge.events.vehicle_events import APadMoved
from apad_bridge.records.bag import is_closed, repair_bag
from apad_bridge.records.bag_messages import APAD, BELIEFS, TRUTH
from apad_bridge.records.bag_samples import definitions_in, messages_in, open_bag, refused
from apad_bridge.records.journal import Entry, read_journal
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.sample_file import read_samples

_SAMPLED = {TRUTH: "truth", BELIEFS: "beliefs", APAD: "apad"}
_IN_SAMPLES = (TruthChanged, BeliefChanged, APadMoved, TickPassed)
"""Events whose values are in the samples, at more times."""
_HEARD = ("listener", "outcome", "snr_db", "end_agent_ms", "travel_ms", "way_m")


class SeriesTable(NamedTuple):
    """Columns of equal length, of numbers, truths, texts and None."""

    name: str
    columns: dict[str, list[Any]]

    @property
    def rows(self) -> int:
        return max(map(len, self.columns.values()), default=0)


class _Rows:
    """Rows with the same or other keys, joined into columns."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._columns: dict[str, list[Any]] = {}
        self._count = 0

    def add(self, row: Mapping[str, Any]) -> None:
        for key, value in row.items():
            column = self._columns.get(key)
            if column is None:
                column = self._columns[key] = [None] * self._count
            column.append(value)
        self._count += 1
        for column in self._columns.values():
            if len(column) < self._count:
                column.append(None)

    def table(self) -> SeriesTable:
        return SeriesTable(self._name, self._columns)


def tables_of(directory: RunDirectory) -> Iterator[SeriesTable]:
    """Yields each series of the run that has rows. BagUnreadable for a bag that is none; JournalDamaged, OSError."""
    with closed_bags(directory) as bags:
        yield from (it for it in _sampled(bags) if it.rows)
    yield from _events(read_journal(directory.journal).entries)
    if directory.samples.is_file():
        samples = _Rows("samples")
        for sample in read_samples(directory.samples):
            samples.add(_flat(sample.columns))
        yield samples.table()
    if (summary := directory.read_summary()) is not None:
        yield from _figures(summary)


@contextmanager
def closed_bags(directory: RunDirectory) -> Iterator[list[Path]]:
    """The run's bags in order; of one that was never closed a repaired copy, and the run's own stays as it is."""
    with ExitStack() as stack:
        bags = []
        for bag in directory.bags:
            if not is_closed(bag):
                copy = Path(stack.enter_context(tempfile.TemporaryDirectory())) / bag.name
                shutil.copyfile(bag, copy)
                repair_bag(copy)
                bag = copy
            bags.append(bag)
        yield bags


def _sampled(bags: list[Path]) -> list[SeriesTable]:
    tables = {kind: _Rows(name) for kind, name in _SAMPLED.items()}
    for bag in bags:
        with open_bag(bag) as reader:
            wanted = [it for it in reader.connections if it.msgtype in tables]
            store = definitions_in(bag, wanted)
            for connection, _, data in messages_in(bag, reader, wanted):
                kind = connection.msgtype
                with refused(f"{bag}: a message of {connection.topic} is not of its own definition"):
                    message: Any = store.deserialize_ros1(data, kind)
                rows = tables[kind]
                stamp = message.header.stamp
                head = {"stamp_s": stamp.sec + stamp.nanosec / 1e9} | _of_message(message, store)
                if not hasattr(message, "agents"):
                    rows.add(head)
                    continue
                names = head.pop("reported_names", ())
                for agent in message.agents:
                    row = head | _of_message(agent, store)
                    rows.add(row | {name: row.pop(f"reported_{n}") for n, name in enumerate(names)})
    return [rows.table() for rows in tables.values()]


def _of_message(message: Any, store: Typestore) -> dict[str, Any]:
    """Its numbers and texts; a list of numbers becomes a column for each."""
    row: dict[str, Any] = {}
    for name, _ in store.fielddefs[message.__msgtype__][1]:
        value = getattr(message, name)
        if hasattr(value, "tolist"):
            row |= {f"{name}_{n}": number for n, number in enumerate(value.tolist())}
        elif name not in ("header", "agents"):
            row[name] = value
    return row


def _events(entries: list[Entry]) -> Iterator[SeriesTable]:
    """A table for each kind of event, `event_KIND`, and of packets a second one with a row for each listener."""
    tables: dict[str, _Rows] = {}
    heard = _Rows("packets_heard")
    for at_ms, event in entries:
        if isinstance(event, _IN_SAMPLES):
            continue
        table = tables.setdefault(event.kind, _Rows(f"event_{event.kind}"))
        fields = {name: value for name, value in event.data.items() if name != "heard"}
        table.add({"mission_ms": at_ms, **_flat(fields)})
        for listener in event.heard if isinstance(event, PacketPassed) else ():
            packet = {name: fields[name] for name in ("from", "what", "began_ms", "lasted_ms")}
            heard.add({"mission_ms": at_ms, **packet, **dict(zip(_HEARD, listener, strict=False))})
    yield from (it.table() for it in tables.values())
    if (found := heard.table()).rows:
        yield found


def _figures(summary: dict[str, Any]) -> Iterator[SeriesTable]:
    """The summary in one row, and a row for each aMussel."""
    agents = summary.pop("amussels", {})
    whole = _Rows("summary")
    whole.add(_flat(summary))
    yield whole.table()
    rows = _Rows("summary_amussels")
    for agent_id, figures in agents.items():
        rows.add({"id": int(agent_id), **_flat(figures)})
    if agents:
        yield rows.table()


def _flat(fields: Mapping[str, Any]) -> dict[str, Any]:
    """One level of an object becomes columns of its own; what is deeper, and a list, is JSON."""
    row: dict[str, Any] = {}
    for name, value in fields.items():
        if isinstance(value, dict):
            row |= {f"{name}_{key}": _scalar(inner) for key, inner in value.items()}
        else:
            row[name] = _scalar(value)
    return row


def _scalar(value: Any) -> Any:
    return json.dumps(value, separators=(",", ":")) if isinstance(value, (list, tuple, dict)) else value
