"""The water's current at a body: fields by depth and time, tides over them, and a profile that weakens it by depth.

All values are constant and in whole micrometres, so that the same place at the same time always has the same velocity.
Time is seconds of mission time, because the current follows the real water's clock.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from math import pi, sin

from agents.water.csv_table import number_of
from agents.water.current_field import STILL_WATER, CurrentField, between

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
class WaterCurrent:
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
    ) -> WaterCurrent:
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


def steady(field: CurrentField) -> WaterCurrent:
    """A current with one field at every depth and time."""
    return WaterCurrent.of(array("q", [0]), array("q", [0]), (field,))


def parse_water_current(text: str) -> WaterCurrent:
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


def _assembled(parts: dict[tuple[int, int], list[str]]) -> WaterCurrent:
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
    return WaterCurrent.of(array("q", seconds), array("q", depths), tuple(fields))


STILL = steady(STILL_WATER)


@dataclass(frozen=True, slots=True)
class CurrentConfig:
    """A current as plain values that cross a link."""

    csv: str | None = None
    """The text of the file for `parse_water_current`; None for no field beside the tides."""
    tides: tuple[TideConstituent, ...] = ()
    profile: tuple[tuple[int, int], ...] = ()
    """The profile of a `WaterCurrent`."""

    def water_current(self) -> WaterCurrent:
        """Raises ValueError for a file that `parse_water_current` refuses."""
        read = STILL if self.csv is None else parse_water_current(self.csv)
        return WaterCurrent.of(read.seconds, read.depths_um, read.fields, self.tides, self.profile)


STILL_CURRENT = CurrentConfig()
