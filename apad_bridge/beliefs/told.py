"""What a twin tells others of one aMussel: the memory of it, read at the time that it stands at."""

from __future__ import annotations

import math

from apad_bridge.beliefs.belief import Belief, Source
from apad_bridge.beliefs.charge_state import PRIMARY, SECONDARY
from apad_bridge.beliefs.knowledge import Knowledge
from apad_bridge.beliefs.memory import Memory, in_dock, obeys, primary_parts
from apad_bridge.beliefs.mixture import Part, below, held
from apad_bridge.beliefs.modes import FULL_CHARGE, SUBMERGED, Mode
from firmware_model.states import State

_CERTAIN = 1e-9


def told(
    memory: Memory,
    knowledge: Knowledge,
    agent_id: int,
    heard_ms: int,
    state: State,
    at_ms: int,
    learned_from: Source,
    silent_timeslots: int,
) -> Belief:
    """The belief for mission time `at_ms`, with the memory in it from which the next one is made."""
    if memory.situation is Mode.CHARGING_PRIMARY:
        rows = in_dock(memory, knowledge)
        parts = tuple(
            Part(anchor.weight, mean, math.sqrt(variance))
            for anchor, ((mean, variance, _), _) in zip(memory.anchors, rows, strict=True)
        )
        second = Part(1.0, rows[0][1][0], math.sqrt(rows[0][1][1]))
        both = 0.0
        modes = _docked(parts, second)
    else:
        parts = primary_parts(memory, knowledge)
        gave, gave_sd = memory.from_secondary
        cov = memory.cov
        second = Part(
            1.0,
            float(memory.mean[SECONDARY]) - gave,
            math.sqrt(float(cov[SECONDARY, SECONDARY]) + gave_sd**2),
        )
        both = float(cov[PRIMARY, SECONDARY])
        modes = _in_the_water(memory, knowledge, parts, second)
    primary, variance = _moments(parts)
    afloat = memory.situation in (Mode.SURFACING, Mode.FLOATING)
    north_m, east_m, place_cov = memory.place.after(knowledge.water, (at_ms - memory.place_ms) / 1000, afloat)
    secondary, its_variance = held(second.mean, second.sd**2)
    return Belief(
        agent_id,
        heard_ms,
        state,
        primary,
        secondary,
        north_m,
        east_m,
        at_ms - heard_ms,
        (variance, both, its_variance),
        place_cov,
        modes,
        memory.clock,
        learned_from,
        silent_timeslots,
        parts,
        memory,
    )


def _moments(parts: tuple[Part, ...]) -> tuple[float, float]:
    """Mean and variance of the mixture, its ends held."""
    if len(parts) == 1:
        return held(parts[0][1], parts[0][2] ** 2)
    mean = square = 0.0
    for weight, its_mean, sd in parts:
        first, variance = held(its_mean, sd * sd)
        mean += weight * first
        square += weight * (variance + first * first)
    return mean, max(0.0, square - mean * mean)


def _docked(primary: tuple[Part, ...], secondary: Part) -> tuple[float, ...]:
    charging = below(primary, FULL_CHARGE)
    second = (1 - charging) * below((secondary,), FULL_CHARGE)
    probabilities = [0.0] * len(Mode)
    probabilities[Mode.CHARGING_PRIMARY] = charging
    probabilities[Mode.CHARGING_SECONDARY] = second
    probabilities[Mode.FULL] = 1 - charging - second
    return tuple(probabilities)


def _in_the_water(
    memory: Memory, knowledge: Knowledge, parts: tuple[Part, ...], secondary: Part
) -> tuple[float, ...]:
    probabilities = [0.0] * len(Mode)
    empty = below(parts, 0.0)
    lost = empty * below((secondary,), 0.0) if empty > _CERTAIN else 0.0
    obeyed = obeys(memory, knowledge)
    if memory.situation is not None:
        probabilities[memory.situation] = obeyed * (1 - lost)
        by_mode, share = (memory.unobeyed or (memory.load, 0))[0].by_mode, (1 - obeyed) * (1 - lost)
    else:
        by_mode, share = memory.load.by_mode, 1 - lost
    # With an empty primary it sleeps on the other battery, whatever was planned.
    asleep_for_want = max(0.0, empty - lost) * share
    for mode in SUBMERGED:
        probabilities[mode] += by_mode[mode][0] * (share - asleep_for_want)
    probabilities[Mode.ASLEEP] += asleep_for_want
    probabilities[Mode.LOST] = lost
    return tuple(probabilities)
