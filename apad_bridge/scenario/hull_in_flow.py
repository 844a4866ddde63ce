"""Current and wind on the aPad's hull: the flow at the surface, the hull's speed in it, and the legs that it cannot make.

The flow is that of the scenario's one sea, which also carries the aMussels. The hull is one of quadratic drag in water and
in air. Places and velocities are (north, east) in metres and m/s over ground; a wind is told by where it blows to.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from agents.water.water_current import CurrentConfig, TideConstituent, WaterCurrent
from apad_bridge.scenario.area.local_frame import LocalFrame
from apad_bridge.scenario.schema import APad, Scenario
from apad_bridge.scenario.water.currents import current_text, steady_text
from apad_bridge.scenario.water.water_options import Current

Vector = tuple[float, float]
LEAST_M_S = 0.5 / 60
"""Slower ways over ground count as none: the docking port takes less than half a metre a minute for a stall."""
_LOOKED_M = 25.0
"""The current is looked at so often along a leg."""
_LOOKED_S = 600.0
"""It is looked at so often in a mission, before the flight."""
_MOST_LOOKS = 1000
_LEG_S = 2.5
"""Time of a leg beyond its way at full speed: to accelerate, to brake, and to be sure of the arrival."""
_THRUSTERS = 2
"""Along a diagonal of the hull, which is the weakest direction, two of the four thrusters push."""


@dataclass(frozen=True, slots=True)
class SurfaceFlow:
    """The water and the air at one place and time."""

    current_m_s: Vector
    wind_m_s: Vector | None = None
    """None without a wind: then the model leaves out the air, as it does in calm water."""


class Surface:
    """The flow at the surface, in mission time."""

    def __init__(self, stream: WaterCurrent, wind_m_s: Vector | None = None, leeway: float = 0.0) -> None:
        """`leeway` is the share of the wind with which an aMussel at the surface goes."""
        self._stream = stream
        self._wind_m_s = wind_m_s
        north_m_s, east_m_s = wind_m_s or (0.0, 0.0)
        self._leeway_m_s = leeway * north_m_s, leeway * east_m_s

    def flow(self, place_m: Vector, at_ms: int) -> SurfaceFlow:
        """The current is that of the mission second, as for an aMussel that floats there."""
        north_um, east_um = (round(it * 1e6) for it in place_m)
        north_um_s, east_um_s = self._stream.velocity_um_s(north_um, east_um, 0, at_ms // 1000)
        return SurfaceFlow((north_um_s / 1e6, east_um_s / 1e6), self._wind_m_s)

    def of_float_m_s(self, place_m: Vector, at_ms: int) -> Vector:
        """The velocity of an aMussel that floats there."""
        north_m_s, east_m_s = self.flow(place_m, at_ms).current_m_s
        return north_m_s + self._leeway_m_s[0], east_m_s + self._leeway_m_s[1]


def current_config(scenario: Scenario) -> CurrentConfig:
    """Converts the scenario's current, and reads its file. OSError, or ValueError for a file that is no current."""
    current = Current() if scenario.water is None else scenario.water.current or Current()
    return CurrentConfig(
        _field_text(scenario, current),
        tuple(
            TideConstituent(
                round(tide.period_h * 3600),
                round(tide.north_m_s * 1e6),
                round(tide.east_m_s * 1e6),
                round(tide.north_phase_deg / 360 * 1e6),
                round(tide.east_phase_deg / 360 * 1e6),
            )
            for tide in current.tides
        ),
        tuple((round(depth * 1e6), round(fraction * 1e6)) for depth, fraction in current.profile),
    )


def _field_text(scenario: Scenario, current: Current) -> str | None:
    """CSV of the current's field, without tides and profile; None where there is no such field."""
    drift = scenario.fleet.drift
    steady_m_s = drift.current_m_s or current.steady_m_s
    if steady_m_s is not None:
        return steady_text(*steady_m_s)
    name = drift.current_file or current.file
    return None if name is None else current_text(Path(name), LocalFrame.about(scenario.area.origin))


