"""Reads a battery's log from a user's file as minutes and the paper's scaled voltage, or reports its fault in one line.

Time may be seconds, minutes, hours, milliseconds, nanoseconds (as `rostopic echo -p` writes them) or ISO stamps; the value
may be mV, V, percent, or scaled already. The end of a column's name gives its unit. Otherwise an option has to give the
unit of time, and the size of the values gives the unit of voltage if only one unit is possible.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from agents.water.csv_table import number_of
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.text.text_file import text_of

Floats = npt.NDArray[np.float64]

MINUTES_IN = {"ns": 1 / 60e9, "ms": 1 / 60e3, "s": 1 / 60, "min": 1.0, "h": 60.0}
VALUE_UNITS = ("mv", "v", "percent", "scaled")
_UNIT_WORDS = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "minute": "min", "minutes": "min", "mins": "min",
    "hour": "h", "hours": "h", "msec": "ms", "stamp": "", "volt": "v", "volts": "v", "millivolts": "mv",
    "fraction": "scaled", "%": "percent", "pct": "percent",
}  # fmt: skip
_TIME_NAMES = re.compile(r"time|stamp|^t\b|date|second|minute|hour|elapsed")
_VALUE_NAMES = re.compile(
    r"volt|batt|charge|soc|scaled|fraction|percent|primary|secondary|^u\b|^v\b|\bm?v\b|data"
)


class LogError(UserError, ValueError):
    """The log cannot be used; the message is one line with the remedy."""


@dataclass(frozen=True, slots=True)
class LogFormat:
    """The user's description of the file; None is read from the file itself."""

    time_column: str | None = None
    value_column: str | None = None
    time_unit: str | None = None
    value_unit: str | None = None
    empty_mv: float = 3600.0
    full_mv: float = 4200.0


@dataclass(frozen=True, slots=True)
class BatteryLog:
    """A log: `minutes` (n,) from the first row on, never falling; `scaled` (n,), 0 at `empty_mv` and 1 at `full_mv`."""

    name: str
    minutes: Floats
    scaled: Floats
    left_out: int
    """The number of rows without a value."""


