"""Writes a run's tables as CSV or Parquet files or a MATLAB file, or has its bags written as MCAP.

Each file appears whole or not at all.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from enum import StrEnum
from pathlib import Path
from typing import Any

from apad_bridge.analysis.export.mcap import write_mcap, write_ros2_mcap
from apad_bridge.analysis.export.tables import SeriesTable, tables_of
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.scenario.text.text_file import replacing

_LONGEST_NAME = 63
"""Characters of a name in MATLAB."""


class Format(StrEnum):
    MCAP = "mcap"
    ROS2 = "ros2"
    """An MCAP in ROS 2's form."""
    MAT = "mat"
    CSV = "csv"
    PARQUET = "parquet"


def default_path(directory: RunDirectory, to: Format) -> Path:
    """A folder of files for CSV and Parquet, and one file for the others."""
    names = {Format.MCAP: "export.mcap", Format.ROS2: "export-ros2.mcap", Format.MAT: "export.mat"}
    return directory.path / names.get(to, f"export-{to}")


def export(directory: RunDirectory, to: Format, path: Path) -> dict[str, int]:
    """Writes the run, and returns the number of rows by table, or of messages by topic.

    ImportError without the packages of `musselbed[export]`; BagUnreadable, JournalDamaged or OSError for records that
    cannot be read; OSError for a path that cannot be written.
    """
    match to:
        case Format.MCAP:
            return write_mcap(directory, path)
        case Format.ROS2:
            return write_ros2_mcap(directory, path)
        case Format.MAT:
            return _write_mat(tables_of(directory), path)
        case Format.CSV:
            return _write_each(tables_of(directory), path, ".csv", _write_csv)
        case Format.PARQUET:
            return _write_each(tables_of(directory), path, ".parquet", _write_parquet)


def _write_each(
    tables: Iterable[SeriesTable], folder: Path, ending: str, write: Callable[[SeriesTable, Path], None]
) -> dict[str, int]:
    rows = {}
    folder.mkdir(parents=True, exist_ok=True)
    for table in tables:
        with replacing(folder / f"{table.name}{ending}") as path:
            write(table, path)
        rows[table.name] = table.rows
    return rows


def _write_csv(table: SeriesTable, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table.columns)
        writer.writerows(zip(*table.columns.values(), strict=True))


def _write_parquet(table: SeriesTable, path: Path) -> None:
    import pyarrow
    from pyarrow import parquet

    with path.open("wb") as file:  # its own error of a file names none
        parquet.write_table(pyarrow.table({name: _alike(it) for name, it in table.columns.items()}), file)


def _alike(column: list[Any]) -> list[Any]:
    """Values of one type: whole numbers beside others become floats, and other mixtures texts."""
    kinds = {type(it) for it in column if it is not None}
    if kinds <= {int, float}:
        return [None if it is None else float(it) for it in column] if float in kinds else column
    return column if len(kinds) == 1 else [None if it is None else str(it) for it in column]


def _write_mat(tables: Iterable[SeriesTable], path: Path) -> dict[str, int]:
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
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary, temporary.open("wb") as file:
        savemat(file, structs, long_field_names=True, do_compression=True, oned_as="column")
    return rows