def surface_of(scenario: Scenario) -> Surface | None:
    """Builds the flow that pushes the scenario's aPad; None in calm water without wind. Raises as `current_config`."""
    stream = current_config(scenario).water_current()
    wind = None if scenario.water is None else scenario.water.wind
    if wind is None or not (wind.north_m_s or wind.east_m_s):
        return None if stream.is_still else Surface(stream)
    return Surface(stream, (wind.north_m_s, wind.east_m_s), wind.leeway)


def weakest_force_n(apad: APad) -> float:
    """The thrusters' force that is available in every direction."""
    return _THRUSTERS * apad.thruster_max_n


def top_speed_m_s(apad: APad, wind_n: float = 0.0) -> float:
    """The highest speed through the water in every direction, when the wind takes so much of the thrust."""
    force_n, drag = max(0.0, weakest_force_n(apad) - wind_n), apad.drag_n_per_m2_s2
    return min(apad.max_speed_m_s, math.sqrt(force_n / drag)) if drag else apad.max_speed_m_s


def resistance_n(apad: APad, flow: SurfaceFlow, velocity_m_s: Vector) -> Vector:
    """The force (north, east) that keeps the hull at a velocity over ground: D |v - u| (v - u) - W |w - v| (w - v).

    u is the current's and w the wind's velocity, D the drag in water (`drag_n_per_m2_s2`) and W the one in air.
    """
    water = _less(velocity_m_s, flow.current_m_s)
    in_water = apad.drag_n_per_m2_s2 * math.hypot(*water)
    if flow.wind_m_s is None:
        return in_water * water[0], in_water * water[1]
    air = _less(flow.wind_m_s, velocity_m_s)
    in_air = apad.wind_n_per_m2_s2 * math.hypot(*air)
    return in_water * water[0] - in_air * air[0], in_water * water[1] - in_air * air[1]


def holding_effort(apad: APad, flow: SurfaceFlow) -> float:
    """The part of the thrust that holding a place takes, in [0, 1]; at 1 the flow takes the hull away."""
    return min(1.0, math.hypot(*resistance_n(apad, flow, (0.0, 0.0))) / weakest_force_n(apad))


def free_drift_m_s(apad: APad, flow: SurfaceFlow) -> Vector:
    """The velocity of the hull without thrust, at which D |e - u| (e - u) = W |w - e| (w - e).

    Both sides have one direction, so e = (u + k w) / (1 + k) with k = sqrt(W / D): k is about the hull's leeway. A hull
    without drag in the water stays where it is, as nothing in the model would stop it.
    """
    if not apad.drag_n_per_m2_s2:
        return 0.0, 0.0
    if flow.wind_m_s is None:
        return flow.current_m_s
    k = math.sqrt(apad.wind_n_per_m2_s2 / apad.drag_n_per_m2_s2)
    (north, east), (wind_north, wind_east) = flow.current_m_s, flow.wind_m_s
    return (north + k * wind_north) / (1 + k), (east + k * wind_east) / (1 + k)


def made_good_m_s(apad: APad, flow: SurfaceFlow, towards: Vector) -> float:
    """The highest speed over ground along the direction `towards` (a unit vector); 0 or less where there is none.

    With a speed V through the water the hull makes u_along + sqrt(V^2 - u_across^2). The wind on the hull at rest takes
    its part of the thrust in every direction, which is a little too much before the wind.
    """
    wind_only = resistance_n(apad, SurfaceFlow((0.0, 0.0), flow.wind_m_s), (0.0, 0.0))
    through_m_s = top_speed_m_s(apad, math.hypot(*wind_only))
    if not apad.drag_n_per_m2_s2:
        return through_m_s
    north, east = flow.current_m_s
    along, across = north * towards[0] + east * towards[1], east * towards[0] - north * towards[1]
    left = through_m_s**2 - across**2
    return along + math.sqrt(left) if left >= 0 else 0.0


