"""Modems' places in the water, and a grid of cells that finds near modems among many."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot, sqrt

from agents.mussel.physical import Physical
from firmware_model.actions import Buoyancy
from firmware_model.sinking import Sinking


@dataclass(frozen=True, slots=True)
class ModemPlace:
    """A modem's place from a stated time on, in local NED micrometres, and its vertical motion from an anchor time.

    The depth moves by `rise_um` (positive down) in each `rise_over_ms` until it reaches 0 or `bottom_um`. Depth 0 is in
    air: the modem sits in the cap of a floating or docked aMussel. With `in_water` a modem is under water whatever its
    depth, like the modem on a vehicle's keel.
    """

    north_um: int
    east_um: int
    depth_um: int
    depth_anchor_ms: int = 0
    rise_um: int = 0
    rise_over_ms: int = 1
    bottom_um: int = 0
    in_water: bool = False

    def depth_at_um(self, at_ms: int) -> int:
        if self.rise_um == 0:
            return self.depth_um
        elapsed_ms = at_ms - self.depth_anchor_ms
        if self.rise_um < 0:
            return max(0, self.depth_um - -self.rise_um * elapsed_ms // self.rise_over_ms)
        return min(self.bottom_um, self.depth_um + self.rise_um * elapsed_ms // self.rise_over_ms)

    def hears_at(self, at_ms: int) -> bool:
        """True if there is water around the modem."""
        return self.in_water or self.depth_at_um(at_ms) > 0


def along_m(one: ModemPlace, other: ModemPlace) -> float:
    """The horizontal distance between two places."""
    return hypot(one.north_um - other.north_um, one.east_um - other.east_um) / 1e6


def distance_m(one: ModemPlace, other: ModemPlace, at_ms: int) -> float:
    north, east = one.north_um - other.north_um, one.east_um - other.east_um
    down = one.depth_at_um(at_ms) - other.depth_at_um(at_ms)
    return sqrt(north * north + east * east + down * down) / 1e6


def place_of(physical: Physical, sinking: Sinking) -> ModemPlace:
    """The place of an aMussel's modem, which sits in the cap of its body."""
    if physical.docked:
        return ModemPlace(physical.north_um, physical.east_um, 0)
    here = (physical.north_um, physical.east_um, physical.depth_um, physical.depth_anchor_ms)
    match physical.buoyancy:
        case Buoyancy.FLOAT:
            return ModemPlace(*here, -sinking.bottom_um, sinking.surfacing_ms, sinking.bottom_um)
        case Buoyancy.SINK:
            return ModemPlace(*here, sinking.bottom_um, sinking.sinking_ms, sinking.bottom_um)
    return ModemPlace(*here)


class CellGrid:
    """Nodes by square cells of `cell_um`: neighbours within that distance are in a node's own cell or the eight around."""

    def __init__(self, cell_um: int) -> None:
        self._cell_um = cell_um
        self._cells: dict[tuple[int, int], set[int]] = {}
        self._cell_of: dict[int, tuple[int, int]] = {}

    def put(self, node: int, place: ModemPlace) -> None:
        cell = self._cell(place)
        before = self._cell_of.get(node)
        if before == cell:
            return
        if before is not None:
            self._cells[before].discard(node)
        self._cell_of[node] = cell
        self._cells.setdefault(cell, set()).add(node)

    def remove(self, node: int) -> None:
        if (cell := self._cell_of.pop(node, None)) is not None:
            self._cells[cell].discard(node)

    def near(self, place: ModemPlace) -> Iterator[int]:
        """Every node within a cell's width of the place, and some beyond, in no order."""
        north, east = self._cell(place)
        for row in (north - 1, north, north + 1):
            for column in (east - 1, east, east + 1):
                yield from self._cells.get((row, column), ())

    def _cell(self, place: ModemPlace) -> tuple[int, int]:
        return place.north_um // self._cell_um, place.east_um // self._cell_um
