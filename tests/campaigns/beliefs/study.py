"""Makes rows for the score: every filter at every share of packets received, on the same lives."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.mixture import Gaussian, below, below_strictly, normal_cdf
from apad_bridge.beliefs.modes import DOCKED, Mode
from beliefs import filters, peers
from beliefs.truth import Array, Doing, Life, live

REPORTED = (11, 12, 13)
TUNED_ON = 901
"""The peers are tuned on this seed in the run; the twin's numbers were tuned on this seed and the two that follow."""
HEARD = (1.0, 0.5, 0.1, 0.01)
OURS: dict[str, Callable[[Life, int, bool], Any]] = {
    "twin": filters.twin,
    "oracle": filters.oracle,
    "hold_last": filters.hold_last,
}
_MODES = {
    Doing.ASLEEP: (Mode.ASLEEP,),
    Doing.IDLE: (Mode.IDLE,),
    Doing.HIGH: (Mode.HIGH_LOAD,),
    Doing.SURFACING: (Mode.SURFACING,),
    Doing.FLOATING: (Mode.FLOATING,),
    Doing.DOCKED: DOCKED,
    Doing.SINKING: (Mode.IDLE,),
    Doing.EMPTY: (Mode.ASLEEP,),
}


@lru_cache(maxsize=4)
def life_of(seed: int, agents: int) -> Life:
    return live(seed, agents)


def heard_in(life: Life, share: float) -> Array:
    heard: npt.NDArray[np.bool_] = (life.luck < share) & ~life.dark
    return heard


def rows_of(name: str, seed: int, agents: int, knows_schedule: bool, share: float) -> tuple[Array, list[int]]:
    """Rows as in `score.COLUMNS`, and the delays of `mode_delays`."""
    life = life_of(seed, agents)
    heard = heard_in(life, share)
    rows: list[tuple[float, ...]] = []
    delays: list[int] = []
    for agent in range(agents):
        estimator = OURS[name](life, agent, knows_schedule)
        last = 0
        right_at: dict[int, bool] = {}
        for hour, belief in filters.beliefs(life, agent, estimator, heard[agent]):
            last = hour if heard[agent, hour] else last
            row = _row(belief, float(life.primary[agent, hour]), Doing(int(life.doing[agent, hour])))
            rows.append((hour - last, *row))
            if heard[agent, hour]:
                right_at[hour] = bool(row[-2])
        delays += mode_delays(life, agent, right_at)
    return np.array(rows), delays


def _row(belief: Belief, truth: float, doing: Doing) -> tuple[float, ...]:
    parts = belief.parts or (Gaussian(1.0, belief.primary, math.sqrt(belief.charge_cov[0])),)
    ends = below(parts, 0.0) + 1 - below_strictly(parts, 1.0)
    return (
        truth,
        belief.primary,
        belief.charge_cov[0],
        below(parts, truth),
        below_strictly(parts, truth),
        float(belief.mode in _MODES[doing]),
        ends,
    )


def mode_delays(life: Life, agent: int, right_at: dict[int, bool]) -> list[int]:
    """For each unscheduled switch: the number of packets after the first one received since then until the mode is right.

    0 is the first packet itself. A switch after which no packet is received is not counted.
    """
    alone = life.doing[agent] <= Doing.HIGH
    switched = np.flatnonzero(life.unscheduled[agent] & alone)
    hours = sorted(right_at)
    found = []
    for hour in switched:
        after = [right_at[one] for one in hours if one >= hour]
        if any(after):
            found.append(after.index(True))
    return found


def peer_rows(name: str, seeds: tuple[int, ...], agents: int, share: float) -> tuple[Array, dict[str, Any]]:
    """Rows of a peer on all seeds, and its tuning and check."""
    make, grid = (peers.kalman, peers.KALMAN_GRID) if name == "kalman" else (peers.imm, peers.IMM_GRID)
    other = life_of(TUNED_ON, agents)
    peer = peers.tuned(make, grid, other, heard_in(other, share))
    found = []
    for seed in seeds:
        life = life_of(seed, agents)
        heard = heard_in(life, share)
        means, variances, models = peers.run(peer, life, heard)
        right = peers.modes_right(models, life)
        hours = np.arange(means.shape[1])
        last = np.maximum.accumulate(np.where(heard, hours, -1), axis=1)
        known = last >= 0
        mean, truth = np.clip(means[known], 0, 1), life.primary[known]
        sd = np.sqrt(np.maximum(variances[known], 1e-12))
        tail = np.array([normal_cdf(float(z)) for z in (truth - means[known]) / sd])
        low, high = np.where(truth >= 1, 1.0, tail), np.where(truth <= 0, 0.0, tail)
        at_an_end = ((means[known] <= 0) | (means[known] >= 1)).astype(float)
        age = (hours - last)[known]
        found.append(
            np.column_stack([age, truth, mean, variances[known], low, high, right[known], at_an_end])
        )
    first = life_of(seeds[0], agents)
    return np.concatenate(found), {
        "differs_from_filterpy": peers.like_filterpy(peer, first, heard_in(first, share), 0)
    }
