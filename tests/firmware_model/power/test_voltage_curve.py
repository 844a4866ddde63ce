"""The voltage of a battery by its charge, against numpy's interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.power.charge import FULL
from firmware_model.power.voltage_curve import STRAIGHT, VoltageCurve

INNER = st.lists(st.integers(1, FULL - 1), min_size=1, max_size=5, unique=True)


@given(INNER, st.data())
def test_a_curve_and_its_inverse_are_the_straight_pieces(charges: list[int], data: st.DataObject) -> None:
    voltages = sorted(
        data.draw(
            st.lists(st.integers(0, FULL), min_size=len(charges) + 2, max_size=len(charges) + 2, unique=True)
        )
    )
    curve = VoltageCurve(tuple(zip([0, *sorted(charges), FULL], voltages, strict=True)))
    charge = data.draw(st.integers(0, FULL))
    voltage = curve.voltage(charge)
    assert voltage == pytest.approx(np.interp(charge, *zip(*curve.points, strict=True)), abs=FULL * 1e-12)
    assert abs(curve.charge(voltage) - charge) <= curve.stretch + 1
    assert 0 < curve.stretch_at(voltage) <= curve.stretch


def test_the_papers_line_is_the_charge() -> None:
    assert STRAIGHT.is_straight and STRAIGHT.stretch == 1.0
    # Beyond the points the outer pieces go on: a charger's lift, less what it is, may lie there.
    bent = VoltageCurve(((0, 0), (FULL // 2, FULL // 4), (FULL, FULL)))
    assert bent.charge(-FULL // 8) == -FULL // 4
    assert bent.stretch == 2.0 and bent.stretch_at(FULL // 2) == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    "points",
    [
        (),
        ((0, 0),),
        ((0, 0), (FULL // 2, FULL), (FULL, FULL)),
        ((1, 0), (FULL, FULL)),
        ((0, 0), (FULL - 1, FULL)),
    ],
)
def test_what_does_not_rise_from_empty_to_full_is_no_curve(points: tuple[tuple[int, int], ...]) -> None:
    with pytest.raises(ValueError):
        VoltageCurve(points)
