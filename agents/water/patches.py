"""Water that is not the same everywhere: layers, and patches that grow and move, such as a patch without oxygen.

Places are local NED in micrometres, times agent milliseconds, values in the unit of their quantity.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from agents.water.fields import Constant, Field
from firmware_model.sampling.sensors import SENSORS


@dataclass(frozen=True, slots=True)
class Layers:
    """Values at depths, as (um, value) going down: linear between them, constant beyond the ends."""

    points: tuple[tuple[int, float], ...]

    def value_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> float:
        above_um, above = self.points[0]
        for below_um, below in self.points:
            if depth_um <= below_um:
                if below_um == above_um:
                    return below
                return above + (below - above) * (depth_um - above_um) / (below_um - above_um)
            above_um, above = below_um, below
        return above


@dataclass(frozen=True, slots=True)
class WaterPatch:
    """A patch within which a quantity becomes `core`. From nothing at `begins_ms` it grows for `growing_ms` to
    `radius_um`. Its centre moves with (`north_um_s`, `east_um_s`), in seconds of agent time.

    Its share is 1 within half its present radius, and falls linearly to 0 at the radius. Above `from_depth_um` the share
    is 0.
    """

    core: float
    begins_ms: int
    growing_ms: int
    north_um: int
    east_um: int
    north_um_s: int
    east_um_s: int
    radius_um: int
    from_depth_um: int

    def share_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> float:
        """The patch's share at a place, 0 to 1."""
        elapsed_ms = now_ms - self.begins_ms
        if elapsed_ms <= 0 or depth_um < self.from_depth_um:
            return 0.0
        radius_um = self.radius_um * min(elapsed_ms, self.growing_ms) / self.growing_ms
        north = north_um - self.north_um - self.north_um_s * elapsed_ms // 1000
        east = east_um - self.east_um - self.east_um_s * elapsed_ms // 1000
        return min(1.0, max(0.0, 2 - 2 * sqrt(north * north + east * east) / radius_um))


@dataclass(frozen=True, slots=True)
class Patched:
    """A calm field with patches; later patches lie over earlier ones."""

    calm: Field
    patches: tuple[WaterPatch, ...]

    def value_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> float:
        value = self.calm.value_at(north_um, east_um, depth_um, now_ms)
        for patch in self.patches:
            value += (patch.core - value) * patch.share_at(north_um, east_um, depth_um, now_ms)
        return value


@dataclass(frozen=True, slots=True)
class QuantityWater:
    """One quantity's water as plain values that cross a link: layers (um, value), and patches."""

    layers: tuple[tuple[int, float], ...]
    patches: tuple[WaterPatch, ...] = ()

    def field(self) -> Field:
        calm: Field = Constant(self.layers[0][1]) if len(self.layers) == 1 else Layers(self.layers)
        return Patched(calm, self.patches) if self.patches else calm


CALM = {sensor.key: QuantityWater(((0, sensor.calm),)) for sensor in SENSORS if sensor.calm is not None}
"""A calm bay, by the sensors' keys: each quantity that does not follow from the depth."""
