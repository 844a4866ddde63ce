"""Layers and patches against hand calculations: an anoxic patch grows, moves, and is sampled by the sensors' field."""

from __future__ import annotations

import pytest

from agents.water.fields import Constant
from agents.water.patches import Layers, Patched, QuantityWater, WaterPatch

METRE = 1_000_000
HOUR = 3_600_000


@pytest.mark.parametrize(("depth_m", "value"), [(0, 8.5), (2, 8.5), (6, 7.25), (10, 6.0), (30, 6.0)])
def test_layers_are_linear_between(depth_m: float, value: float) -> None:
    layers = Layers(((2 * METRE, 8.5), (10 * METRE, 6.0)))
    assert layers.value_at(1, 2, round(depth_m * METRE), 3) == pytest.approx(value)


# From hour 1 on it grows for 10 h to 100 m, and goes 0.01 m/s = 36 m/h to the north.
DEAD = WaterPatch(0.2, HOUR, 10 * HOUR, 0, 50 * METRE, 10_000, 0, 100 * METRE, 4 * METRE)


@pytest.mark.parametrize(
    ("north_m", "hours", "share"),
    [
        (0, 1, 0.0),
        (36, 2, 1.0),  # radius 10 m, and its middle is here
        (36 + 5, 2, 1.0),
        (36 + 7.5, 2, 0.5),
        (36 + 10, 2, 0.0),
        (180, 6, 1.0),  # radius 50 m
        (180 - 37.5, 6, 0.5),
        (720 + 75, 21, 0.5),  # 100 m, and no larger
        (720 + 101, 21, 0.0),
    ],
)
def test_it_grows_and_wanders(north_m: float, hours: float, share: float) -> None:
    at = (round(north_m * METRE), 50 * METRE, 5 * METRE, round(hours * HOUR))
    assert DEAD.share_at(*at) == pytest.approx(share)
    assert Patched(Constant(8.0), (DEAD,)).value_at(*at) == pytest.approx(8.0 + (0.2 - 8.0) * share)


def test_above_it_the_water_is_as_before() -> None:
    assert DEAD.share_at(36 * METRE, 50 * METRE, 4 * METRE - 1, 2 * HOUR) == 0.0


def test_the_later_lies_over_the_earlier() -> None:
    still = (HOUR, 1, 0, 0, 0, 0, 10 * METRE, 0)
    waters = QuantityWater(((0, 8.0),), (WaterPatch(2.0, *still), WaterPatch(5.0, *still)))
    assert waters.field().value_at(0, 0, 0, 2 * HOUR) == 5.0
    assert QuantityWater(((0, 8.0),)).field() == Constant(8.0)
