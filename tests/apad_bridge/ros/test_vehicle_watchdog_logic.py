"""The vehicle's watchdog without ROS: what it orders when the heartbeat ends, and what it refuses to believe."""

from __future__ import annotations

import importlib.util
import math
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

SCRIPT = Path(__file__).parents[3] / "launch_scripts" / "vehicle_watchdog"


def loaded() -> Any:
    loader = SourceFileLoader("vehicle_watchdog", str(SCRIPT))
    spec = importlib.util.spec_from_loader(loader.name, loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module


WATCHDOG = loaded()
SQUARE = [(0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)]


class Orders:
    """Takes every order, unless it is told not to."""

    def __init__(self) -> None:
        self.taken: list[tuple[str, float, float]] = []
        self.refuses = False

    def hold(self, north: float, east: float) -> None:
        self._take("hold", north, east)

    def go(self, north: float, east: float, speed: float) -> None:
        self._take("go", north, east)

    def stop(self) -> None:
        self._take("stop", 0.0, 0.0)

    def _take(self, what: str, north: float, east: float) -> None:
        if self.refuses:
            raise WATCHDOG.NotTaken("not now")
        self.taken.append((what, north, east))


class Vessel:
    """The watchdog of an aPad that says where it is twice a second, unless it is told not to."""

    def __init__(self, home: Any = None) -> None:
        self.orders, self.said = Orders(), list[str]()
        position = WATCHDOG.PositionCheck(10.0, 2.0)
        self.watchdog = WATCHDOG.Watchdog(self.orders, position, 5.0, home, self.said.append)
        self.place: tuple[float, float] | None = (10.0, 10.0)
        self.age_s: float | None = 0.1
        """What the heartbeat says; None for none."""

    def seconds(self, count: float) -> None:
        for _ in range(round(count / WATCHDOG.BEAT_S)):
            if self.place is not None:
                position = SimpleNamespace(north=self.place[0], east=self.place[1])
                self.watchdog.hear_position(SimpleNamespace(position=position))
            if self.age_s is not None:
                self.watchdog.hear_heartbeat(SimpleNamespace(data=self.age_s))
            self.watchdog.beat()
            if self.watchdog._call is not None:
                self.watchdog._call.join(10)

    @property
    def state(self) -> str:
        return str(self.watchdog.state)


def test_it_waits_watches_and_holds_once_when_the_heartbeat_ends() -> None:
    vessel = Vessel()
    vessel.age_s = None
    vessel.seconds(60)
    assert vessel.state == "WAITING" and not vessel.orders.taken
    vessel.age_s = 0.5
    vessel.seconds(60)
    assert vessel.state == "WATCHING" and not vessel.orders.taken
    vessel.age_s = None
    vessel.seconds(60)
    assert vessel.state == "HELD" and vessel.orders.taken == [("hold", 10.0, 10.0)]


@pytest.mark.parametrize("age_s", [3.1, math.nan, math.inf])
def test_a_bench_that_has_no_fresh_position_counts_as_silent(age_s: float) -> None:
    vessel = Vessel()
    vessel.seconds(2)
    vessel.age_s = age_s
    vessel.seconds(8)
    assert vessel.state == "HELD"


def test_what_is_not_taken_is_ordered_again() -> None:
    vessel = Vessel()
    vessel.seconds(2)
    vessel.age_s, vessel.orders.refuses = None, True
    vessel.seconds(20)
    assert vessel.state == "SILENT" and "not ordered yet: not now" in vessel.said
    vessel.orders.refuses = False
    vessel.seconds(2)
    assert vessel.state == "HELD"


@pytest.mark.parametrize(
    ("place", "why"),
    [
        (None, "tells no position"),
        ((math.nan, 10.0), "tells no position"),
        ((math.inf, 10.0), "tells no position"),
        ((40.0, 10.0), "has jumped"),
    ],
)
def test_on_a_position_that_is_not_to_be_believed_it_orders_nothing(
    place: tuple[float, float] | None, why: str
) -> None:
    vessel = Vessel()
    vessel.seconds(20)
    vessel.age_s = None
    vessel.seconds(1)
    vessel.place = place
    vessel.seconds(8)
    assert vessel.state == "SILENT" and not vessel.orders.taken
    assert any(why in it for it in vessel.said)
    vessel.place = vessel.place if why == "has jumped" else (10.0, 10.0)
    vessel.seconds(12)  # the position stays where it is now
    assert vessel.state == "HELD"


def test_a_pilot_is_not_fought_before_the_heartbeat_is_back() -> None:
    vessel = Vessel(home())
    vessel.seconds(2)
    vessel.age_s = None
    vessel.watchdog.hear_pilot(SimpleNamespace(data=True))
    vessel.seconds(10)
    vessel.watchdog.hear_pilot(SimpleNamespace(data=False))
    vessel.seconds(600)
    assert vessel.state == "PILOTED" and not vessel.orders.taken
    vessel.age_s = 0.1
    vessel.seconds(1)
    assert vessel.state == "WATCHING"


def home(place: tuple[float, float] = (30.0, 10.0), after_s: float = 60.0) -> Any:
    return WATCHDOG.Home(place, after_s, SQUARE, 30.0, 0.5)


def silent_with(percent: float | None, at: Any, charge_known: bool = True) -> Vessel:
    vessel = Vessel(at)
    if charge_known:
        vessel.watchdog.hear_battery(SimpleNamespace(data=percent))
    vessel.seconds(2)
    vessel.age_s = None
    vessel.seconds(20)
    assert vessel.state == "HELD"
    return vessel


def test_it_goes_home_once_after_the_stated_time_and_holds_there() -> None:
    vessel = silent_with(50.0, home())
    vessel.seconds(30)
    assert vessel.orders.taken == [("hold", 10.0, 10.0)]
    vessel.seconds(30)
    assert vessel.state == "HOMEWARD" and vessel.orders.taken[1:] == [("go", 30.0, 10.0)]
    for north_m in range(10, 30):
        vessel.place = (float(north_m), 10.0)
        vessel.seconds(1)
    assert vessel.state == "HOME" and vessel.orders.taken[2:] == [("hold", 28.0, 10.0)]
    vessel.seconds(600)
    assert len(vessel.orders.taken) == 3


@pytest.mark.parametrize(
    ("percent", "at", "why"),
    [
        (29.0, home(), "below 30 %"),
        (math.nan, home(), "below 30 %"),
        (None, home(), "not known"),
        (90.0, home((50.0, 10.0)), "outside the fence"),
    ],
)
def test_it_stays_where_charge_or_fence_forbid_the_way(percent: float | None, at: Any, why: str) -> None:
    vessel = silent_with(percent, at)
    vessel.seconds(300)
    assert vessel.state == "HELD" and len(vessel.orders.taken) == 1
    assert any(why in it for it in vessel.said)


def test_on_the_way_home_a_bad_position_stops_it_and_a_way_that_does_not_end_is_held() -> None:
    blind, slow = silent_with(50.0, home()), silent_with(50.0, home())
    for vessel in (blind, slow):
        vessel.seconds(60)
        assert vessel.state == "HOMEWARD"
    blind.place = None
    blind.seconds(5)
    assert blind.state == "SILENT" and blind.orders.taken[-1][0] == "stop"
    blind.place = (10.0, 10.0)
    blind.seconds(300)
    assert blind.state == "HELD" and blind.orders.taken[-1] == ("hold", 10.0, 10.0)
    slow.seconds(200)  # 60 s and three times the 40 s that the way takes are over
    assert slow.state == "HELD" and slow.orders.taken[-1] == ("hold", 10.0, 10.0)


@given(st.tuples(st.floats(-10, 50), st.floats(-10, 50)), st.tuples(st.floats(-10, 50), st.floats(-10, 50)))
def test_no_way_that_leaves_a_fence_with_a_notch_is_good(
    start: tuple[float, float], goal: tuple[float, float]
) -> None:
    """An L: the square without its corner beyond (20, 20). Judged by many places on the way."""
    corners = [(0.0, 0.0), (40.0, 0.0), (40.0, 20.0), (20.0, 20.0), (20.0, 40.0), (0.0, 40.0)]
    if WATCHDOG.way_fault(start, goal, corners):
        return
    for n in range(101):
        north_m, east_m = (a + n / 100 * (b - a) for a, b in zip(start, goal, strict=True))
        assert 0 <= north_m <= 40 and 0 <= east_m <= 40 and not (north_m > 20 and east_m > 20)
    assert WATCHDOG.way_fault((5.0, 5.0), (35.0, 5.0), corners) == ""
    assert "crosses" in WATCHDOG.way_fault((35.0, 15.0), (15.0, 35.0), corners)


@pytest.mark.parametrize("text", ["", "0,0 1,1", "0,0 1,1 2", "a,b 1,2 3,4"])
def test_corners_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(ValueError):
        WATCHDOG.corners_of(text)
    assert WATCHDOG.corners_of("0,0 30,0 30,-20.5") == [(0.0, 0.0), (30.0, 0.0), (30.0, -20.5)]
