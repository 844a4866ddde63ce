"""The places of docks on the hull, of every stack and for every number of docks."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.assembly.stacks import stacks
from apad_bridge.scenario.schema import LIMITS
from apad_bridge.vehicle.capabilities import Capabilities, of_simulated_apad
from apad_bridge.vehicle.generation_b.messages import CAMERA_SERVO
from apad_bridge.vehicle.stack import Stack

ANY_PLACE = st.floats(-1e3, 1e3)
ANY_HEADING = st.floats(-math.pi, math.pi)


@st.composite
def vehicles(draw: st.DrawFn) -> Capabilities:
    stack: Stack = draw(st.sampled_from(stacks()))
    return stack.capabilities(draw(st.integers(1, LIMITS[stack.generation].docks)))


@given(vehicles(), ANY_PLACE, ANY_PLACE, ANY_HEADING)
def test_every_dock_is_beside_the_hull_and_none_is_in_another(
    vehicle: Capabilities, north_m: float, east_m: float, heading_rad: float
) -> None:
    docks = vehicle.docks
    places = [docks.place_m(it, north_m, east_m, heading_rad) for it in docks.indices]
    assert len(places) == docks.count
    assert all(0.1 < math.dist(place, (north_m, east_m)) < 0.5 for place in places)
    gaps = [math.dist(one, other) for n, one in enumerate(places) for other in places[:n]]
    assert all(gap > 0.05 for gap in gaps)


@given(vehicles(), ANY_HEADING, ANY_HEADING)
def test_docks_that_turn_with_the_hull_keep_their_bearing_from_the_bow(
    vehicle: Capabilities, before_rad: float, after_rad: float
) -> None:
    for dock_index, bearing_rad in enumerate(vehicle.docks.bearings_rad):
        for heading_rad in (before_rad, after_rad):
            north_m, east_m = vehicle.docks.place_m(dock_index, 0.0, 0.0, heading_rad)
            turned_rad = heading_rad if vehicle.docks.turn_with_hull else 0.0
            off_rad = math.remainder(math.atan2(east_m, north_m) - turned_rad - bearing_rad, math.tau)
            assert off_rad == pytest.approx(0.0, abs=1e-9)


def test_the_papers_four_docks_are_those_of_the_public_simulator() -> None:
    assert of_simulated_apad().docks.offsets_m == ((-0.1, -0.1), (-0.1, 0.1), (0.1, -0.1), (0.1, 0.1))


def test_generation_b_has_as_many_docks_as_its_docking_primitive_has_slots() -> None:
    assert [len(CAMERA_SERVO)] == [
        LIMITS[it.generation].docks for it in stacks() if it.capabilities(1).sees_amussels
    ]
