"""Compares beliefs with the truth in a recorded run, at times a period apart: from its bags, or from its journal.

A bag has the beliefs and their deviations at each of its samples. A journal repeats a belief only when it has changed
noticeably, and has no deviation of a place. The journal is for runs that still fly, whose bag is not closed yet, and for
bags of versions that recorded the means only.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from agents.time_scale import MissionMs, TimeScale
from apad_bridge.analysis.belief_scores.crps import crps
from apad_bridge.analysis.replay.history import History
from apad_bridge.beliefs.mixture import Gaussian
from apad_bridge.beliefs.modes import Mode, mode_of
from apad_bridge.records.bag_samples import BagUnreadable, Instant, instants, why_no_deviations
from apad_bridge.records.journal import read_journal
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.records.samples import BeliefSample, TruthExtrapolator, TruthSample
from apad_bridge.scenario.schema import Scenario
from firmware_model.states import State

_HALF_RESTS = 0.683
_CERTAIN = 1e-6
"""A belief with a smaller deviation rests at full or at empty."""
_Z_95 = 1.959964
"""The half width of a Gaussian's central interval of 95 %, in deviations."""
_MEETS_AN_END = 3.0
"""A Gaussian whose mean is nearer to 0 or 1 than so many deviations was cut there."""


class Record(StrEnum):
    BAG = "bag"
    JOURNAL = "journal"


@dataclass(frozen=True, slots=True)
class ChargeComparison:
    """The believed and the true charge of one battery; `deviation` is None for a belief without uncertainty."""

    error: float
    """The believed minus the true charge."""
    deviation: float | None
    covered: bool | None
    """True if the truth lay in the interval of 95 %."""
    width: float | None
    """The width of that interval."""
    clamped: bool
    """True if the truth rests at 0 or 1, or more than half of the belief does."""
    crps: float
    """`apad_bridge.analysis.belief_scores.crps`; the absolute error of a belief without uncertainty."""


@dataclass(frozen=True, slots=True)
class BeliefComparison:
    """One aMussel's belief and truth at one time. The age is agent time since the newest packet."""

    agent_id: int
    at_ms: int
    age_h: float
    mode: Mode
    """The true mode."""
    is_released: bool
    """True if it floats after a release and waits until it is clear to sink: a part of the mode FLOATING."""
    mode_right: bool
    primary: ChargeComparison
    secondary: ChargeComparison | None
    """None where the record has no deviation of the secondary battery's charge."""
    place_error_m: float | None
    """None in a dock, where the place is the aPad's."""
    place_square: float | None = None
    """The square of that error in deviations, in two dimensions; None without deviations."""


def best_record(run_dir: Path) -> tuple[Record, str | None]:
    """The bag, if all of the run's bags are closed and have deviations; else the journal, and why it is not the bag.

    RunDirectoryError for no run.
    """
    if not (bags := RunDirectory.open(run_dir).bags):
        return Record.JOURNAL, f"{run_dir}: it has no bag"
    why_not = next(filter(None, map(why_no_deviations, bags)), None)
    return (Record.BAG if why_not is None else Record.JOURNAL), why_not


def comparisons_in(run_dir: Path, period_ms: int, record: Record) -> Iterator[BeliefComparison]:
    """Yields a comparison for every aMussel with belief and truth in `record`.

    RunDirectoryError, one line, when the directory holds no such run.
    """
    directory = RunDirectory.open(run_dir)
    if record is Record.BAG:
        if not directory.bags:
            raise RunDirectoryError(f"{run_dir} holds no bag")
        try:
            for instant in instants(directory.bags, period_ms):
                yield from _in_bag_at(instant)
        except BagUnreadable as error:
            raise RunDirectoryError(f"{error}; try --from journal") from error
        return
    scenario = directory.load_scenario()
    history = History(read_journal(directory.journal), scenario)
    water = TruthExtrapolator(scenario)
    for now_ms in map(MissionMs, range(0, history.end_ms + 1, period_ms)):
        try:
            history.advance(now_ms)
        except ValueError as error:
            raise RunDirectoryError(
                f"{directory.journal} has a line that this version does not read ({error!r}): "
                "look at the run with the version that flew it"
            ) from error
        yield from _in_journal_at(history, water, scenario, now_ms)


def _in_bag_at(instant: Instant) -> Iterator[BeliefComparison]:
    truths = {truth.agent_id: truth for truth in instant.truths}
    scale = TimeScale(round(instant.agent_ms / instant.at_ms) if instant.at_ms else 1)
    for belief in instant.beliefs:
        truth = truths.get(belief.agent_id)
        if truth is not None:
            yield compared(belief, truth, instant.at_ms, scale)


