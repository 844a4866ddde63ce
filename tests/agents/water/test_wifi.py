"""Wi-Fi near the waves against hand calculations."""

from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.water.wifi import Wifi

RADIO = Wifi()


def test_near_by_it_is_friis_and_far_off_two_rays() -> None:
    """The wave is 0.12287 m long: 20 log10(4 pi 2 / 0.12287) = 46.22 dB at 2 m. At 100 m 80 - 20 log10(0.075) = 102.50."""
    assert RADIO.path_loss_db(2) == pytest.approx(46.22, abs=0.01)
    assert RADIO.path_loss_db(100) == pytest.approx(102.50, abs=0.01)
    assert RADIO.path_loss_db(0) == RADIO.path_loss_db(1)


def test_half_get_through_at_the_sensitivity() -> None:
    """105 dB of path: d = 10^((105 - 22.4988) / 40) = 115.49 m. One slope nearer it is 1 / (1 + 1/e)."""
    assert RADIO.delivery(115.49) == pytest.approx(0.5, abs=1e-3)
    nearer_m = 115.49 / 10 ** (1.5 / 40)
    assert RADIO.delivery(nearer_m) == pytest.approx(0.7311, abs=1e-3)
    assert RADIO.delivery(20) > 0.999999 and RADIO.delivery(2000) < 1e-12


@given(st.floats(0, 3000), st.floats(0.1, 500))
def test_farther_is_never_better(metres: float, more_m: float) -> None:
    assert RADIO.delivery(metres + more_m) <= RADIO.delivery(metres)


def test_as_many_get_through_as_it_says() -> None:
    through = sum(RADIO.gets_through(115.49, 3, 7, 1000 * n, 0) for n in range(2000))
    assert through / 2000 == pytest.approx(0.5, abs=4 * sqrt(0.25 / 2000))


def test_what_is_no_radio_is_refused() -> None:
    with pytest.raises(ValueError, match="slope_db must be positive"):
        Wifi(slope_db=0)
