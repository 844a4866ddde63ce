"""Local NED against geodesics on the ellipsoid: Vincenty's formula, itself checked against a published
line.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import atan, atan2, cos, degrees, hypot, inf, nan, radians, sin, tan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.scenario.area.local_frame import LocalFrame

BIOGRAD = LocalFrame(43.9330937, 15.4443468)


def geodesic(lat1: float, lon1: float, lat2: float, lon2: float) -> tuple[float, float]:
    """Distance (m) and azimuth (rad) on WGS-84 by T. Vincenty, Survey Review XXIII 176 (1975), inverse
    formula.
    """
    a, f = 6378137.0, 1 / 298.257223563
    b = a * (1 - f)
    u1, u2 = atan((1 - f) * tan(radians(lat1))), atan((1 - f) * tan(radians(lat2)))
    length = radians(lon2 - lon1)
    lam = length
    for _ in range(50):
        x, y = cos(u2) * sin(lam), cos(u1) * sin(u2) - sin(u1) * cos(u2) * cos(lam)
        sin_s = hypot(x, y)
        if sin_s == 0:
            return 0.0, 0.0
        cos_s = sin(u1) * sin(u2) + cos(u1) * cos(u2) * cos(lam)
        s = atan2(sin_s, cos_s)
        sin_al = cos(u1) * cos(u2) * sin(lam) / sin_s
        cos2_al = 1 - sin_al**2
        cos_2m = cos_s - 2 * sin(u1) * sin(u2) / cos2_al if cos2_al else 0.0
        c = f / 16 * cos2_al * (4 + f * (4 - 3 * cos2_al))
        lam = length + (1 - c) * f * sin_al * (s + c * sin_s * (cos_2m + c * cos_s * (2 * cos_2m**2 - 1)))
    uu = cos2_al * (a**2 - b**2) / b**2
    big_a = 1 + uu / 16384 * (4096 + uu * (-768 + uu * (320 - 175 * uu)))
    big_b = uu / 1024 * (256 + uu * (-128 + uu * (74 - 47 * uu)))
    inner = cos_s * (2 * cos_2m**2 - 1) - big_b / 6 * cos_2m * (4 * sin_s**2 - 3) * (4 * cos_2m**2 - 3)
    return b * big_a * (s - big_b * sin_s * (cos_2m + big_b / 4 * inner)), atan2(x, y)


def dms(deg: int, minutes: int, seconds: float) -> float:
    return deg + minutes / 60 + seconds / 3600


def test_the_reference_itself_gives_the_published_line() -> None:
    # Flinders Peak to Buninyong, Geoscience Australia's worked example: 54972.271 m, 306 deg 52' 05.37".
    distance_m, azimuth = geodesic(
        -dms(37, 57, 3.72030), dms(144, 25, 29.52440), -dms(37, 39, 10.15610), dms(143, 55, 35.38390)
    )
    assert distance_m == pytest.approx(54972.271, abs=0.001)
    assert degrees(azimuth) % 360 == pytest.approx(dms(306, 52, 5.37), abs=1e-5)


@given(st.floats(-70, 70), st.floats(-179, 179), st.floats(-0.035, 0.035), st.floats(-0.035, 0.035))
def test_it_is_the_geodesic_to_a_millimetre_within_5_km(
    lat: float, lon: float, up: float, right: float
) -> None:
    north_m, east_m = LocalFrame(lat, lon).to_local(lat + up, lon + right)
    distance_m, azimuth = geodesic(lat, lon, lat + up, lon + right)
    assert hypot(north_m - distance_m * cos(azimuth), east_m - distance_m * sin(azimuth)) < 0.001


@given(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
def test_there_and_back_within_100_km(north_m: float, east_m: float) -> None:
    back = BIOGRAD.to_local(*BIOGRAD.to_geographic(north_m, east_m))
    assert hypot(back[0] - north_m, back[1] - east_m) < 1e-6


AT_45, FIJI = LocalFrame(45.0, 15.0), LocalFrame(-17.0, 179.9999)
ANY = pytest.approx(0.0, abs=1e-2)
BY_HAND = {
    "the origin is zero": (partial(BIOGRAD.to_local, 43.9330937, 15.4443468), (0.0, 0.0)),
    "and back": (partial(BIOGRAD.to_geographic, 0.0, 0.0), (43.9330937, 15.4443468)),
    # At 45 deg: M = a (1 - e2) / (1 - e2 / 2)^1.5 = 6367381.816 m, N cos 45 = a / sqrt(1 - e2 / 2) / sqrt 2 =
    # 4517590.879 m.
    "a second of arc to the north": (
        partial(AT_45.to_local, 45.0 + 1 / 3600, 15.0),
        (pytest.approx(6367381.816 * radians(1 / 3600), abs=1e-4), ANY),
    ),
    "a second of arc to the east": (
        partial(AT_45.to_local, 45.0, 15.0 + 1 / 3600),
        (ANY, pytest.approx(4517590.879 * radians(1 / 3600), abs=1e-4)),
    ),
    "north is up and east is right across the date line": (
        partial(FIJI.to_local, -16.999, -179.9999),
        (pytest.approx(110.65, abs=0.1), pytest.approx(21.5, abs=0.5)),
    ),
    "and back across the date line": (
        partial(FIJI.to_geographic, 0.0, 100.0),
        (pytest.approx(-17.0, abs=1e-5), pytest.approx(-179.99916, abs=1e-5)),
    ),
}


@pytest.mark.parametrize(("found", "expected"), BY_HAND.values(), ids=BY_HAND)
def test_places_by_hand(found: Callable[[], object], expected: tuple[float, float]) -> None:
    assert found() == expected


PLACES = ((91, 0), (-90.1, 0), (0, 361), (nan, 0), (0, nan), (inf, 0))


@pytest.mark.parametrize(
    ("refused", "words"),
    [
        *((partial(BIOGRAD.to_local, *it), "no latitude and longitude") for it in PLACES),
        *((partial(BIOGRAD.to_geographic, it, 0.0), "too far from the origin") for it in (1e7, nan, inf)),
        (partial(LocalFrame, 90.0, 0.0), "no place for an origin"),
    ],
    ids=str,
)
def test_what_is_no_place_is_refused(refused: Callable[[], object], words: str) -> None:
    """A plane does not reach round the earth, and a pole is no origin."""
    with pytest.raises(ValueError, match=words):
        refused()
