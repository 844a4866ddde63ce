"""A search for an aMussel that drifts: it goes where the aMussel will be, and not where it was."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import pytest
from scenario_files import POOL_FILE

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.docking.docking_search import SEARCH_S, DockingSearch
from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import CloseDock
from firmware_model.states import State

MISSION = load(POOL_FILE).mission
CATCH_M = MISSION.docking.catch_radius_m
REPORTS_MS = 3_000


def tries_until_caught(velocity_m_s: tuple[float, float], error_m: float, seed: int) -> int | None:
    """Flies a search: way, look, next point. The aMussel reports its place, with an error, as it drifts."""
    draw = random.Random(seed)
    config = replace(MISSION, speed_m_s=0.5)
    search = DockingSearch(CloseDock(1, 0, 4), round(1000 * SEARCH_S), config)
    reports: dict[int, tuple[float, float]] = {}
    here, now_ms = (0.0, 0.0), 0

    def place(at_ms: float) -> tuple[float, float]:
        return 2.0 + velocity_m_s[0] * at_ms / 1000, velocity_m_s[1] * at_ms / 1000

    for tries in range(1, 200):
        heard_ms = now_ms // REPORTS_MS * REPORTS_MS
        if heard_ms not in reports:
            reports[heard_ms] = tuple(it + draw.gauss(0, error_m) for it in place(heard_ms))  # type: ignore[assignment]
        belief = Belief(4, heard_ms, State.FLOATING, 0.5, 1.0, *reports[heard_ms])
        goal = search.next_point(belief, here, now_ms)
        now_ms += math.ceil(math.dist(here, goal) / config.speed_m_s) * 1000
        here = goal
        if now_ms > search.until_ms:
            return None
        if math.dist(here, place(now_ms)) <= CATCH_M:
            return tries
    return None


@pytest.mark.parametrize("direction_deg", [0, 45, 90, 200])
@pytest.mark.parametrize("speed_m_s", [0.1, 0.15, 0.25])
def test_what_drifts_steadily_is_caught_within_a_few_tries(speed_m_s: float, direction_deg: float) -> None:
    """5 m/s of wind at 3 % leeway are 0.15 m/s: a spiral about the last report stayed behind it for the whole search."""
    angle = math.radians(direction_deg)
    velocity = speed_m_s * math.cos(angle), speed_m_s * math.sin(angle)
    tries = tries_until_caught(velocity, 0.0, 1)
    assert tries is not None and tries <= 6


def test_reports_with_errors_are_led_too() -> None:
    found = [tries_until_caught((0.15, 0.0), 0.3, seed) for seed in range(40)]
    assert sum(it is not None for it in found) >= 30


def test_errors_of_reports_at_rest_are_no_drift() -> None:
    found = [tries_until_caught((0.0, 0.0), 0.3, seed) for seed in range(40)]
    assert all(it is not None for it in found)
