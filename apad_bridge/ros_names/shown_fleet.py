"""The fleet as ROS's standard messages show it, alike on ROS 1 and ROS 2. Numbers are those of the definitions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

from apad_bridge.beliefs.modes import DOCKED, Mode
from apad_bridge.ros_names.frames import UPRIGHT, Quaternion, Vector, ellipse_95, enu
from apad_bridge.scenario.area.polygon import bounding_box
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.scenario.schema import Area
from firmware_model.power.charge import volts
from firmware_model.state_groups import BEYOND_HELP, STRANDED
from firmware_model.states import State

LIPO = 3
"""BatteryState's technology."""
_TRACK_STEP_M = 0.5
"""The distance between points of the aPad's track ..."""
_TRACK_POINTS = 2000
"""... and their number: the latest kilometre."""
_SMALLEST_BALL_M = 0.5
_BALLS_ACROSS = 100
"""The area is as long as so many balls side by side: seen from above, each is some pixels wide on a common screen."""
_LABEL = 1.2
"""The height of a label, and its distance north of the ball, in diameters of the ball."""
_DISC_M = 0.02
"""A disc's thickness, and its least width: RViz does not draw a scale of 0."""
_DISC_ALPHA = 0.3

PlaceM = tuple[float, float]
"""(north, east) of the scenario's origin."""
Colour = tuple[float, float, float, float]
"""Red, green, blue and alpha."""
_WHITE: Colour = (1.0, 1.0, 1.0, 1.0)
_AMBER: Colour = (1.0, 0.8, 0.0, 1.0)
_CYAN: Colour = (0.0, 0.8, 0.9, 1.0)
_GREY: Colour = (0.4, 0.4, 0.4, 1.0)


class SupplyStatus(IntEnum):
    """BatteryState's status."""

    CHARGING = 1
    DISCHARGING = 2
    FULL = 4


class BatteryHealth(IntEnum):
    """BatteryState's health."""

    GOOD = 1
    DEAD = 3


class DiagnosticLevel(IntEnum):
    """DiagnosticStatus's level."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class MarkerKind(IntEnum):
    """Marker's type."""

    ARROW = 0
    SPHERE = 2
    CYLINDER = 3
    TEXT = 9


@dataclass(frozen=True, slots=True)
class MarkerShape:
    """A part of the picture, in ENU and metres. Its group and number tell it from all others."""

    group: str
    number: int
    kind: MarkerKind
    at: Vector
    size_m: Vector
    colour: Colour
    attitude: Quaternion = UPRIGHT
    text: str = ""


