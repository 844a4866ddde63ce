"""What a layout shows: a scenario's aPads, whom each serves at first, the names of their topics, and the area."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass

from apad_bridge.scenario.polygon import bounding_box
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start
from apad_bridge.squad.members import members

_GOLDEN = 0.618033988749895
"""Hues so far apart on the circle of 1 stay apart however many there are."""


@dataclass(frozen=True, slots=True)
class APadShown:
    """An aPad and the aMussels that it serves at first. `below` is the name under which what is of it alone stands."""

    name: str
    below: str
    ids: tuple[int, ...]

    def topic(self, name: str) -> str:
        return f"{self.below}/{name}"


@dataclass(frozen=True, slots=True)
class FleetShown:
    """Bounds of the area are (north, east) metres, as are all places in a scenario."""

    name: str
    namespace: str
    apads: tuple[APadShown, ...]
    south_west_m: tuple[float, float]
    north_east_m: tuple[float, float]
    duration_s: float

    @property
    def ids(self) -> tuple[int, ...]:
        """Of all aMussels, rising."""
        return tuple(sorted(agent_id for apad in self.apads for agent_id in apad.ids))

    @property
    def centre_m(self) -> tuple[float, float]:
        (south, west), (north, east) = self.south_west_m, self.north_east_m
        return (south + north) / 2, (west + east) / 2

    @property
    def span_m(self) -> tuple[float, float]:
        (south, west), (north, east) = self.south_west_m, self.north_east_m
        return north - south, east - west

    def agent_topic(self, agent_id: int, name: str) -> str:
        return f"{self.namespace}/amussel{agent_id}/{name}"

    def batteries(self, apad: APadShown) -> dict[int, str]:
        """The topic of each battery of the aMussels that this aPad serves at first, by id."""
        return {agent_id: self.agent_topic(agent_id, "battery_state") for agent_id in apad.ids}


def shown(scenario: Scenario, starts: Sequence[Start], namespace: str = "") -> FleetShown:
    """`namespace` is empty, or a name of ROS with its leading slash and none at its end."""
    alone = not scenario.apads and not scenario.fleet.share
    apads = [
        APadShown(
            member.name,
            f"{namespace}/musselbed" if alone else f"{namespace}/musselbed/{member.name}",
            tuple(start.agent_id for start in member.starts),
        )
        for member in members(scenario, starts)
    ]
    south_west, north_east = bounding_box(scenario.area.polygon_m)
    return FleetShown(scenario.name, namespace, tuple(apads), south_west, north_east, scenario.duration_s)


def colour(number: int) -> tuple[int, int, int]:
    """Red, green and blue in [0, 255] of the curve or line of this number: neighbours differ."""
    red, green, blue = colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.65, 0.95)
    return round(255 * red), round(255 * green), round(255 * blue)


def hexadecimal(number: int) -> str:
    """The same as #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*colour(number))
