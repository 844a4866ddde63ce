"""The current's field: corners, edges and middles worked out by hand, and files that are refused."""

from __future__ import annotations

from array import array
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.water.current_field import STILL_WATER, CurrentField

HEADER = "north_m,east_m,north_m_s,east_m_s\n"
# 10 m x 20 m; north velocity 0 in the south and 1 m/s in the north, east velocity 0 in the west and 0.2 m/s in the east.
SQUARE = CurrentField.parse(f"{HEADER}0,0,0,0\n0,20,0,0.2\n10,0,1,0\n10,20,1,0.2\n")
METRE = 1_000_000


@pytest.mark.parametrize(
    ("north_m", "east_m", "velocity"),
    [
        (0, 0, (0, 0)),
        (10, 20, (1_000_000, 200_000)),
        (5, 10, (500_000, 100_000)),
        (2.5, 5, (250_000, 50_000)),
        (10, 5, (1_000_000, 50_000)),
        (-7, 10, (0, 100_000)),
        (99, 10, (1_000_000, 100_000)),
        (5, -3, (500_000, 0)),
        (5, 1000, (500_000, 200_000)),
        (-1, -1, (0, 0)),
        (11, 21, (1_000_000, 200_000)),
    ],
)
def test_bilinear_inside_and_the_nearest_edge_outside(
    north_m: float, east_m: float, velocity: tuple[int, int]
) -> None:
    assert SQUARE.velocity_um_s(int(north_m * METRE), int(east_m * METRE)) == velocity


@given(st.integers(-(10**12), 10**12), st.integers(-(10**12), 10**12))
def test_one_row_is_one_current_everywhere_and_still_water_stands(north_um: int, east_um: int) -> None:
    tide = CurrentField.parse(f"{HEADER}3,4,-0.25,0.125\n")
    assert tide.velocity_um_s(north_um, east_um) == (-250_000, 125_000)
    assert STILL_WATER.velocity_um_s(north_um, east_um) == (0, 0)


def test_a_field_is_still_only_if_all_of_it_is() -> None:
    assert STILL_WATER.is_still
    assert CurrentField.parse(f"{HEADER}0,0,0,0\n0,9,0,0\n").is_still
    assert not CurrentField.parse(f"{HEADER}0,0,0,0\n0,9,0,0.1\n").is_still
    assert not CurrentField.parse(f"{HEADER}0,0,-0.1,0\n0,9,0,0\n").is_still


def test_one_line_of_points_varies_along_it_only() -> None:
    river = CurrentField.parse(f"{HEADER}0,0,0,0\n0,4,1,0\n0,6,3,0\n")
    assert [river.velocity_um_s(north, 5 * METRE) for north in (-METRE, 0, METRE)] == [(2_000_000, 0)] * 3
    assert river.velocity_um_s(0, METRE) == (250_000, 0)


@given(st.lists(st.integers(-(10**6), 10**6), min_size=4, max_size=4), st.integers(0, 7), st.integers(0, 5))
def test_a_velocity_is_the_exact_mean_rounded_to_the_nearest(
    speeds: list[int], north: int, east: int
) -> None:
    field = CurrentField(array("q", [0, 7]), array("q", [0, 5]), array("q", speeds), array("q", speeds[::-1]))
    share_n, share_e = Fraction(north, 7), Fraction(east, 5)
    south = speeds[0] * (1 - share_e) + speeds[1] * share_e
    exact = south * (1 - share_n) + (speeds[2] * (1 - share_e) + speeds[3] * share_e) * share_n
    assert abs(field.velocity_um_s(north, east)[0] - exact) <= Fraction(1, 2)


def test_order_of_rows_and_columns_and_comments_do_not_matter() -> None:
    text = "# tide\n\neast_m_s, east_m, north_m, north_m_s\n0.2,20,10,1 # corner\n0,0,10,1\n0,0,0,0\n0.2,20,0,0\n"
    assert CurrentField.parse(text) == SQUARE
    assert CurrentField.parse("\ufeff" + text.replace("\n", "\r\n")) == SQUARE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"^no current in it: needs a header north_m,east_m,north_m_s,east_m_s and one row"),
        (HEADER, r"^no current in it"),
        ("north,east,u,v\n0,0,0,0\n", r"^line 1: the columns must be north_m, .*, not north, east, u, v$"),
        ("0,0,0.1,0.1\n", r"^line 1: the columns must be"),
        (f"{HEADER}0,0,0\n", r"^line 2: 3 values for 4 columns$"),
        (f"{HEADER}0,0,0,0\n\n1,0,x,0\n", r"^line 4: north_m_s: must be a number, not 'x'$"),
        (f"{HEADER}0,1_0,0,0\n", r"^line 2: east_m: must be a number, not '1_0'$"),
        (f"{HEADER}0,0,nan,0\n", r"^line 2: north_m_s: must be a number within \+-20, not nan$"),
        (f"{HEADER}0,inf,0,0\n", r"^line 2: east_m: must be a number within \+-1e\+06, not inf$"),
        (f"{HEADER}0,0,0,50\n", r"^line 2: east_m_s: must be a number within \+-20, not 50$"),
        (f"{HEADER}0,0,0,0\n0,0,1,1\n", r"^line 3: this place is in a line above already$"),
        (
            f"{HEADER}0,0,0,0\n0,1,0,0\n2.5,0,0,0\n",
            r"^not a grid: there is no row for north_m 2.5, east_m 1$",
        ),
    ],
)
def test_what_is_no_field_is_refused(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        CurrentField.parse(text)
