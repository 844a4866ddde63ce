"""Where the other aPads of a run are, as far as they are heard."""

from __future__ import annotations

import math

import pytest

from apad_bridge.ros.links.other_apads import NavSts, OtherAPads
from apad_bridge.vehicle.guards.guarded_orders import BodyInWater


def message(north_m: float, east_m: float) -> NavSts:
    told = NavSts()
    told.position.north, told.position.east = north_m, east_m
    return told


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e9])
def test_the_newest_place_that_can_be_is_kept(bad: float) -> None:
    others = OtherAPads([])
    assert others.bodies() == ()
    others._take(message(1.0, 2.0), "apad2")
    others._take(message(3.0, 4.0), "apad2")
    others._take(message(bad, 4.0), "apad2")
    others._take(message(7.0, 8.0), "apad3")
    assert set(others.bodies()) == {
        BodyInWater("apad2", (3.0, 4.0), agent_id=None),
        BodyInWater("apad3", (7.0, 8.0), agent_id=None),
    }
    assert others.dropped == {"apad2: a position out of range": 1}
    others.close()
