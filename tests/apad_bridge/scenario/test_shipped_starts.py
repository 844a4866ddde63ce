"""The shipped starts: the pool's reproduce the paper's "No charging" row; the bay's match their description."""

from __future__ import annotations

from pathlib import Path

import pytest

from apad_bridge.scenario.area.polygon import contains
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of

SCENARIOS = Path(__file__).parents[3] / "launch_scripts" / "scenarios"


def active_seconds(charge: float, theta: int, steps: int) -> int:
    """Computes equations (1) and (3) step by step: 1 s is 1/60 min, a step is active if charge is left after it."""
    active = 0
    for _ in range(steps):
        charge = max(0.0, charge - 0.0010427134 * theta * (1 / 60))
        active += charge > 0
    return active


def test_the_pool_without_charging_is_the_papers_row() -> None:
    starts = starts_of(load(SCENARIOS / "no-charging.yaml"))
    active = [active_seconds(start.primary, theta=30, steps=2400) for start in starts]
    uptimes = [100 * seconds / 2400 for seconds in active]
    assert sum(uptimes) / 12 == pytest.approx(67.36, abs=0.02)
    assert max(uptimes) == pytest.approx(79.56, abs=0.02)
    assert min(uptimes) == pytest.approx(56.64, abs=0.02)
    assert sum(active) / 2400 == pytest.approx(8.0837, abs=0.02)


@pytest.mark.parametrize(("name", "count", "lowest"), [("pool-12", 12, 0.7087), ("bay-24", 24, 0.6)])
def test_shipped_starts_lie_inside_and_apart(name: str, count: int, lowest: float) -> None:
    scenario = load(SCENARIOS / f"{name}.yaml")
    starts = starts_of(scenario)
    assert [start.agent_id for start in starts] == list(range(1, count + 1))
    assert all(contains(scenario.area.polygon_m, (start.north_m, start.east_m)) for start in starts)
    assert all(lowest <= start.primary < 1 for start in starts)
    assert len({(start.north_m, start.east_m) for start in starts}) == count
