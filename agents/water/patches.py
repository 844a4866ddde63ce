"""Water that is not the same everywhere: layers, and patches that grow and wander, as one without oxygen does.

Places are local NED in micrometres, times agent milliseconds, values in the unit of their quantity.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from agents.water.fields import Constant, Field


@dataclass(frozen=True, slots=True)
class Layers:
    """Values at depths, (um, value) going down; linear between, beyond the ends as there."""

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
class Patch:
    """A patch within which a quantity becomes `core`: from nothing at `begins_ms` it grows for `growing_ms` to
    `radius_um`, and its centre wanders with (`north_um_s`, `east_um_s`), seconds being agent time.

    Within half its radius at the time it is all there, from there outwards less, linearly, and at the radius nothing.
    Upwards from `from_depth_um` there is nothing of it.
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
        """How much of it there is, 0 to 1."""
        elapsed_ms = now_ms - self.begins_ms
        if elapsed_ms <= 0 or depth_um < self.from_depth_um:
            return 0.0
        radius_um = self.radius_um * min(elapsed_ms, self.growing_ms) / self.growing_ms
        north = north_um - self.north_um - self.north_um_s * elapsed_ms // 1000
        east = east_um - self.east_um - self.east_um_s * elapsed_ms // 1000
        return min(1.0, max(0.0, 2 - 2 * sqrt(north * north + east * east) / radius_um))


@dataclass(frozen=True, slots=True)
class Patched:
    """A calm field and patches in it, the later over the earlier."""

    calm: Field
    patches: tuple[Patch, ...]

    def value_at(self, north_um: int, east_um: int, depth_um: int, now_ms: int) -> float:
        value = self.calm.value_at(north_um, east_um, depth_um, now_ms)
        for patch in self.patches:
            value += (patch.core - value) * patch.share_at(north_um, east_um, depth_um, now_ms)
        return value


@dataclass(frozen=True, slots=True)
class Waters:
    """One quantity's water as plain values, to cross a link: layers (um, value), and patches as a `Patch` has them."""

    layers: tuple[tuple[int, float], ...]
    patches: tuple[tuple[float, int, int, int, int, int, int, int, int], ...] = ()

    def field(self) -> Field:
        calm: Field = Constant(self.layers[0][1]) if len(self.layers) == 1 else Layers(self.layers)
        if not self.patches:
            return calm
        return Patched(calm, tuple([Patch(*it) for it in self.patches]))


OXYGEN, TEMPERATURE, TURBIDITY = (Waters(((0, value),)) for value in (8.0, 18.0, 5.0))
"""A calm bay, where nothing else is said: mg/l, degrees Celsius, NTU."""
