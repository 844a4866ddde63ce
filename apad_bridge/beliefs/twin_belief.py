"""Converts a twin's state of one aMussel to a belief, at the state's own time."""

from __future__ import annotations

import math

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief, CapacityLeft, Source
from apad_bridge.beliefs.charge_filter import PRIMARY, RATE, SECONDARY
from apad_bridge.beliefs.mixture import Gaussian, below, clamped
from apad_bridge.beliefs.modes import FULL_CHARGE, SUBMERGED, Mode
from apad_bridge.beliefs.twin_parameters import TwinParameters
from apad_bridge.beliefs.twin_state import (
    TwinState,
    in_dock,
    load_of_all,
    obey_probability,
    primary_parts,
)
from firmware_model.states import State

_CERTAIN = 1e-9
_SDS_OF_95 = 1.959964


def belief_from_state(
    twin_state: TwinState,
    parameters: TwinParameters,
    agent_id: int,
    heard_ms: MissionMs,
    state: State,
    at_ms: int,
    learned_from: Source,
    silent_timeslots: int,
) -> Belief:
    """The belief for mission time `at_ms`; it contains the twin state, from which the next belief is made."""
    if twin_state.situation is Mode.CHARGING_PRIMARY:
        rows = in_dock(twin_state, parameters)
        parts = tuple(
            Gaussian(anchor.weight, mean, math.sqrt(variance))
            for anchor, ((mean, variance, _, _), _) in zip(twin_state.anchors, rows, strict=True)
        )
        second = Gaussian(1.0, rows[0][1][0], math.sqrt(rows[0][1][1]))
        both = 0.0
        modes = _docked(parts, second)
    else:
        parts = primary_parts(twin_state, parameters)
        gave, gave_sd = twin_state.from_secondary
        cov = twin_state.cov
        second = Gaussian(
            1.0,
            twin_state.mean.item(SECONDARY) - gave,
            math.sqrt(cov.item(SECONDARY, SECONDARY) + gave_sd**2),
        )
        both = cov.item(PRIMARY, SECONDARY)
        modes = _in_the_water(twin_state, parameters, parts, second)
    primary, variance = _moments(parts)
    afloat = twin_state.situation in (Mode.SURFACING, Mode.FLOATING)
    north_m, east_m, place_cov = twin_state.place.position_after(
        parameters.water, (at_ms - twin_state.place_ms) / 1000, afloat
    )
    secondary, its_variance = clamped(second.mean, second.sd**2)
    return Belief(
        agent_id=agent_id,
        heard_ms=heard_ms,
        state=state,
        primary=primary,
        secondary=secondary,
        north_m=north_m,
        east_m=east_m,
        predicted_ms=at_ms - heard_ms,
        charge_cov=(variance, both, its_variance),
        place_cov=place_cov,
        mode_probabilities=modes,
        clock=twin_state.clock,
        learned_from=learned_from,
        silent_timeslots=silent_timeslots,
        suspicion=twin_state.suspicion,
        parts=parts,
        capacity_left=_capacity_left(twin_state, parameters),
        reported=twin_state.reported,
        estimator_state=twin_state,
    )


def _capacity_left(twin_state: TwinState, parameters: TwinParameters) -> CapacityLeft | None:
    """From the charging rate, which is 1 / capacity on the scale of voltage, within the range that the twin is told."""
    if parameters.untold is None:
        return None
    least, mean, square = 1 - parameters.untold.ageing, 0.0, 0.0
    for weight, its_mean, cov in twin_state.anchors:
        mean += weight * float(its_mean[RATE])
        square += weight * (float(cov[RATE, RATE]) + float(its_mean[RATE]) ** 2)
    aside = _SDS_OF_95 * math.sqrt(max(0.0, square - mean**2))
    # A rate at or below 1 is that of a battery without age, whatever the scatter of the readings made of it.
    low, high = (1 / max(1.0, mean + aside), 1 / max(1.0, mean - aside))
    return CapacityLeft(max(least, low), max(least, high))


def _moments(parts: tuple[Gaussian, ...]) -> tuple[float, float]:
    """Mean and variance of the mixture, clamped to [0, 1]."""
    if len(parts) == 1:
        return clamped(parts[0][1], parts[0][2] ** 2)
    mean = square = 0.0
    for weight, its_mean, sd in parts:
        first, variance = clamped(its_mean, sd * sd)
        mean += weight * first
        square += weight * (variance + first * first)
    return mean, max(0.0, square - mean * mean)


def _docked(primary: tuple[Gaussian, ...], secondary: Gaussian) -> tuple[float, ...]:
    charging = below(primary, FULL_CHARGE)
    second = (1 - charging) * below((secondary,), FULL_CHARGE)
    probabilities = [0.0] * len(Mode)
    probabilities[Mode.CHARGING_PRIMARY] = charging
    probabilities[Mode.CHARGING_SECONDARY] = second
    probabilities[Mode.FULL] = 1 - charging - second
    return tuple(probabilities)


def _in_the_water(
    twin_state: TwinState, parameters: TwinParameters, parts: tuple[Gaussian, ...], secondary: Gaussian
) -> tuple[float, ...]:
    probabilities = [0.0] * len(Mode)
    empty = below(parts, 0.0)
    lost = empty * below((secondary,), 0.0) if empty > _CERTAIN else 0.0
    obeyed, pending = obey_probability(twin_state, parameters, twin_state.at_ms), twin_state.pending
    if twin_state.situation is not None:
        # Modes leave `earlier` out: where most permissions are lost, an aPad that counts on it searches for nobody.
        probabilities[twin_state.situation] = obeyed * (1 - lost)
        by_mode, share = (twin_state.unobeyed or (twin_state.load, 0))[0].by_mode, (1 - obeyed) * (1 - lost)
    else:
        by_mode, share = load_of_all(twin_state, parameters).by_mode, 1 - lost
        if pending is not None:
            not_yet = (1 - pending.spent_by(twin_state.at_ms)) * share
            probabilities[pending.mode] = not_yet
            share -= not_yet
    # With an empty primary it sleeps on the secondary, whatever was planned.
    asleep_on_backup = max(0.0, empty - lost) * share
    for mode in SUBMERGED:
        probabilities[mode] += by_mode[mode][0] * (share - asleep_on_backup)
    probabilities[Mode.ASLEEP] += asleep_on_backup
    probabilities[Mode.LOST] = lost
    return tuple(probabilities)
