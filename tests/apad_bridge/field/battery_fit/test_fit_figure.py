"""Tests the picture of a fit: what is drawn, and where."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from apad_bridge.field.battery_fit.battery_fit import BatteryFit, fit_log
from apad_bridge.field.battery_fit.battery_log import BatteryLog
from apad_bridge.field.battery_fit.fit_figure import draw, figure_of


def fitted(rows: int, outlier: float = 0.0, name: str = "a.csv") -> BatteryFit:
    """Rises from 0.1 to 0.5 in the first half of `rows` minutes and to 0.7 in the second."""
    minutes = np.arange(float(rows))
    scaled = np.interp(minutes, [0, rows // 2, rows - 1], [0.1, 0.5, 0.7])
    scaled[rows // 4] += outlier
    return fit_log(BatteryLog(name, minutes, scaled, 0), 2)


def points(panel: Any, label: str) -> np.ndarray:
    (line,) = [it for it in panel.lines if it.get_label() == label]
    drawn: np.ndarray = line.get_xydata()
    return drawn


def test_rows_curve_and_residuals_are_drawn_where_they_lie() -> None:
    upper, lower = figure_of(fitted(201, outlier=0.1)).axes
    assert points(upper, "rows")[:3] == pytest.approx(np.array([(0, 0.1), (1, 0.104), (2, 0.108)]))
    assert points(upper, "curve") == pytest.approx(
        np.array([(0, 0.1), (100, 0.5), (200, 0.7)]), abs=0.01, rel=0.02
    )
    residuals = points(lower, "residuals")
    assert residuals[50] == pytest.approx((50, 0.1), abs=0.01)
    assert np.abs(np.delete(residuals[:, 1], 50)).max() < 0.01
    rates = [float(it.get_text().removesuffix(" / min")) for it in upper.texts]
    assert rates == pytest.approx([0.004, 0.002], rel=0.05)


def test_a_name_is_text_whatever_is_in_it(tmp_path: Path) -> None:
    draw(fitted(20, name="<b>&$x^$_.csv"), tmp_path / "a.svg")
    assert figure_of(fitted(20, name="$x^$.csv")).get_suptitle() == "$x^$.csv"


@pytest.mark.parametrize(("ending", "begins"), [("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF")])
def test_the_ending_chooses_the_format(ending: str, begins: bytes, tmp_path: Path) -> None:
    draw(fitted(20), tmp_path / f"a.{ending}")
    assert (tmp_path / f"a.{ending}").read_bytes().startswith(begins)