@dataclass(frozen=True, slots=True)
class ShownAMussel:
    """A belief. The charges are the paper's scaled voltage in [0, 1]."""

    agent_id: int
    state: State
    """The state of its newest packet."""
    mode: Mode
    charge: float
    secondary: float
    place_m: PlaceM
    depth_m: float
    place_cov: Vector | None
    """Variance north, covariance, variance east, in square metres; None where it is not known."""
    heard_ms: int
    """The mission time of the newest packet ..."""
    at_ms: int
    """... and the one for which it is believed."""
    is_docked: bool

    @property
    def cells_v(self) -> list[float]:
        """The voltages of the primary and the secondary battery on the paper's scale."""
        return [volts(self.charge), volts(self.secondary)]

    @property
    def supply_status(self) -> SupplyStatus:
        if self.mode is Mode.FULL:
            return SupplyStatus.FULL
        return SupplyStatus.CHARGING if self.mode in DOCKED else SupplyStatus.DISCHARGING

    @property
    def health(self) -> BatteryHealth:
        is_dead = self.state in BEYOND_HELP or self.charge <= 0.0
        return BatteryHealth.DEAD if is_dead else BatteryHealth.GOOD

    @property
    def colour(self) -> Colour:
        """From red, empty, to green, full; cyan in a dock, grey when lost."""
        if self.state in BEYOND_HELP:
            return _GREY
        return _CYAN if self.is_docked else (1.0 - self.charge, self.charge, 0.1, 1.0)

    def condition(self, now_ms: int, rules: Mission) -> tuple[DiagnosticLevel, str]:
        silent_s = (now_ms - self.heard_ms) / 1000
        if self.state in BEYOND_HELP:
            return DiagnosticLevel.ERROR, "lost: both batteries are empty"
        if self.state in STRANDED or self.charge <= 0.0:
            return DiagnosticLevel.ERROR, "its primary battery is empty"
        if silent_s > rules.silence_timeout_s:
            return DiagnosticLevel.STALE, f"silent for {silent_s:.0f} s"
        if self.charge <= rules.pool_threshold:
            return DiagnosticLevel.WARN, f"wants charging: {100 * self.charge:.0f} %"
        return DiagnosticLevel.OK, f"{100 * self.charge:.0f} %"

    def shapes(self, ball_m: float, row: int) -> Iterator[MarkerShape]:
        """A ball, its id and charge above it, and the ellipse that contains the place with 95 %, where that is known.

        Labels of aMussels at one place, in an aPad's docks, have a `row` each, from 0 on.
        """
        at, colour, label_m = enu(*self.place_m), self.colour, _LABEL * ball_m
        yield MarkerShape("amussels", self.agent_id, MarkerKind.SPHERE, at, _cube(ball_m), colour)
        # North of the ball, so that it is legible from above too.
        above = (at[0], at[1] + (1 + row) * label_m, at[2] + label_m)
        text = f"{self.agent_id}: {100 * self.charge:.0f} %"
        yield MarkerShape("labels", self.agent_id, MarkerKind.TEXT, above, _cube(label_m), _WHITE, text=text)
        if self.place_cov is not None:
            disc = ellipse_95(self.place_cov)
            size_m = (max(disc.length_m, _DISC_M), max(disc.width_m, _DISC_M), _DISC_M)
            clear = (*colour[:3], _DISC_ALPHA)
            yield MarkerShape(
                group="place_95",
                number=self.agent_id,
                kind=MarkerKind.CYLINDER,
                at=at,
                size_m=size_m,
                colour=clear,
                attitude=disc.attitude,
            )


def condition_of(it: ShownAMussel | None, now_ms: int, rules: Mission) -> tuple[DiagnosticLevel, str]:
    """The level and the message of an aMussel; None was never heard."""
    return (DiagnosticLevel.STALE, "no report yet") if it is None else it.condition(now_ms, rules)


def apad_shape(at: Vector, attitude: Quaternion, ball_m: float) -> MarkerShape:
    """An arrow along its heading, three balls long."""
    size_m = (3 * ball_m, 0.6 * ball_m, 0.6 * ball_m)
    return MarkerShape(
        group="apad", number=0, kind=MarkerKind.ARROW, at=at, size_m=size_m, colour=_AMBER, attitude=attitude
    )


def ball_size_m(area: Area) -> float:
    """The diameter of an aMussel's ball, much larger than the aMussel itself so that it is visible in the area."""
    (south, west), (north, east) = bounding_box(area.polygon_m)
    return max(_SMALLEST_BALL_M, max(north - south, east - west) / _BALLS_ACROSS)


class APadTrack:
    """The aPad's places so far, some way apart."""

    def __init__(self) -> None:
        self.points_m: list[PlaceM] = []

    def extend(self, place_m: PlaceM) -> None:
        if not self.points_m or math.dist(self.points_m[-1], place_m) >= _TRACK_STEP_M:
            self.points_m = [*self.points_m[1 - _TRACK_POINTS :], place_m]


def place_matrix(place_cov: Vector | None, size: int) -> list[float]:
    """A square covariance matrix of so many rows, row by row from east and north on; 0 where nothing is known."""
    matrix = [0.0] * size**2
    if place_cov is not None:
        north, between, east = place_cov
        matrix[0], matrix[1], matrix[size], matrix[size + 1] = east, between, between, north
    return matrix


def _cube(size_m: float) -> Vector:
    return size_m, size_m, size_m
