"""Converts latitude and longitude to local north and east, and back.

The local plane touches the WGS-84 ellipsoid at the origin. A point of the sea's surface (height 0) is projected on
to it along the origin's vertical. Nothing is linearised: `to_geographic` undoes `to_local` to a micrometre. The
remaining error is the plane's: a distance d along the surface comes out shorter by d^3 / (6 R^2), which is 0.5 mm
at 5 km. (Metres per degree, taken at the origin, would be 2.1 m off at 5 km north-east of Biograd.)
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, degrees, hypot, radians, remainder, sin, sqrt
from typing import Protocol

EQUATORIAL_RADIUS_M = 6378137.0  # WGS-84, a
FLATTENING = 1 / 298.257223563  # WGS-84, f
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)

_CLOSE_ENOUGH_M = 1e-7
_ROUNDS = 20


class OriginLike(Protocol):
    """Any object with the geographic position of local (0, 0), such as the scenario's `area.origin`."""

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
        """Returns (north_m, east_m) of a point of the surface. Raises ValueError for an impossible position."""
        if not (-90 <= latitude_deg <= 90 and -180 <= longitude_deg <= 360):
            raise ValueError(f"no latitude and longitude in degrees: {latitude_deg}, {longitude_deg}")
        origin_latitude, latitude = radians(self.latitude_deg), radians(latitude_deg)
        turn = radians(longitude_deg - self.longitude_deg)
        # Metres: along the earth's axis, and out from it in the origin's meridian and across it.
        radial, axial = _meridian_point_m(latitude)
        origin_radial, origin_axial = _meridian_point_m(origin_latitude)
        outward, east_m = radial * cos(turn) - origin_radial, radial * sin(turn)
        north_m = cos(origin_latitude) * (axial - origin_axial) - sin(origin_latitude) * outward
        return north_m, east_m

    def to_geographic(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Returns (latitude_deg, longitude_deg) of the surface under a local point, longitude in [-180, 180].

        Raises ValueError if the point lies so far out (thousands of kilometres) that there is no surface under it.
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
    """Returns a surface point's distance from the earth's axis and height above the equator's plane (metres)."""
    prime_vertical = EQUATORIAL_RADIUS_M / sqrt(1 - ECCENTRICITY_2 * sin(latitude) ** 2)
    return prime_vertical * cos(latitude), prime_vertical * (1 - ECCENTRICITY_2) * sin(latitude)


def _radii_m(latitude: float) -> tuple[float, float]:
    """Returns the meridian's radius of curvature and the parallel's radius: metres per radian of each angle."""
    flattening_term = 1 - ECCENTRICITY_2 * sin(latitude) ** 2
    meridian = EQUATORIAL_RADIUS_M * (1 - ECCENTRICITY_2) / flattening_term**1.5
    return meridian, EQUATORIAL_RADIUS_M / sqrt(flattening_term) * cos(latitude)
