"""The drift of aMussels, and the coverage of the believed ellipse of 95 %: with and without currents, at any theta.

The water knows mission time alone. The true amplitude of the drift and the true current differ from the filter's values
by up to a tenth.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from agents.time_scale import MissionMs, TimeScale
from apad_bridge.beliefs.measurement import TimeslotSilent
from apad_bridge.beliefs.twin import Twin
from apad_bridge.beliefs.twin_parameters import WaterParameters
from beliefs.filters import NOMINAL
from beliefs.truth import Array
from firmware_model.packets import StatusPacket
from firmware_model.states import State

AMPLITUDE_M = 0.05
CURRENT_M_S = 0.02
LASTS_S = 3600.0
FIX_M = 2.0
AGENTS = 60
REPORTS = 200
REPORT_AGENT_MS = 3_600_000
HEARD = 0.3
_CHI_95 = 5.991


def coverage(theta: int, currents: bool, seed: int = 11, agents: int = AGENTS) -> dict[str, Any]:
    """The share of report times at which the true place was in the ellipse. Without a current it is on the bottom."""
    rng = np.random.default_rng(seed)
    water = WaterParameters(AMPLITUDE_M**2 / 3, CURRENT_M_S if currents else 0.0, LASTS_S, FIX_M)
    board = replace(NOMINAL.board, float_timeout_ms=10**12)
    twin = Twin(replace(NOMINAL, scale=TimeScale(theta), water=water, board=board), {})
    state = State.FLOATING if currents else State.SLEEPING
    step_s = REPORT_AGENT_MS / 1000 / theta
    inside, error = [], []
    for agent in range(1, agents + 1):
        amplitude, current = AMPLITUDE_M * rng.uniform(0.9, 1.1), CURRENT_M_S * rng.uniform(0.9, 1.1)
        place, speed = rng.uniform(0, 50, 2), rng.normal(0, current, 2) * currents
        belief = None
        for number in range(REPORTS):
            now_ms = round(1000 * step_s * number)
            if number:
                place, speed = _drifted(rng, place, speed, round(step_s), amplitude, current * currents)
            if number == 0 or rng.random() < HEARD:
                north_m, east_m = place + rng.normal(0, FIX_M, 2)
                agent_ms = theta * now_ms
                packet = StatusPacket(agent, number, state, 0.9, 1.0, north_m, east_m, 0.0, agent_ms)
                belief = twin.update(belief, packet, MissionMs(now_ms))
            else:
                belief = twin.update(belief, TimeslotSilent(), MissionMs(now_ms))
            assert belief is not None
            north, both, east = belief.place_cov
            away = place - (belief.north_m, belief.east_m)
            distance = away @ np.linalg.solve([[north, both], [both, east]], away)
            inside.append(distance <= _CHI_95)
            error.append(away @ away / 2)
    return {
        "theta": theta,
        "currents": currents,
        "coverage": float(np.mean(inside)),
        "rmse_m": float(np.sqrt(np.mean(error))),
        "samples": len(inside),
    }


def _drifted(
    rng: np.random.Generator,
    place: Array,
    speed: Array,
    seconds: int,
    amplitude: float,
    current: float,
) -> tuple[Array, Array]:
    """Second by second: a uniform step, and a current that wanders."""
    keeps = np.exp(-1 / LASTS_S)
    if not current:
        return place + rng.uniform(-amplitude, amplitude, (seconds, 2)).sum(axis=0), speed
    gusts = rng.normal(0, current * np.sqrt(1 - keeps**2), (seconds, 2))
    for gust in gusts:
        place, speed = place + speed, keeps * speed + gust
    return place + rng.uniform(-amplitude, amplitude, (seconds, 2)).sum(axis=0), speed
