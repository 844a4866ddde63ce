"""The grid on the water: it spans the area and as much again about it, with lines at whole multiples of its cell."""

from __future__ import annotations

from dataclasses import dataclass

from apad_bridge.analysis.layouts.fleet import LayoutFleet

_MOST_CELLS = 80
"""The most cells; a larger area gets the next coarser cell."""
_CELLS_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


@dataclass(frozen=True, slots=True)
class Grid:
    """A grid of `cells` each way, an even number, about a centre where lines cross."""

    cell_m: int
    cells: int
    north_m: int
    east_m: int


def grid_of(fleet: LayoutFleet) -> Grid:
    reach_m = 2 * max(*fleet.span_m, 1.0)
    cell_m = next((it for it in _CELLS_M if reach_m / it <= _MOST_CELLS), _CELLS_M[-1])
    north_m, east_m = (cell_m * round(it / cell_m) for it in fleet.centre_m)
    return Grid(cell_m, 2 * round(reach_m / cell_m / 2), north_m, east_m)
