"""Writes a run's tables as CSV or Parquet files, a MATLAB file, or its bags as MCAP. Each appears whole or not at all."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Any

from apad_bridge.analysis.export.tables import Table, closed_bags, tables_of
from apad_bridge.records.bag_samples import open_bag
from apad_bridge.records.line_file import read_lines
from apad_bridge.records.run_directory import RunDirectory

SAMPLES_TOPIC = "/musselbed/samples"
_LONGEST_NAME = 63
"""Characters of a name in MATLAB."""


class Format(StrEnum):
    MCAP = "mcap"
    MAT = "mat"
    CSV = "csv"
    PARQUET = "parquet"


def default_path(directory: RunDirectory, to: Format) -> Path:
    """A folder of files for CSV and Parquet, and one file for the others."""
    is_file = to in (Format.MCAP, Format.MAT)
    return directory.path / (f"export.{to}" if is_file else f"export-{to}")


def export(directory: RunDirectory, to: Format, path: Path) -> dict[str, int]:
    """Writes the run, and returns the number of rows by table, or of messages by topic.

    ImportError without the packages of `musselbed[export]`; BagUnreadable, JournalDamaged or OSError for records that
    cannot be read; OSError for a path that cannot be written.
    """
    match to:
        case Format.MCAP:
            return _write_mcap(directory, path)
        case Format.MAT:
            return _write_mat(tables_of(directory), path)
        case Format.CSV:
            return _write_each(tables_of(directory), path, ".csv", _write_csv)
        case Format.PARQUET:
            return _write_each(tables_of(directory), path, ".parquet", _write_parquet)


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """A new file beside `path`, in a folder made for it, which takes its place when this is left without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.new")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _write_each(
    tables: Iterable[Table], folder: Path, ending: str, write: Callable[[Table, Path], None]
) -> dict[str, int]:
    rows = {}
    for table in tables:
        with _replacing(folder / f"{table.name}{ending}") as path:
            write(table, path)
        rows[table.name] = table.rows
    return rows


def _write_csv(table: Table, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table.columns)
        writer.writerows(zip(*table.columns.values(), strict=True))


def _write_parquet(table: Table, path: Path) -> None:
    import pyarrow
    from pyarrow import parquet

    parquet.write_table(pyarrow.table({name: _alike(it) for name, it in table.columns.items()}), path)


def _alike(column: list[Any]) -> list[Any]:
    """Values of one type: whole numbers beside others become floats, and other mixtures texts."""
    kinds = {type(it) for it in column if it is not None}
    if kinds <= {int, float}:
        return [None if it is None else float(it) for it in column] if float in kinds else column
    return column if len(kinds) == 1 else [None if it is None else str(it) for it in column]


def _write_mat(tables: Iterable[Table], path: Path) -> dict[str, int]:
    """A struct of columns for each table: texts are cells of char, all else is numbers, and NaN stands for no value."""
    import numpy
    from scipy.io import savemat

    def column(values: list[Any]) -> Any:
        if any(isinstance(it, str) for it in values):
            return numpy.array(["" if it is None else str(it) for it in values], dtype=object)
        return numpy.array([numpy.nan if it is None else it for it in values], dtype=float)

    structs, rows = {}, {}
    for table in tables:
        structs[table.name] = {name[:_LONGEST_NAME]: column(it) for name, it in table.columns.items()}
        rows[table.name] = table.rows
    with _replacing(path) as temporary, temporary.open("wb") as file:
        savemat(file, structs, long_field_names=True, do_compression=True, oned_as="column")
    return rows


def _write_mcap(directory: RunDirectory, path: Path) -> dict[str, int]:
    """The bags' messages as they are, with their definitions, and the uploaded samples; times are mission time.

    The profile is `ros1`: Foxglove shows it as it shows the bag, with the same layout.
    """
    from mcap.writer import CompressionType, Writer

    counts: dict[str, int] = {}
    with _replacing(path) as temporary, temporary.open("wb") as file, closed_bags(directory) as bags:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(profile="ros1", library="musselbed")
        schemas: dict[tuple[str, str], int] = {}
        channels: dict[tuple[str, int], int] = {}

        def channel(topic: str, name: str, encoding: str, text: str, messages: str) -> int:
            if (name, text) not in schemas:
                schemas[name, text] = writer.register_schema(name, encoding, text.encode())
            schema = schemas[name, text]
            if (topic, schema) not in channels:
                channels[topic, schema] = writer.register_channel(topic, messages, schema)
            return channels[topic, schema]

        def add(topic: str, channel_id: int, at_ns: int, data: bytes) -> None:
            counts[topic] = counts.get(topic, 0) + 1
            writer.add_message(channel_id, at_ns, data, at_ns)

        for bag in bags:
            with open_bag(bag) as reader:
                for connection, at_ns, data in reader.messages():
                    name = connection.msgtype.replace("/msg/", "/")
                    there = channel(connection.topic, name, "ros1msg", connection.msgdef.data, "ros1")
                    add(connection.topic, there, at_ns, data)
        if directory.samples.is_file():
            samples = [it for it in read_lines(directory.samples) if it is not None]
            text = json.dumps(_schema_of(samples))
            there = channel(SAMPLES_TOPIC, "musselbed.Sample", "jsonschema", text, "json")
            for line in samples:
                add(SAMPLES_TOPIC, there, line["mission_ms"] * 1_000_000, json.dumps(line).encode())
        for file_ in (directory.scenario, directory.summary):
            if file_.is_file():
                kind = "application/json" if file_.suffix == ".json" else "application/yaml"
                writer.add_attachment(0, 0, file_.name, kind, file_.read_bytes())
        writer.finish()  # type: ignore[no-untyped-call]
    return counts


def _schema_of(samples: list[dict[str, Any]]) -> dict[str, Any]:
    """A JSON schema with the fields of these objects, as Foxglove plots them."""
    kinds = {int: "number", float: "number", str: "string", list: "array", bool: "boolean"}
    fields = {
        name: {"type": kinds[type(value)]}
        for line in samples
        for name, value in line.items()
        if type(value) in kinds
    }
    return {"type": "object", "properties": fields}
