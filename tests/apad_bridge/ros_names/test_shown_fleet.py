"""The tables of statuses, levels, colours and shapes, written down a second time, with the messages' own numbers."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scenario_files import POOL_FILE

from apad_bridge.beliefs.modes import Mode
from apad_bridge.ros_names.shown_fleet import APadTrack, ShownAMussel, apad_shape, condition_of, place_matrix
from apad_bridge.scenario.loader import load
from firmware_model.states import State

AMUSSEL = ShownAMussel(7, State.ACTIVE, Mode.IDLE, 0.75, 0.5, (10.0, 20.0), 3.0, None, 1000, 1000, False)
RULES = replace(load(POOL_FILE).mission, silence_timeout_s=120.0, pool_threshold=0.5)


@pytest.mark.parametrize("mode", Mode)
def test_a_battery_charges_in_a_dock_until_both_are_full(mode: Mode) -> None:
    of_dock = {Mode.CHARGING_PRIMARY: 1, Mode.CHARGING_SECONDARY: 1, Mode.FULL: 4}
    assert replace(AMUSSEL, mode=mode).supply_status == of_dock.get(mode, 2)


def test_a_battery_is_dead_when_it_is_empty_or_its_aMussel_lost() -> None:
    assert AMUSSEL.health == 1 and replace(AMUSSEL, charge=0.001).health == 1
    assert replace(AMUSSEL, charge=0.0).health == 3
    assert replace(AMUSSEL, state=State.LOST).health == 3


def test_its_cells_are_on_the_papers_scale() -> None:
    assert AMUSSEL.cells_v == pytest.approx([4.05, 3.9])
    assert replace(AMUSSEL, charge=0.0, secondary=1.0).cells_v == [3.6, 4.2]


def test_a_ball_is_red_when_empty_green_when_full_cyan_in_a_dock_and_grey_when_lost() -> None:
    assert AMUSSEL.colour == (0.25, 0.75, 0.1, 1.0)
    assert replace(AMUSSEL, charge=0.0).colour == (1.0, 0.0, 0.1, 1.0)
    assert replace(AMUSSEL, is_docked=True).colour == (0.0, 0.8, 0.9, 1.0)
    assert replace(AMUSSEL, is_docked=True, state=State.LOST).colour == (0.4, 0.4, 0.4, 1.0)


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
    ],
)
def test_the_worst_is_told(state: State, charge: float, now_ms: int, level: int, text: str) -> None:
    it = replace(AMUSSEL, state=state, charge=charge)
    assert condition_of(it, now_ms, RULES) == (level, text)


def test_one_that_was_never_heard_is_stale() -> None:
    assert condition_of(None, 0, RULES) == (3, "no report yet")


def test_an_aMussel_is_a_ball_a_label_and_the_ellipse_of_its_place() -> None:
    ball, label = AMUSSEL.shapes(2.0, 0)
    assert (ball.group, ball.number, ball.kind, ball.at) == ("amussels", 7, 2, (20.0, 10.0, 0.0))
    assert (ball.size_m, ball.colour, ball.text) == ((2.0, 2.0, 2.0), AMUSSEL.colour, "")
    assert (label.group, label.number, label.kind, label.text) == ("labels", 7, 9, "7: 75 %")
    assert (label.at, label.size_m) == ((20.0, 12.4, 2.4), (2.4, 2.4, 2.4))
    assert label.colour == (1.0, 1.0, 1.0, 1.0)
    *_, beside = AMUSSEL.shapes(2.0, 2)
    assert beside.at == pytest.approx((20.0, 10.0 + 3 * 2.4, 2.4))

    *_, disc = replace(AMUSSEL, place_cov=(1.0, 0.0, 4.0)).shapes(2.0, 0)
    assert (disc.group, disc.number, disc.kind, disc.at) == ("place_95", 7, 3, (20.0, 10.0, 0.0))
    # 2.4477 deviations to each side, of 2 m along east and 1 m along north.
    assert disc.size_m == pytest.approx((4 * 2.4477, 2 * 2.4477, 0.02), rel=1e-4)
    assert disc.colour == (0.25, 0.75, 0.1, 0.3)
    *_, point = replace(AMUSSEL, place_cov=(0.0, 0.0, 0.0)).shapes(2.0, 0)
    assert point.size_m == (0.02, 0.02, 0.02), "RViz draws no scale of 0"


def test_the_aPad_is_an_arrow() -> None:
    it = apad_shape((1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8), 0.5)
    assert (it.group, it.number, it.kind, it.at, it.attitude) == (
        "apad",
        0,
        0,
        (1.0, 2.0, 0.0),
        (0.0, 0.0, 0.6, 0.8),
    )
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
