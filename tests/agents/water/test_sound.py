"""The water's figures against the modem's published ones and against hand calculations."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.water.sound import NANOMODEM_ERRORS, ErrorCurve, SeaWater, Sound, thorp_db_per_km


def test_snr_is_that_of_the_modems_figures() -> None:
    # 168 - 20 log10(r) - 6 r / 1000 - (50 + 10 log10(8000)): 13 dB at 1 km, 1 dB at 2 km.
    assert Sound(absorption_db_per_km=6).snr_db(1000) == pytest.approx(168 - 60 - 6 - 50 - 39.0309, abs=1e-4)
    assert Sound(absorption_db_per_km=6).snr_db(2000) == pytest.approx(0.9485, abs=1e-3)
    assert Sound().noise_db == pytest.approx(89.0309, abs=1e-4)


def test_nearer_than_a_metre_nothing_is_louder_than_the_source() -> None:
    assert Sound(absorption_db_per_km=0).level_db(0.0) == 168.0


def test_practical_spreading_loses_fifteen_decibels_a_decade() -> None:
    sound = Sound(spreading_db=15, absorption_db_per_km=0)
    assert sound.level_db(10) - sound.level_db(1000) == pytest.approx(30)


@pytest.mark.parametrize(("khz", "db"), [(1, 0.0690), (10, 1.1870), (28, 7.3914), (50, 17.4671)])
def test_thorp_by_hand(khz: float, db: float) -> None:
    """At 28 kHz: 0.11 * 784/785 + 44 * 784/4884 + 0.000275 * 784 + 0.003 = 0.1099 + 7.0631 + 0.2156 + 0.003."""
    assert thorp_db_per_km(khz) == pytest.approx(db, abs=2e-4)


def test_mackenzie_s_own_check_value() -> None:
    """The paper of the formula gives 1550.744 m/s for 25 degrees, 35 parts in a thousand and 1000 m."""
    water = SeaWater(25, 35, 1000)
    assert water.sound_speed_m_s == pytest.approx(1550.744, abs=5e-4)
    assert Sound(sea_water=water).delay_us(1550.744) == pytest.approx(1_000_000, abs=1)
    assert SeaWater(20, 38).sound_speed_m_s == pytest.approx(1525.0, abs=0.3)  # a warm Adriatic pool, by hand


def test_sound_takes_two_thirds_of_a_millisecond_a_metre() -> None:
    assert Sound().delay_us(1500) == 1_000_000
    assert Sound(sound_speed_m_s=1525).delay_us(30.5) == 20_000


@pytest.mark.parametrize(
    ("size", "snr_db", "rate"),
    [(16, -1, 0.412), (16, 3, 0.006), (16, 6, 0.001), (32, 0, 0.553), (64, 2, 0.483), (64, 6, 0.007)],
)
def test_the_error_curve_goes_through_its_points(size: int, snr_db: float, rate: float) -> None:
    assert NANOMODEM_ERRORS.probability(snr_db, size) == pytest.approx(rate, abs=1e-12)


def test_halfway_between_two_points_the_odds_are_the_geometric_mean() -> None:
    # Odds .161/.839 = .191895 and .047/.953 = .049318: their mean is .097283, which is a rate of .088658.
    assert NANOMODEM_ERRORS.probability(0.5, 16) == pytest.approx(0.088658, abs=2e-6)
    # 23 bytes lie log(23/16)/log(2) = .52356 of the way from 16 to 32; at 0 dB odds .191895 and .553/.447 = 1.237136.
    assert NANOMODEM_ERRORS.probability(0, 23) == pytest.approx(0.337360, abs=1e-5)


@given(st.floats(-40, 60), st.floats(0.1, 20), st.integers(0, 70))
def test_more_signal_never_harms_and_more_bytes_never_help(snr_db: float, more_db: float, size: int) -> None:
    here = NANOMODEM_ERRORS.probability(snr_db, size)
    assert 0 <= NANOMODEM_ERRORS.probability(snr_db + more_db, size) <= here <= 1
    assert here <= NANOMODEM_ERRORS.probability(snr_db, size + 3) + 1e-12


def test_far_beyond_its_points_the_curve_is_certain() -> None:
    assert NANOMODEM_ERRORS.probability(-30, 16) > 0.999999
    assert NANOMODEM_ERRORS.probability(50, 64) < 1e-9


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (partial(ErrorCurve, (1, 1), (16,), ((0.5, 0.4),)), "snrs_db"),
        (partial(ErrorCurve, (1, 2), (), ()), "sizes"),
        (partial(ErrorCurve, (1, 2), (16,), ((0.5,),)), "a row for each size"),
        (partial(ErrorCurve, (1, 2), (16,), ((0.5, 0.0),)), "between 0 and 1"),
        (partial(Sound, range_limit_m=0), "range_limit_m"),
        (partial(Sound, fading_db=-1), "fading_db"),
        (partial(Sound, frequency_khz=200), "from 0.1 to 50 kHz: state absorption_db_per_km"),
    ],
    ids=lambda it: it if isinstance(it, str) else "",
)
def test_what_is_no_curve_and_no_sound_is_refused(made: Callable[[], object], told: str) -> None:
    """Thorp's formula is not used outside its range, unless somebody states the absorption."""
    with pytest.raises(ValueError, match=told):
        made()
    assert Sound(frequency_khz=200, absorption_db_per_km=60).absorption == 60


def test_what_the_range_limit_leaves_out_is_bounded() -> None:
    """At 4 km a sound is 17.07 dB below the noise: one raises it by 10 log10(1 + 10^-1.707) = 0.08 dB."""
    sound = Sound(absorption_db_per_km=6, range_limit_m=4000)
    assert -sound.snr_db(sound.range_limit_m) == pytest.approx(17.072, abs=1e-3)
    levels = [sound.snr_db(metres) for metres in range(4000, 9000, 500)]
    assert all(louder > weaker for louder, weaker in pairwise(levels))
