"""Questions of a planner to beliefs: the probability of something at a time, and the time from which it is sure."""

from __future__ import annotations

from collections.abc import Callable

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet_beliefs import Estimator
from apad_bridge.beliefs.modes import DOCKED, Mode

Question = Callable[[Belief], float]
"""The probability of something, according to a belief."""


def candidate_below(threshold: float) -> Question:
    """The aMussel is in the water, able to come up, and at or below `threshold`."""

    def probability(belief: Belief) -> float:
        elsewhere = belief.probability_of(*DOCKED, Mode.LOST)
        return min(belief.probability_at_most(threshold), 1 - elsewhere)

    return probability


def lost(belief: Belief) -> float:
    return belief.probability_of(Mode.LOST)


def full_above(threshold: float) -> Question:
    return lambda belief: 1 - belief.probability_at_most(threshold)


def probability_at(estimator: Estimator, belief: Belief, question: Question, at_ms: MissionMs) -> float:
    """The probability at mission time `at_ms`, if nothing more is received until then."""
    return question(estimator.predict(belief, MissionMs(max(at_ms, belief.at_ms))))


def sure_at_ms(
    estimator: Estimator, belief: Belief, question: Question, share: float, until_ms: int, step_ms: int
) -> int | None:
    """The mission time from which the answer is `share` or more, if nothing more is received.

    The search tests every `step_ms`, then bisects to a second; None if the time lies after `until_ms`. Each step continues
    from the one before, so that the cost grows only linearly with the span. ValueError if `step_ms` is not positive.
    """
    if step_ms <= 0:
        raise ValueError(f"a step must be positive, not {step_ms}")
    before = belief
    while question(before) < share:
        if before.at_ms >= until_ms:
            return None
        after = estimator.predict(before, MissionMs(min(until_ms, before.at_ms + step_ms)))
        if after.at_ms <= before.at_ms:
            return None  # the estimator does not predict
        if question(after) >= share:
            return _within_a_second(estimator, before, after.at_ms, question, share)
        before = after
    return before.at_ms


def _within_a_second(
    estimator: Estimator, before: Belief, after_ms: int, question: Question, share: float
) -> int:
    low_ms, high_ms = before.at_ms, after_ms
    while high_ms - low_ms > 1000:
        middle_ms = MissionMs((low_ms + high_ms) // 2)
        if question(estimator.predict(before, middle_ms)) >= share:
            high_ms = middle_ms
        else:
            low_ms = middle_ms
    return high_ms