def read_log(path: Path, log_format: LogFormat) -> BatteryLog:
    """Reads a CSV file (comma, semicolon or tab; with or without a line of names). LogError names the file's line."""
    try:
        if not (rows := list(_rows(text_of(path, "utf-8-sig")))):
            raise LogError("holds no rows")
        return _log(path, rows, log_format)
    except LogError as error:
        raise LogError(f"{path}: {error}") from None


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yields (line, cells) of every line that is neither empty nor a comment."""
    lines = text.splitlines()
    first = next((line for line in lines if line.strip()), "")
    delimiter = next((mark for mark in ";\t" if mark in first), ",")
    for number, cells in enumerate(_cells_of(lines, delimiter), 1):
        if any(cell.strip() for cell in cells) and not cells[0].startswith("#"):
            # A comma is a decimal sign unless it separates the cells.
            yield (
                number,
                [cell.strip() if delimiter == "," else cell.strip().replace(",", ".") for cell in cells],
            )


def _cells_of(lines: list[str], delimiter: str) -> Iterator[list[str]]:
    """The cells of each line by itself: a quotation mark that is not closed must not take in the lines behind it."""
    for number, line in enumerate(lines, 1):
        try:
            yield next(csv.reader([line], delimiter=delimiter, strict=True), [])
        except csv.Error as error:
            raise LogError(f"line {number}: {error}: is a quotation mark not closed?") from None


def _log(path: Path, rows: list[tuple[int, list[str]]], log_format: LogFormat) -> BatteryLog:
    names = rows[0][1]
    if len(names) < 2:
        raise LogError(
            "has one column only, and a log needs two: time and voltage, between them a comma, ; or a tab"
        )
    named = not any(_is_number(cell) or _stamp(cell) is not None for cell in names)
    if not named:
        names = [f"{n}" for n in range(1, len(names) + 1)]
    time_at = _column(names, log_format.time_column, _TIME_NAMES, "--time-column", 0 if not named else None)
    value_at = _column(
        names, log_format.value_column, _VALUE_NAMES, "--value-column", 1 if not named else None, but=time_at
    )
    body = rows[1:] if named else rows
    times, values, line_numbers, left_out = _cells(body, time_at, value_at)
    if not times:
        raise LogError("holds no rows with a value")
    minutes = _minutes(
        times, line_numbers, log_format.time_unit or _unit_in(names[time_at], tuple(MINUTES_IN))
    )
    unit = log_format.value_unit or _unit_in(names[value_at], VALUE_UNITS) or _unit_by_size(values)
    return BatteryLog(path.name, minutes, _scaled(values, unit, log_format), left_out)


def _column(
    names: list[str],
    given: str | None,
    known: re.Pattern[str],
    option: str,
    default: int | None,
    but: int = -1,
) -> int:
    """The index of a column: by the given name, else by the usual names of such columns, else by its place."""
    if given is not None:
        if given not in names:
            raise LogError(f"no column is called {given!r}; there are {', '.join(names)}")
        return names.index(given)
    if default is not None:
        return default
    found = [n for n, name in enumerate(names) if n != but and known.search(name.lower().replace("_", " "))]
    if len(found) != 1 and option == "--value-column" and len(names) == 2:
        return 1 - but
    if not found:
        what = "time" if option == "--time-column" else "a battery's voltage or charge"
        raise LogError(f"no column looks like {what}: choose one with {option}: {', '.join(names)}")
    if len(found) > 1 and option == "--value-column":
        several = ", ".join(names[n] for n in found)
        raise LogError(f"{several}: choose one with {option}")
    return found[0]


def _cells(
    rows: list[tuple[int, list[str]]], time_at: int, value_at: int
) -> tuple[list[str], Floats, list[int], int]:
    """(times as text, values, line numbers, rows left out because they have no value)."""
    times, values, line_numbers = [], [], []
    left_out = 0
    for number, cells in rows:
        if max(time_at, value_at) >= len(cells):
            raise LogError(f"line {number}: has {len(cells)} columns only")
        cell = cells[value_at]
        if cell.lower() in ("", "nan", "na", "null", "none"):
            left_out += 1
            continue
        if not _is_number(cell):
            raise LogError(f"line {number}: {cell!r} is no number")
        times.append(cells[time_at])
        values.append(number_of(cell))
        line_numbers.append(number)
    return times, np.array(values), line_numbers, left_out


def _minutes(times: list[str], line_numbers: list[int], unit: str | None) -> Floats:
    stamps = not _is_number(times[0])
    if not stamps and unit is None:
        raise LogError(
            "does not state the unit of its time: call the column time_s or time_min, or give --time-unit"
        )
    found: list[float] = []
    first: datetime | None = None
    for number, cell in zip(line_numbers, times, strict=True):
        if stamps:
            if (stamp := _stamp(cell)) is None:
                raise LogError(f"line {number}: {cell!r} is no ISO time stamp (such as 2026-05-01T12:00:00)")
            first = first or stamp
            if (stamp.tzinfo is None) is not (first.tzinfo is None):
                raise LogError(f"line {number}: {cell!r}: stamps with and without a time zone in one log")
            at = (stamp - first).total_seconds() / 60
        elif _is_number(cell):
            at = (number_of(cell) - number_of(times[0])) * MINUTES_IN[unit or ""]
        else:
            raise LogError(f"line {number}: {cell!r} is no number")
        if found and at < found[-1]:
            raise LogError(f"line {number}: time goes back: put the rows in order, or cut the log there")
        found.append(at)
    return np.array(found)


def _scaled(values: Floats, unit: str, log_format: LogFormat) -> Floats:
    if unit == "scaled":
        return values
    if unit == "percent":
        return values / 100
    scale = 1000 if unit == "v" else 1
    scaled: Floats = (values * scale - log_format.empty_mv) / (log_format.full_mv - log_format.empty_mv)
    return scaled


def _unit_in(name: str, units: tuple[str, ...]) -> str | None:
    """The unit in a column's name: time_s, "t [min]", Voltage (mV), seconds; `%time` is ROS's nanoseconds."""
    if name == "%time":
        return "ns" if "ns" in units else None
    words: list[str] = re.findall(r"[a-z]+|%", name.lower())
    for word in reversed(words):
        if (unit := _UNIT_WORDS.get(word, word)) in units:
            return unit
    return None


def _unit_by_size(values: Floats) -> str:
    low, high = float(values.min()), float(values.max())
    if low >= -0.2 and high <= 1.2:
        return "scaled"
    if low >= 2 and high <= 5.5:
        return "v"
    if low >= 2000 and high <= 5500:
        return "mv"
    raise LogError(
        f"does not state the unit of its values, which run from {low:g} to {high:g}: give --value-unit "
        f"({', '.join(VALUE_UNITS)})"
    )


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(number_of(cell))
    except ValueError:
        return False


def _stamp(cell: str) -> datetime | None:
    try:
        return datetime.fromisoformat(cell)
    except ValueError:
        return None