class FlowNow:
    """Straight legs in the flow of one time, as a planner weighs them (`planning/candidates.py`, `LegCosts`).

    On each stretch of a leg the aPad makes its ordered speed, or what the flow leaves of it. The thrusters' power
    grows with the force, so a metre takes the force on the hull over its speed, and in calm water D v at the ordered one.
    """

    def __init__(self, apad: APad, surface: Surface, at_ms: int, speed_m_s: float) -> None:
        self._apad = apad
        self._surface = surface
        self._at_ms = at_ms
        self._speed_m_s = speed_m_s
        self._leg = cache(self._looked_at)

    def metres(self, from_m: Vector, to_m: Vector) -> float:
        return self._leg(from_m, to_m)[0]

    def seconds(self, from_m: Vector, to_m: Vector) -> float:
        return self._leg(from_m, to_m)[1]

    def _looked_at(self, from_m: Vector, to_m: Vector) -> tuple[float, float]:
        """(metres, seconds) of a leg, with the mean of its points."""
        if not (length_m := math.dist(from_m, to_m)):
            return 0.0, 0.0
        towards = _less(to_m, from_m)
        towards = towards[0] / length_m, towards[1] / length_m
        thrust: list[float] = []
        s_per_m: list[float] = []
        for place_m in _along(from_m, to_m, length_m):
            flow = self._surface.flow(place_m, self._at_ms)
            good_m_s = max(LEAST_M_S, min(self._speed_m_s, made_good_m_s(self._apad, flow, towards)))
            over_ground = good_m_s * towards[0], good_m_s * towards[1]
            thrust.append(math.hypot(*resistance_n(self._apad, flow, over_ground)) / good_m_s)
            s_per_m.append(1 / good_m_s)
        calm = self._apad.drag_n_per_m2_s2 * self._speed_m_s
        effort = math.fsum(thrust) / len(thrust) / calm if calm else 1.0
        return length_m * effort, length_m * math.fsum(s_per_m) / len(s_per_m)


class LegForecast:
    """Foretells legs by the flow that the scenario states: those that the aPad cannot make, and where it meets a float."""

    def __init__(self, apad: APad, surface: Surface | None) -> None:
        self._apad = apad
        self._surface = surface

    @property
    def is_calm(self) -> bool:
        """True where every leg can be made."""
        return self._surface is None

    def obstacle(self, from_m: Vector, to_m: Vector, at_ms: int) -> str | None:
        """The reason why the leg cannot be made with the flow of that time; None if it can."""
        length_m = math.dist(from_m, to_m)
        if self._surface is None or length_m == 0:
            return None
        towards = _less(to_m, from_m)
        towards = towards[0] / length_m, towards[1] / length_m
        for place_m in _along(from_m, to_m, length_m):
            flow = self._surface.flow(place_m, at_ms)
            if made_good_m_s(self._apad, flow, towards) < LEAST_M_S:
                return (
                    f"the aPad makes no way against {_flow_text(flow)} at ({place_m[0]:.0f}, {place_m[1]:.0f}) m: "
                    f"its top speed through the water is {top_speed_m_s(self._apad):.2f} m/s"
                )
        return None

    def at(self, at_ms: int, speed_m_s: float) -> FlowNow | None:
        """The flow at a decision's time, for a planner whose go-tos have this speed over ground; None in calm water."""
        return None if self._surface is None else FlowNow(self._apad, self._surface, at_ms, speed_m_s)

    def meeting_m(self, from_m: Vector, place_m: Vector, speed_m_s: float, at_ms: int) -> Vector | None:
        """The place to which an aMussel floats from `place_m` until an aPad of this speed over ground is there.

        With the way d to it and its velocity f, both meet after T at |d + f T| = speed (T - leg time). None if it floats
        away as fast as the aPad comes.
        """
        if self._surface is None:
            return place_m
        d_north, d_east = _less(place_m, from_m)
        f_north, f_east = self._surface.of_float_m_s(place_m, at_ms)
        two = f_north**2 + f_east**2 - speed_m_s**2
        one = d_north * f_north + d_east * f_east + speed_m_s**2 * _LEG_S
        none = d_north**2 + d_east**2 - (speed_m_s * _LEG_S) ** 2
        root = one**2 - two * none
        times_s = [-none / (2 * one)] if not two and one else []
        if two and root >= 0:
            times_s = [(-one + sign * math.sqrt(root)) / two for sign in (-1, 1)]
        if not (later_s := [it for it in times_s if it >= _LEG_S]):
            # The aMussel is so near that the leg is nothing but its start and its end.
            return (place_m[0] + _LEG_S * f_north, place_m[1] + _LEG_S * f_east) if none <= 0 else None
        takes_s = min(later_s)
        return place_m[0] + takes_s * f_north, place_m[1] + takes_s * f_east

    def bar_to_float(self, from_m: Vector, place_m: Vector, speed_m_s: float, at_ms: int) -> str | None:
        """The reason why the aPad cannot collect an aMussel at `place_m`, which comes up on the way; None if it can."""
        if self._surface is None:
            return None
        if (meeting_m := self.meeting_m(from_m, place_m, speed_m_s, at_ms)) is not None:
            return self.obstacle(from_m, meeting_m, at_ms)
        float_m_s = math.hypot(*self._surface.of_float_m_s(place_m, at_ms))
        return f"it would float away with {float_m_s:.2f} m/s, and the aPad goes after it with {speed_m_s:.2f} m/s"