def compared(belief: BeliefSample, truth: TruthSample, at_ms: int, scale: TimeScale) -> BeliefComparison:
    """Compares the samples of one aMussel at mission time `at_ms`."""
    return BeliefComparison(
        agent_id=belief.agent_id,
        at_ms=at_ms,
        age_h=scale.agent_time(belief.age_s) / 3600,
        mode=(mode := _true_mode(truth)),
        is_released=truth.state == State.RELEASED,
        mode_right=_believed_mode(belief) is mode,
        primary=_charge_compared(
            belief.charge,
            truth.primary,
            _or_none(belief.charge_deviation),
            (belief.charge_low, belief.charge_high),
            [Gaussian._make(part) for part in zip(*[iter(belief.charge_parts)] * 3, strict=True)],
        ),
        secondary=_secondary_compared(belief, truth),
        place_error_m=None
        if truth.docked
        else math.hypot(belief.north_m - truth.north_m, belief.east_m - truth.east_m),
        place_square=None if truth.docked else _place_square(belief, truth),
    )


def _secondary_compared(belief: BeliefSample, truth: TruthSample) -> ChargeComparison | None:
    """The secondary's belief is one Gaussian held in [0, 1], which records hold by its moments.

    Where it meets an end its density is highest there, so its shortest interval reaches the end.
    """
    if (deviation := _or_none(belief.secondary_deviation)) is None:
        return None
    charge, half = belief.secondary, _Z_95 * deviation + _CERTAIN
    reach = _MEETS_AN_END * deviation + _CERTAIN
    low = 0.0 if charge <= reach else charge - half
    high = 1.0 if 1 - charge <= reach else charge + half
    return _charge_compared(charge, truth.secondary, deviation, (low, high))


def _charge_compared(
    believed: float,
    true: float,
    deviation: float | None,
    interval: tuple[float, float],
    parts: Sequence[Gaussian] = (),
) -> ChargeComparison:
    """`parts` is empty where the record has the moments alone."""
    low, high = interval
    clamped = not 0 < true < 1 or (deviation is not None and _rests(believed, deviation))
    if deviation is None:
        return ChargeComparison(believed - true, None, None, None, clamped, abs(believed - true))
    score = crps(parts or [Gaussian(1.0, believed, deviation)], true)
    return ChargeComparison(believed - true, deviation, low <= true <= high, high - low, clamped, score)


def _or_none(number: float) -> float | None:
    return None if math.isnan(number) else number


def _true_mode(truth: TruthSample) -> Mode:
    return mode_of(State(truth.state), truth.primary, truth.secondary)


def _believed_mode(belief: BeliefSample) -> Mode:
    if not belief.mode_probabilities:
        return mode_of(State(belief.state), belief.charge, belief.secondary)
    return Mode(max(range(len(belief.mode_probabilities)), key=belief.mode_probabilities.__getitem__))


def _rests(charge: float, deviation: float) -> bool:
    """True if more than half of a Gaussian clamped to [0, 1] rests at 0 or 1, by its moments after clamping.

    Half of it does at a mean of 1, and clamping leaves a mean of 1 - 0.399 and a deviation of 0.584 of the Gaussian's.
    """
    return min(charge, 1 - charge) < _HALF_RESTS * deviation or deviation < _CERTAIN


def _place_square(belief: BeliefSample, truth: TruthSample) -> float | None:
    """The squared Mahalanobis distance; None for a place without deviations, or with negligible ones."""
    north, east = belief.north_deviation_m**2, belief.east_deviation_m**2
    across = belief.place_covariance_m2
    determinant = north * east - across * across
    if not determinant > 0:
        return None
    d_north, d_east = belief.north_m - truth.north_m, belief.east_m - truth.east_m
    return (east * d_north**2 - 2 * across * d_north * d_east + north * d_east**2) / determinant


def _in_journal_at(
    history: History, water: TruthExtrapolator, scenario: Scenario, now_ms: MissionMs
) -> Iterator[BeliefComparison]:
    for agent_id, belief in sorted(history.now.beliefs.items()):
        if (truth := history.now.truths.get(agent_id)) is None:
            continue
        sample = water.sample(truth, max(scenario.time_scale.agent_ms(now_ms), truth.at_ms))
        mode = _true_mode(sample)
        interval = _or_nan(belief.low), _or_nan(belief.high)
        yield BeliefComparison(
            agent_id=agent_id,
            at_ms=now_ms,
            age_h=scenario.time_scale.agent_span(now_ms - belief.heard) / 3_600_000,
            mode=mode,
            is_released=sample.state == State.RELEASED,
            mode_right=belief.likely_mode is mode,
            primary=_charge_compared(belief.charge, sample.primary, belief.sd, interval),
            secondary=None,
            place_error_m=None
            if sample.docked
            else math.hypot(belief.north_m - sample.north_m, belief.east_m - sample.east_m),
        )


def _or_nan(number: float | None) -> float:
    return math.nan if number is None else number
