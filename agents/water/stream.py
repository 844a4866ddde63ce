"""The water's current at a body: fields by depth and time, tides over them, and a profile that weakens it by depth.

All values are constant and in whole micrometres, so that the same place at the same time always has the same velocity.
Time is seconds of mission time, because the current follows the real water's clock.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from dataclasses import dataclass
from math import isfinite, pi, sin

from agents.water.table import number_of, read_rows

# A field of the water's current from a file, at one time and depth, in integer micrometres and micrometres a second.
#
# With integers the same place has the same velocity on every machine, whatever was computed before.
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


_UNIT = 1_000_000


@dataclass(frozen=True, slots=True)
class TideConstituent:
    """One constituent of the tide: an ellipse with the period `period_s`.

    North is `north_um_s` sin(2 pi (t / period + north_phase / 10^6)), and east likewise.
    """

    period_s: int
    north_um_s: int
    east_um_s: int
    north_phase: int = 0
    """Millionths of a period."""
    east_phase: int = 0

    def velocity_um_s(self, second: int) -> tuple[int, int]:
        return (
            round(self.north_um_s * _wave(second, self.period_s, self.north_phase)),
            round(self.east_um_s * _wave(second, self.period_s, self.east_phase)),
        )


def _wave(second: int, period_s: int, phase: int) -> float:
    return sin(2 * pi * ((second * _UNIT + phase * period_s) % (period_s * _UNIT)) / (period_s * _UNIT))


@dataclass(frozen=True, slots=True)
class Stream:
    """`fields` are row by row: all `depths_um` of the first of `seconds`, then those of the next. Both rise.

    The velocity is linear between two depths and between two times; outside, it is that of the nearest. `profile` has
    (depth in um, share in millionths) by rising depth, linear between: the share of the whole current at that depth.
    """

    seconds: array[int]
    depths_um: array[int]
    fields: tuple[CurrentField, ...]
    tides: tuple[TideConstituent, ...]
    profile: tuple[tuple[int, int], ...]
    is_still: bool
    """True if nothing ever drifts anywhere. It is stored because bodies ask at every event."""

    @classmethod
    def of(
        cls,
        seconds: array[int],
        depths_um: array[int],
        fields: tuple[CurrentField, ...],
        tides: tuple[TideConstituent, ...] = (),
        profile: tuple[tuple[int, int], ...] = (),
    ) -> Stream:
        is_still = not tides and all(field.is_still for field in fields)
        return cls(seconds, depths_um, fields, tides, profile, is_still)

    def velocity_um_s(self, north_um: int, east_um: int, depth_um: int, second: int) -> tuple[int, int]:
        """(north, east) velocity of the water in um/s."""
        north, east = self._field_um_s(north_um, east_um, depth_um, second)
        for tide in self.tides:
            tide_north, tide_east = tide.velocity_um_s(second)
            north += tide_north
            east += tide_east
        if not self.profile:
            return north, east
        share = self._share(depth_um)
        return north * share // _UNIT, east * share // _UNIT

    def _field_um_s(self, north_um: int, east_um: int, depth_um: int, second: int) -> tuple[int, int]:
        if len(self.fields) == 1:
            return self.fields[0].velocity_um_s(north_um, east_um)
        early, late, into, span = between(self.seconds, second)
        above, below, down, height = between(self.depths_um, depth_um)
        columns = len(self.depths_um)
        north = east = 0
        for row, weight in ((early, span - into), (late, into)):
            for column, other in ((above, height - down), (below, down)):
                if weight * other:
                    one = self.fields[row * columns + column].velocity_um_s(north_um, east_um)
                    north += one[0] * weight * other
                    east += one[1] * weight * other
        return north // (span * height), east // (span * height)

    def _share(self, depth_um: int) -> int:
        depths = array("q", [depth for depth, _ in self.profile])
        above, below, down, height = between(depths, depth_um)
        return (self.profile[above][1] * (height - down) + self.profile[below][1] * down) // height


def steady(field: CurrentField) -> Stream:
    """A stream with one field at every depth and time."""
    return Stream.of(array("q", [0]), array("q", [0]), (field,))


def parse_stream(text: str) -> Stream:
    """Reads a CSV like that of `CurrentField.parse`, which may have the columns `depth_m` and `time_s` as well.

    Every pair of a time and a depth has a field of its own. Raises ValueError, `line N: ...`, for any other file.
    """
    lines = text.removeprefix("\ufeff").splitlines()
    header = next((it for it in lines if it.partition("#")[0].strip()), "")
    names = [it.strip() for it in header.partition("#")[0].split(",")]
    keys = [names.index(name) if name in names else None for name in ("time_s", "depth_m")]
    if keys == [None, None]:
        return steady(CurrentField.parse(text))
    parts: dict[tuple[int, int], list[str]] = {}
    kept = _without(names, keys)
    for number, line in enumerate(lines, start=1):
        cells = [it.strip() for it in line.partition("#")[0].split(",")]
        if line is header or cells == [""]:
            continue
        if len(cells) != len(names):
            raise ValueError(f"line {number}: {len(cells)} values for {len(names)} columns")
        try:
            time_s, depth_um = (
                0 if key is None else round(number_of(cells[key]) * unit)
                for key, unit in zip(keys, (1, _UNIT), strict=True)
            )
        except (ValueError, OverflowError):
            raise ValueError(f"line {number}: time_s and depth_m: must be numbers") from None
        # Blank lines keep the line numbers right in the errors of `CurrentField.parse`.
        part = parts.setdefault((time_s, depth_um), [",".join(kept)])
        part += [""] * (number - len(part) - 1)
        part.append(",".join(_without(cells, keys)))
    return _assembled(parts)


def _without(cells: list[str], keys: list[int | None]) -> list[str]:
    return [cell for n, cell in enumerate(cells) if n not in keys]


def _assembled(parts: dict[tuple[int, int], list[str]]) -> Stream:
    if not parts:
        raise ValueError("no current in it: there is only a header")
    seconds = sorted({second for second, _ in parts})
    depths = sorted({depth for _, depth in parts})
    fields = []
    for second in seconds:
        for depth in depths:
            if (second, depth) not in parts:
                raise ValueError(f"not a grid: nothing for time_s {second}, depth_m {depth / _UNIT:g}")
            fields.append(CurrentField.parse("\n".join(parts[second, depth])))
    return Stream.of(array("q", seconds), array("q", depths), tuple(fields))


STILL = steady(STILL_WATER)


@dataclass(frozen=True, slots=True)
class CurrentConfig:
    """A current as plain values that cross a link."""

    csv: str | None = None
    """The text of the file for `parse_stream`; None for no field beside the tides."""
    tides: tuple[TideConstituent, ...] = ()
    profile: tuple[tuple[int, int], ...] = ()
    """The profile of a `Stream`."""

    def stream(self) -> Stream:
        """Raises ValueError for a file that `parse_stream` refuses."""
        stream = STILL if self.csv is None else parse_stream(self.csv)
        return Stream.of(stream.seconds, stream.depths_um, stream.fields, self.tides, self.profile)


STILL_CURRENT = CurrentConfig()
