"""Polygons with obvious answers."""

from __future__ import annotations

import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.scenario.area.polygon import Point, area_m2, bounding_box, contains, is_simple

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
# A U, open to the north: 4 x 4 with a gap of 2 x 2 in the middle of its northern side.
U = ((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (2.0, 1.0), (2.0, 3.0), (4.0, 3.0), (4.0, 4.0), (0.0, 4.0))


def test_areas_either_way_round() -> None:
    assert area_m2(SQUARE) == area_m2(SQUARE[::-1]) == 16.0
    assert area_m2(U) == 12.0


@pytest.mark.parametrize(
    ("corners", "simple"),
    [
        (SQUARE, True),
        (U, True),
        (((0, 0), (4, 4), (4, 0), (0, 4)), False),  # a bow tie
        (((0, 0), (4, 0), (4, 0), (0, 4)), False),  # a corner twice
        (((0, 0), (4, 0), (2, 0), (2, 4)), False),  # an edge folded back on the one before
        (((0, 0), (4, 0), (4, 4), (2, 0), (0, 4)), False),  # a corner on another edge
        (((0, 0), (2, 0), (4, 0), (4, 4)), True),  # a corner on a straight side does no harm
    ],
)
def test_crossing_and_touching(corners: tuple[Point, ...], simple: bool) -> None:
    assert is_simple(corners) is simple and is_simple(corners[::-1]) is simple
    assert is_simple((*corners[1:], corners[0])) is simple


@given(st.floats(-2, 6), st.floats(-2, 6))
def test_inside_a_u(north: float, east: float) -> None:
    on_an_edge = {north, east} & {0.0, 1.0, 2.0, 3.0, 4.0}
    in_square, in_slot = 0 < north < 4 and 0 < east < 4, north > 2 and 1 < east < 3
    if not on_an_edge:
        assert contains(U, (north, east)) is (in_square and not in_slot)


def test_the_box() -> None:
    assert bounding_box(((1.0, 5.0), (3.0, -2.0), (2.0, 9.0))) == ((1.0, -2.0), (3.0, 9.0))


INTERRUPTED_IN_NUMPY = """
import signal, sys
from agents.hosting.interrupts import interruptible
from apad_bridge.scenario.area.polygon import area_m2

class Finder:
    def find_spec(self, name, path, target=None):
        if name == "numpy.linalg":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Finder())
try:
    with interruptible():
        area_m2([(0, 0), (0, 1), (1, 1)])
except KeyboardInterrupt:
    print("interrupted")
"""


def test_ctrl_c_while_shapely_is_imported_is_no_import_error() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_IN_NUMPY], capture_output=True, text=True, timeout=60
    )
    assert (done.stdout, done.stderr) == ("interrupted\n", "")
