"""Reads the CSV of starts: id, a place as lat and lon or as north and east (or both), battery, optionally secondary.

The first line that is no comment names the columns, in any order; `#` begins a comment, empty lines do not count. Columns
of other names are kept as they are. Every message names the file and the line.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from math import hypot, isfinite
from pathlib import Path

from agents.water.csv_table import number_of
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.text.text_file import text_of
from firmware_model.packets.wire import MAX_AGENT_ID

STARTS_NAME = "starts.csv"
ENDS_NAME = "ends.csv"

_ALIASES = {
    "id": "id",
    "agent_id": "id",
    "lat": "lat",
    "latitude": "lat",
    "latitude_deg": "lat",
    "lon": "lon",
    "lng": "lon",
    "longitude": "lon",
    "longitude_deg": "lon",
    "north": "north",
    "north_m": "north",
    "east": "east",
    "east_m": "east",
    "battery": "battery",
    "charge": "battery",
    "primary": "battery",
    "secondary": "secondary",
}
_OURS = frozenset(_ALIASES.values())
_AGREE_M = 0.01  # lat and lon are written to 9 decimals, 0.1 mm


@dataclass(frozen=True, slots=True)
class Start:
    """Place in local NED metres; primary and secondary charge on the paper's scaled voltage, [0, 1]."""

    agent_id: int
    north_m: float
    east_m: float
    primary: float
    secondary: float = 1.0
    further: tuple[tuple[str, str], ...] = ()
    """(column, text) of each column of the file that is none of ours."""


def table_of(start: Path) -> Path:
    """Returns the CSV that `fleet.start` means: itself, or a former run's ends, or its starts if it did not come so far."""
    if not start.is_dir():
        return start
    for name in (ENDS_NAME, STARTS_NAME):
        if (start / name).is_file():
            return start / name
    raise ScenarioError([f"{start}: no former run: it holds neither {ENDS_NAME} nor {STARTS_NAME}"])


def read_ids(path: Path) -> list[int]:
    """Reads the ids alone, each once and rising. It skips a row without one, which `read_table` refuses.

    Raises ScenarioError for a file without a readable header.
    """
    columns, lines = _read(path)
    ids = set()
    for _, line in lines:
        with suppress(ValueError, IndexError):
            ids.add(_agent_id(_cells(line)[columns.index("id")]))
    return sorted(ids)


def read_table(path: Path, frame: LocalFrame, secondary_of: Callable[[int], float]) -> dict[int, Start]:
    """Reads all rows, by the number of their line, in the order of the file.

    `secondary_of` returns the charge of a secondary battery, by id, where the file has no such column. Raises ScenarioError
    with a `FILE:LINE: message` for each wrong row.
    """
    columns, lines = _read(path)
    rows: dict[int, Start] = {}
    first_lines: dict[int, int] = {}
    problems: list[str] = []
    for number, line in lines:
        try:
            row = _row(columns, _cells(line), frame, secondary_of)
            if (first := first_lines.setdefault(row.agent_id, number)) != number:
                raise ValueError(f"id {row.agent_id} is in line {first} already")
            rows[number] = row
        except ValueError as error:
            problems.append(f"{path}:{number}: {error}")
    if problems:
        raise ScenarioError(problems)
    return rows


def completed(path: Path, draw_charge: Callable[[], float]) -> str | None:
    """The file's text with the columns `id` (1, 2, 3...) and `battery` that it lacks; None if it lacks none.

    A table of waypoints becomes one of starts. Raises ScenarioError for one without places.
    """
    columns, lines = _read(path, needed=())
    if not (added := [it for it in ("id", "battery") if it not in columns]):
        return None
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*added, *columns])
    for n, (_, line) in enumerate(lines, start=1):
        values = {"id": n, "battery": f"{draw_charge():.2f}"}
        writer.writerow([*(values[it] for it in added), *_cells(line)])
    return text.getvalue()