def strongest_flow(scenario: Scenario, surface: Surface) -> tuple[SurfaceFlow, Vector, int]:
    """(flow, place, mission ms) where holding takes most, of the area's corners and the start, through the mission."""
    places = [scenario.apad.start_m, *scenario.area.polygon_m]
    looks = min(_MOST_LOOKS, max(1, math.ceil(scenario.duration_s / _LOOKED_S) + 1))
    times_ms = [round(1000 * scenario.duration_s * n / max(1, looks - 1)) for n in range(looks)]
    found = ((surface.flow(place, at_ms), place, at_ms) for at_ms in times_ms for place in places)
    return max(found, key=lambda it: math.hypot(*resistance_n(scenario.apad, it[0], (0.0, 0.0))))


def fastest_drift_m_s(scenario: Scenario) -> float:
    """The speed with which the known sea takes a hull without thrust, where and when holding takes most."""
    if (surface := surface_of(scenario)) is None:
        return 0.0
    flow, _, _ = strongest_flow(scenario, surface)
    return math.hypot(*free_drift_m_s(scenario.apad, flow))


def hardest_metre(scenario: Scenario) -> tuple[Vector, Vector, int]:
    """(begin, end, mission ms) of a metre against the drift, where and when holding takes most; any metre in calm water."""
    surface, place_m, at_ms = surface_of(scenario), scenario.apad.start_m, 0
    north, east = 1.0, 0.0
    if surface is not None:
        flow, place_m, at_ms = strongest_flow(scenario, surface)
        drift = free_drift_m_s(scenario.apad, flow)
        if drift_m_s := math.hypot(*drift):
            north, east = -drift[0] / drift_m_s, -drift[1] / drift_m_s
    return place_m, (place_m[0] + north, place_m[1] + east), at_ms


def doubt_about_legs(scenario: Scenario) -> str | None:
    """One sentence where the sea is stronger than the aPad at some time of the mission; None if it always makes way."""
    if (surface := surface_of(scenario)) is None:
        return None
    flow, place_m, at_ms = strongest_flow(scenario, surface)
    force_n = math.hypot(*resistance_n(scenario.apad, flow, (0.0, 0.0)))
    towards = free_drift_m_s(scenario.apad, flow)
    if not (speed_m_s := math.hypot(*towards)):
        return None
    against = -towards[0] / speed_m_s, -towards[1] / speed_m_s
    if made_good_m_s(scenario.apad, flow, against) >= LEAST_M_S and force_n < weakest_force_n(scenario.apad):
        return None
    return (
        f"the aPad cannot make every leg: at {at_ms / 1000:.0f} s it makes no way against {_flow_text(flow)} at "
        f"({place_m[0]:.0f}, {place_m[1]:.0f}) m"
    )


def _flow_text(flow: SurfaceFlow) -> str:
    texts = [f"a current of {math.hypot(*flow.current_m_s):.2f} m/s"] if any(flow.current_m_s) else []
    texts += [] if flow.wind_m_s is None else [f"a wind of {math.hypot(*flow.wind_m_s):.1f} m/s"]
    return " and ".join(texts)


def _along(from_m: Vector, to_m: Vector, length_m: float) -> Iterator[Vector]:
    parts = max(1, math.ceil(length_m / _LOOKED_M))
    for n in range(parts + 1):
        share = n / parts
        yield from_m[0] + share * (to_m[0] - from_m[0]), from_m[1] + share * (to_m[1] - from_m[1])


def _less(one: Vector, other: Vector) -> Vector:
    return one[0] - other[0], one[1] - other[1]
