"""Latitude and longitude to local north and east, and back.

The local plane touches the WGS-84 ellipsoid at the origin; a point of the sea's surface (height 0) is dropped on
to it along the origin's vertical. Nothing is linearised: `to_geographic` undoes `to_local` to a micrometre. What
remains is that a plane is no ellipsoid: a distance d along the surface comes out shorter by d^3 / (6 R^2), which
is 0.5 mm at 5 km. (Metres a degree, taken at the origin, would be 2.1 m off at 5 km north-east of Biograd.)
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, degrees, hypot, radians, remainder, sin, sqrt
from typing import Protocol

EQUATORIAL_RADIUS_M = 6378137.0  # WGS-84, a
FLATTENING = 1 / 298.257223563  # WGS-84, f
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)
FARTHEST_M = 50_000.0
"""From the origin: no aPad is sent farther, and no aMussel put."""

_CLOSE_ENOUGH_M = 1e-7
_ROUNDS = 20


class OriginLike(Protocol):
    """Anything that says where local (0, 0) lies, such as the scenario's `area.origin`."""

    @property
    def latitude_deg(self) -> float: ...

    @property
    def longitude_deg(self) -> float: ...


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """The local NED plane about an origin, in degrees. A pole has no north: |latitude| < 90."""

    latitude_deg: float
    longitude_deg: float

    def __post_init__(self) -> None:
        if not (-90 < self.latitude_deg < 90 and -180 <= self.longitude_deg <= 180):
            raise ValueError(f"no place for an origin: {self.latitude_deg}, {self.longitude_deg}")

    @classmethod
    def about(cls, origin: OriginLike) -> LocalFrame:
        return cls(origin.latitude_deg, origin.longitude_deg)

    def to_local(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """(north_m, east_m) of a point of the surface. ValueError if the point is no latitude and
        longitude.
        """
        if not (-90 <= latitude_deg <= 90 and -180 <= longitude_deg <= 360):
            raise ValueError(f"no latitude and longitude in degrees: {latitude_deg}, {longitude_deg}")
        here, there = radians(self.latitude_deg), radians(latitude_deg)
        turn = radians(longitude_deg - self.longitude_deg)
        # Along the axis of the earth, and out from it in the origin's meridian and across it (metres).
        out, axial = _meridian_point_m(there)
        out_here, axial_here = _meridian_point_m(here)
        along, east_m = out * cos(turn) - out_here, out * sin(turn)
        north_m = cos(here) * (axial - axial_here) - sin(here) * along
        return north_m, east_m

    def to_geographic(self, north_m: float, east_m: float) -> tuple[float, float]:
        """(latitude_deg, longitude_deg) of the surface under a local point, longitude in [-180, 180].

        ValueError if the point lies so far out (thousands of kilometres) that there is no surface under it.
        """
        latitude, longitude = self.latitude_deg, self.longitude_deg
        for _ in range(_ROUNDS):
            if not -90 <= latitude <= 90:
                break
            north, east = self.to_local(latitude, remainder(longitude, 360.0))
            missing_north, missing_east = north_m - north, east_m - east
            if hypot(missing_north, missing_east) < _CLOSE_ENOUGH_M:
                return latitude, remainder(longitude, 360.0)
            meridian_m, parallel_m = _radii_m(radians(latitude))
            latitude += degrees(missing_north / meridian_m)
            longitude += degrees(missing_east / parallel_m)
        raise ValueError(f"too far from the origin for a local plane: north {north_m} m, east {east_m} m")


def _meridian_point_m(latitude: float) -> tuple[float, float]:
    """Distance from the earth's axis, and height above the equator's plane, of a surface point (metres)."""
    prime_vertical = EQUATORIAL_RADIUS_M / sqrt(1 - ECCENTRICITY_2 * sin(latitude) ** 2)
    return prime_vertical * cos(latitude), prime_vertical * (1 - ECCENTRICITY_2) * sin(latitude)


def _radii_m(latitude: float) -> tuple[float, float]:
    """Radius of curvature along the meridian, and radius of the parallel: metres a radian of each angle."""
    bend = 1 - ECCENTRICITY_2 * sin(latitude) ** 2
    meridian = EQUATORIAL_RADIUS_M * (1 - ECCENTRICITY_2) / bend**1.5
    return meridian, EQUATORIAL_RADIUS_M / sqrt(bend) * cos(latitude)
