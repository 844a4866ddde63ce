"""The content of a layout: a scenario's aPads with their aMussels and topics, the area, and the grid on the water."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass

from apad_bridge.assembly.division import members
from apad_bridge.ros_names.frames import Frames
from apad_bridge.ros_names.names import below_apad, is_one_of_several, of_amussel, ours
from apad_bridge.scenario.area.polygon import bounding_box
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts_table import Start

_GOLDEN = 0.618033988749895
"""The step between hues on the circle of 1: any number of hues stay apart."""
_MOST_CELLS = 80
"""The most cells; a larger area gets the next coarser cell."""
_CELLS_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


@dataclass(frozen=True, slots=True)
class LayoutAPad:
    """An aPad and the aMussels that it serves at first."""

    name: str
    namespace: str
    ids: tuple[int, ...]
    is_one_of_several: bool

    def topic(self, leaf: str) -> str:
        """The full name of a topic of this aPad alone, from its name below `musselbed`."""
        name = ours(leaf)
        return f"{self.namespace}/{below_apad(name, self.name) if self.is_one_of_several else name}"


@dataclass(frozen=True, slots=True)
class LayoutFleet:
    """A scenario's fleet. The area's bounds are (north, east) metres, like all places in a scenario."""

    name: str
    namespace: str
    apads: tuple[LayoutAPad, ...]
    south_west_m: tuple[float, float]
    north_east_m: tuple[float, float]

    @property
    def ids(self) -> tuple[int, ...]:
        """The ids of all aMussels, in rising order."""
        return tuple(sorted(agent_id for apad in self.apads for agent_id in apad.ids))

    @property
    def centre_m(self) -> tuple[float, float]:
        (south, west), (north, east) = self.south_west_m, self.north_east_m
        return (south + north) / 2, (west + east) / 2

    @property
    def span_m(self) -> tuple[float, float]:
        (south, west), (north, east) = self.south_west_m, self.north_east_m
        return north - south, east - west

    @property
    def frames(self) -> Frames:
        return Frames(self.namespace.strip("/"))

    def batteries(self, apad: LayoutAPad) -> dict[int, str]:
        """The battery topics of the aMussels that this aPad serves at first, by id."""
        return {
            agent_id: f"{self.namespace}/{of_amussel(agent_id, 'battery_state')}" for agent_id in apad.ids
        }


def layout_fleet(scenario: Scenario, starts: Sequence[Start], namespace: str = "") -> LayoutFleet:
    """A scenario's fleet for a layout. `namespace` is empty, or a ROS name with a leading slash and none at its end."""
    apads = [
        LayoutAPad(
            member.name,
            namespace,
            tuple(start.agent_id for start in member.starts),
            is_one_of_several=is_one_of_several(scenario),
        )
        for member in members(scenario, starts)
    ]
    south_west, north_east = bounding_box(scenario.area.polygon_m)
    return LayoutFleet(scenario.name, namespace, tuple(apads), south_west, north_east)


def in_bag(leaf: str) -> str:
    """The name of a topic in a run's bag, which does not depend on the names on the graph."""
    return f"/{ours(leaf)}"


def colour(number: int) -> tuple[int, int, int]:
    """Red, green and blue in [0, 255] for the curve or line of this number; neighbours differ."""
    red, green, blue = colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.65, 0.95)
    return round(255 * red), round(255 * green), round(255 * blue)


def hexadecimal(number: int) -> str:
    """The colour of this number as #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*colour(number))


@dataclass(frozen=True, slots=True)
class FloorGrid:
    """A grid of `cells` each way, an even number, about a centre where lines cross."""

    cell_m: int
    cells: int
    north_m: int
    east_m: int


def grid_of(fleet: LayoutFleet) -> FloorGrid:
    reach_m = 2 * max(*fleet.span_m, 1.0)
    cell_m = next((it for it in _CELLS_M if reach_m / it <= _MOST_CELLS), _CELLS_M[-1])
    north_m, east_m = (cell_m * round(it / cell_m) for it in fleet.centre_m)
    return FloorGrid(cell_m, 2 * round(reach_m / cell_m / 2), north_m, east_m)
