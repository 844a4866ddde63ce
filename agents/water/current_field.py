"""A field of the water's current from a file, at one time and depth, in integer micrometres and micrometres a second.

With integers the same place has the same velocity on every machine, whatever was computed before.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from dataclasses import dataclass
from math import isfinite

from agents.water.csv_table import number_of, read_rows

COLUMNS = ("north_m", "east_m", "north_m_s", "east_m_s")
MAX_M = 1e6
MAX_M_S = 20.0  # faster than any current: a value beyond it has a wrong unit or column


@dataclass(frozen=True, slots=True)
class CurrentField:
    """Velocities at the crossings of lines of constant north and of constant east, which need not be evenly spaced.

    `norths_um` and `easts_um` rise; velocities (um/s) are row by row, all easts of the lowest north first. Between the
    lines the velocity is bilinear, rounded to the nearest um/s; outside, it is that of the nearest point of the edge. A
    single crossing is one current everywhere.
    """

    norths_um: array[int]
    easts_um: array[int]
    north_um_s: array[int]
    east_um_s: array[int]

    @classmethod
    def parse(cls, text: str) -> CurrentField:
        """Reads a CSV: a header naming the four `COLUMNS` in any order, a row a crossing, `#` for comments.

        Rows may be in any order. Raises ValueError, `line N: ...`, for a file that is not so or has gaps.
        """
        crossings = _crossings(text)
        norths = sorted({north for north, _ in crossings})
        easts = sorted({east for _, east in crossings})
        ordered = [(north, east) for north in norths for east in easts]
        for crossing in ordered:
            if crossing not in crossings:
                north_m, east_m = (um / 1e6 for um in crossing)
                raise ValueError(f"not a grid: there is no row for north_m {north_m:g}, east_m {east_m:g}")
        return cls(
            array("q", norths),
            array("q", easts),
            array("q", [crossings[crossing][0] for crossing in ordered]),
            array("q", [crossings[crossing][1] for crossing in ordered]),
        )

    @property
    def is_still(self) -> bool:
        """True if no crossing has any current, so that nothing drifts."""
        return not any(self.north_um_s) and not any(self.east_um_s)

    def velocity_um_s(self, north_um: int, east_um: int) -> tuple[int, int]:
        """(north, east) velocity of the water in um/s at a place in local NED um."""
        low_n, high_n, along_n, span_n = between(self.norths_um, north_um)
        low_e, high_e, along_e, span_e = between(self.easts_um, east_um)
        columns = len(self.easts_um)
        weights = (
            (low_n * columns + low_e, (span_n - along_n) * (span_e - along_e)),
            (low_n * columns + high_e, (span_n - along_n) * along_e),
            (high_n * columns + low_e, along_n * (span_e - along_e)),
            (high_n * columns + high_e, along_n * along_e),
        )
        whole = span_n * span_e
        north = sum(self.north_um_s[index] * weight for index, weight in weights)
        east = sum(self.east_um_s[index] * weight for index, weight in weights)
        return (2 * north + whole) // (2 * whole), (2 * east + whole) // (2 * whole)


def between(lines: array[int], at: int) -> tuple[int, int, int, int]:
    """(index below, index above, distance from below, width) among the rising lines; a cell of width 1 outside them."""
    last = len(lines) - 1
    above = bisect_right(lines, at)
    if above == 0:
        return 0, 0, 0, 1
    if above > last:
        return last, last, 0, 1
    below = above - 1
    return below, above, at - lines[below], lines[above] - lines[below]


def _crossings(text: str) -> dict[tuple[int, int], tuple[int, int]]:
    """Maps (north, east) in um to (north, east) in um/s, for every row."""
    crossings: dict[tuple[int, int], tuple[int, int]] = {}

    def take(texts: dict[str, str]) -> None:
        north, east, north_speed, east_speed = (
            _millionths(name, texts[name], MAX_M_S if name.endswith("_m_s") else MAX_M) for name in COLUMNS
        )
        if (north, east) in crossings:
            raise ValueError("this place is in a line above already")
        crossings[north, east] = north_speed, east_speed

    read_rows(text, _check_header, take)
    if not crossings:
        raise ValueError(f"no current in it: needs a header {','.join(COLUMNS)} and one row or more")
    return crossings


def _check_header(cells: list[str]) -> None:
    if sorted(cells) != sorted(COLUMNS):
        raise ValueError(f"the columns must be {', '.join(COLUMNS)}, not {', '.join(cells)}")


def _millionths(name: str, text: str, limit: float) -> int:
    try:
        number = number_of(text)
    except ValueError:
        raise ValueError(f"{name}: must be a number, not {text!r}") from None
    if not isfinite(number) or abs(number) > limit:
        raise ValueError(f"{name}: must be a number within +-{limit:g}, not {text}")
    return round(number * 1_000_000)


STILL_WATER = CurrentField(array("q", [0]), array("q", [0]), array("q", [0]), array("q", [0]))
