"""The tables of statuses, levels, colours and shapes, written down a second time, with the messages' own numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from scenario_files import POOL_FILE

from apad_bridge.beliefs.modes import Mode
from apad_bridge.ros_names.shown_fleet import APadTrack, ShownAMussel, apad_shape, condition_of, place_matrix
from apad_bridge.scenario.loader import load
from firmware_model.states import State

AMUSSEL = ShownAMussel(7, State.ACTIVE, Mode.IDLE, 0.75, 0.5, (10.0, 20.0), 3.0, None, 1000, 1000, False)
RULES = replace(load(POOL_FILE).mission, silence_timeout_s=120.0, pool_threshold=0.5)


CHARGES_IN_A_DOCK_UNTIL_BOTH_ARE_FULL = {Mode.CHARGING_PRIMARY: 1, Mode.CHARGING_SECONDARY: 1, Mode.FULL: 4}


@pytest.mark.parametrize(
    ("changes", "attribute", "value"),
    [
        *(
            ({"mode": mode}, "supply_status", CHARGES_IN_A_DOCK_UNTIL_BOTH_ARE_FULL.get(mode, 2))
            for mode in Mode
        ),
        # A battery is dead when it is empty, or its aMussel lost.
        ({}, "health", 1),
        ({"charge": 0.001}, "health", 1),
        ({"charge": 0.0}, "health", 3),
        ({"state": State.LOST}, "health", 3),
        # Cells are on the paper's scale.
        ({}, "cells_v", pytest.approx([4.05, 3.9])),
        ({"charge": 0.0, "secondary": 1.0}, "cells_v", [3.6, 4.2]),
        # A ball is red when empty, green when full, cyan in a dock and grey when lost.
        ({}, "colour", (0.25, 0.75, 0.1, 1.0)),
        ({"charge": 0.0}, "colour", (1.0, 0.0, 0.1, 1.0)),
        ({"is_docked": True}, "colour", (0.0, 0.8, 0.9, 1.0)),
        ({"is_docked": True, "state": State.LOST}, "colour", (0.4, 0.4, 0.4, 1.0)),
    ],
)
def test_an_aMussel_shows(changes: dict[str, Any], attribute: str, value: object) -> None:
    assert getattr(replace(AMUSSEL, **changes), attribute) == value


@pytest.mark.parametrize(
    ("state", "charge", "now_ms", "level", "text"),
    [
        (State.ACTIVE, 0.75, 121_000, 0, "75 %"),
        (State.ACTIVE, 0.501, 1000, 0, "50 %"),
        (State.ACTIVE, 0.5, 1000, 1, "wants charging: 50 %"),
        (State.ACTIVE, 0.5, 121_001, 3, "silent for 120 s"),
        (State.ACTIVE, 0.0, 121_001, 2, "its primary battery is empty"),
        (State.EMPTY, 0.3, 1000, 2, "its primary battery is empty"),
        (State.CALLING, 0.3, 1000, 2, "its primary battery is empty"),
        (State.LOST, 0.0, 900_000, 2, "lost: both batteries are empty"),
        (None, 0.0, 0, 3, "no report yet"),
    ],
)
def test_the_worst_is_told(state: State | None, charge: float, now_ms: int, level: int, text: str) -> None:
    it = None if state is None else replace(AMUSSEL, state=state, charge=charge)
    assert condition_of(it, now_ms, RULES) == (level, text)


SURE = pytest.approx((4 * 2.4477, 2 * 2.4477, 0.02), rel=1e-4)
"""2.4477 deviations to each side, of 2 m along east and 1 m along north."""


@pytest.mark.parametrize(
    ("place_cov", "others", "which", "shape"),
    [
        pytest.param(
            None,
            0,
            0,
            ("amussels", 7, 2, (20.0, 10.0, 0.0), (2.0, 2.0, 2.0), (0.25, 0.75, 0.1, 1.0), ""),
            id="a ball",
        ),
        pytest.param(
            None,
            0,
            1,
            ("labels", 7, 9, (20.0, 12.4, 2.4), (2.4, 2.4, 2.4), (1.0, 1.0, 1.0, 1.0), "7: 75 %"),
            id="its label",
        ),
        pytest.param(
            None,
            2,
            1,
            (
                "labels",
                7,
                9,
                pytest.approx((20.0, 17.2, 2.4)),
                (2.4, 2.4, 2.4),
                (1.0, 1.0, 1.0, 1.0),
                "7: 75 %",
            ),
            id="the label beside two others",
        ),
        pytest.param(
            (1.0, 0.0, 4.0),
            0,
            2,
            ("place_95", 7, 3, (20.0, 10.0, 0.0), SURE, (0.25, 0.75, 0.1, 0.3), ""),
            id="the ellipse of its place",
        ),
        pytest.param(
            (0.0, 0.0, 0.0),
            0,
            2,
            ("place_95", 7, 3, (20.0, 10.0, 0.0), (0.02, 0.02, 0.02), (0.25, 0.75, 0.1, 0.3), ""),
            id="a point, because RViz draws no scale of 0",
        ),
    ],
)
def test_an_aMussel_is_drawn(
    place_cov: tuple[float, float, float] | None, others: int, which: int, shape: tuple[object, ...]
) -> None:
    shapes = [*replace(AMUSSEL, place_cov=place_cov).shapes(2.0, others)]
    it = shapes[which]
    assert (it.group, it.number, it.kind, it.at, it.size_m, it.colour, it.text) == shape
    assert len(shapes) == (2 if place_cov is None else 3)


def test_the_aPad_is_an_arrow() -> None:
    it = apad_shape((1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8), 0.5)
    assert (it.group, it.number, it.kind) == ("apad", 0, 0)
    assert (it.at, it.attitude) == ((1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8))
    assert it.size_m == pytest.approx((1.5, 0.3, 0.3)) and it.colour == (1.0, 0.8, 0.0, 1.0)


def test_a_covariance_begins_with_east() -> None:
    assert place_matrix((4.0, 0.5, 9.0), 3) == [9.0, 0.5, 0.0, 0.5, 4.0, 0.0, 0.0, 0.0, 0.0]
    filled = {at: value for at, value in enumerate(place_matrix((4.0, 0.5, 9.0), 6)) if value}
    assert filled == {0: 9.0, 1: 0.5, 6: 0.5, 7: 4.0}
    assert place_matrix(None, 6) == [0.0] * 36


def test_a_track_has_points_half_a_metre_apart_and_forgets_the_oldest() -> None:
    track = APadTrack()
    for north_m, points in ((0.0, 1), (0.499, 1), (0.5, 2), (0.9, 2), (1.0, 3)):
        track.extend((north_m, 0.0))
        assert len(track.points_m) == points
    for n in range(3, 2500):
        track.extend((0.5 * n, 0.0))
    assert len(track.points_m) == 2000
    assert (track.points_m[0], track.points_m[-1]) == ((250.0, 0.0), (1249.5, 0.0))
