"""Tests the picture of a fit: its elements and their places."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from apad_bridge.analysis.battery_fit.battery_fit import fit_log
from apad_bridge.analysis.battery_fit.battery_log import BatteryLog
from apad_bridge.analysis.battery_fit.figure import svg, ticks

SVG = "{http://www.w3.org/2000/svg}"


def drawn(rows: int, outlier: float = 0.0, name: str = "a.csv") -> ET.Element:
    scaled = np.linspace(0.1, 0.9, rows)
    scaled[rows // 2] += outlier
    return ET.fromstring(svg(fit_log(BatteryLog(name, np.arange(float(rows)), scaled, 0), 2)))


def test_rows_curve_and_breakpoints_are_drawn_where_they_lie() -> None:
    picture = drawn(200)
    assert len(picture.findall(f"{SVG}circle[@class='row']")) == 2 * 200
    (curve,) = picture.findall(f"{SVG}polyline[@class='curve']")
    points = [tuple(map(float, point.split(","))) for point in curve.get("points", "").split()]
    knots = [
        (float(dot.get("cx", "")), float(dot.get("cy", "")))
        for dot in picture.findall(f"{SVG}circle[@class='knot']")
    ]
    assert points == knots
    # The frame of the upper panel: x from 70 to 840, y from 46 down to 376, showing -0.02 to 1.02.
    assert points[0] == pytest.approx((70, 376 - 330 * 0.12 / 1.04), abs=0.1)
    assert points[-1] == pytest.approx((840, 376 - 330 * 0.92 / 1.04), abs=0.1)


def test_a_long_log_is_thinned_but_keeps_its_outlier() -> None:
    picture = drawn(20_000, outlier=0.4)
    dots = picture.findall(f"{SVG}circle[@class='row']")
    assert len(dots) == 2 * 1500
    # 0.9 in the upper panel, in the middle.
    assert any(
        abs(float(dot.get("cx", "")) - 455) < 1
        and abs(float(dot.get("cy", "")) - (376 - 330 * 0.92 / 1.04)) < 1
        for dot in dots
    )


def test_a_name_is_text_whatever_is_in_it() -> None:
    picture = drawn(20, name="<b>&.csv")
    assert picture.findall(f"{SVG}text[@class='title']")[0].text == "<b>&.csv"


@pytest.mark.parametrize(
    ("low", "high", "about", "expected"),
    [
        (-0.02, 1.02, 6, [0, 0.2, 0.4, 0.6, 0.8, 1.0]),
        (0, 485, 8, [0, 100, 200, 300, 400]),
        (-0.011, 0.011, 4, [-0.01, 0, 0.01]),
        (3, 4, 4, [3, 3.5, 4]),
    ],
)
def test_ticks_are_round_numbers(low: float, high: float, about: int, expected: list[float]) -> None:
    assert ticks(low, high, about) == pytest.approx(expected)