def _read(path: Path, needed: Sequence[str] = ("id", "battery")) -> tuple[list[str], list[tuple[int, str]]]:
    """Returns the columns, and the lines below them with their numbers."""
    text = text_of(path, "utf-8-sig")
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise ScenarioError(
            [f"{path}: no header: the first line names the columns, such as id,north,east,battery"]
        )
    try:
        return _columns(lines[0][1], needed), lines[1:]
    except ValueError as error:
        raise ScenarioError([f"{path}:{lines[0][0]}: {error}"]) from error


def _cells(line: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:
        raise ValueError(str(error)) from error


def _columns(header: str, needed: Sequence[str]) -> list[str]:
    """Our name of each column, and its own if it has none."""
    columns: list[str] = []
    for cell in _cells(header):
        name = _ALIASES.get(cell.lower(), cell)
        if name in columns:
            raise ValueError(f"column {cell!r}: {name} exists already")
        columns.append(name)
    _refuse_misspelled(columns)
    if missing := [it for it in needed if it not in columns]:
        raise ValueError(f"column {missing[0]} is missing: add it, or let `musselbed new --starts` add it")
    for one, other in (("lat", "lon"), ("north", "east")):
        if (one in columns) != (other in columns):
            raise ValueError(f"columns {one} and {other} go together")
    if "lat" not in columns and "north" not in columns:
        raise ValueError("columns lat and lon, or north and east, are missing")
    return columns


def _refuse_misspelled(columns: Sequence[str]) -> None:
    """Refuses a further column whose name is nearly that of a column of ours that is missing."""
    has_place = {"lat", "lon"} <= {*columns} or {"north", "east"} <= {*columns}
    there = {*columns} | ({"lat", "lon", "north", "east"} if has_place else set())
    missing = [alias for alias, name in _ALIASES.items() if name not in there]
    for column in columns:
        if column not in _OURS and (near := get_close_matches(column.lower(), missing, n=1, cutoff=0.8)):
            raise ValueError(f"unknown column {column!r}; did you mean {near[0]}?")


def _row(
    columns: list[str], cells: list[str], frame: LocalFrame, secondary_of: Callable[[int], float]
) -> Start:
    if len(cells) != len(columns):
        raise ValueError(f"{len(cells)} values for {len(columns)} columns")
    texts = dict(zip(columns, cells, strict=True))
    agent_id, place_m = _agent_id(texts["id"]), _place(texts, frame)
    return Start(
        agent_id,
        *place_m,
        _charge("battery", texts["battery"]),
        _charge("secondary", texts["secondary"]) if "secondary" in texts else secondary_of(agent_id),
        tuple((column, text) for column, text in texts.items() if column not in _OURS),
    )


def _place(texts: Mapping[str, str], frame: LocalFrame) -> tuple[float, float]:
    """Returns north and east. If the row has lat and lon too, both pairs must mean the same place."""
    local = (_number("north", texts["north"]), _number("east", texts["east"])) if "north" in texts else None
    if "lat" not in texts:
        assert local is not None  # the header was checked
        return local
    projected = frame.to_local(_number("lat", texts["lat"]), _number("lon", texts["lon"]))
    if local is None:
        return projected
    if (apart_m := hypot(local[0] - projected[0], local[1] - projected[1])) > _AGREE_M:
        raise ValueError(
            f"lat, lon and north, east are {apart_m:.2f} m apart: "
            f"correct one, leave two columns out, or use the origin that the file was written with"
        )
    return local


def _agent_id(text: str) -> int:
    if not (text.isascii() and text.isdigit() and 1 <= int(text) <= MAX_AGENT_ID):
        raise ValueError(f"id: must be a whole number from 1 on, not {text!r}")
    return int(text)


def _charge(column: str, text: str) -> float:
    charge = _number(column, text)
    if not 0 <= charge <= 1:
        raise ValueError(f"{column}: must be a charge in [0, 1], not {text}")
    return charge


def _number(column: str, text: str) -> float:
    try:
        number = number_of(text)
    except ValueError:
        raise ValueError(f"{column}: must be a number, not {text!r}") from None
    if not isfinite(number):
        raise ValueError(f"{column}: must be a finite number, not {text}")
    return number
