"""What a planner asks of beliefs: how probable something is by a time, and when it will be sure."""

from __future__ import annotations

from collections.abc import Callable

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet import Estimator
from apad_bridge.beliefs.modes import DOCKED, Mode

Question = Callable[[Belief], float]
"""The probability of something, by a belief."""


def candidate_below(threshold: float) -> Question:
    """In the water, able to come up, and at or below `threshold`."""

    def probability(belief: Belief) -> float:
        elsewhere = belief.probability_of(*DOCKED, Mode.LOST)
        return min(belief.probability_at_most(threshold), 1 - elsewhere)

    return probability


def lost(belief: Belief) -> float:
    return belief.probability_of(Mode.LOST)


def full_above(threshold: float) -> Question:
    return lambda belief: 1 - belief.probability_at_most(threshold)


def by(estimator: Estimator, belief: Belief, question: Question, at_ms: int) -> float:
    """The probability at mission time `at_ms`, were nothing more heard until then."""
    return question(estimator.predict(belief, max(at_ms, belief.at_ms)))


def sure_at_ms(
    estimator: Estimator, belief: Belief, question: Question, share: float, until_ms: int, step_ms: int
) -> int | None:
    """From when on the answer is `share` or more, were nothing more heard: looked for every `step_ms`, then to a second.

    None if that is not so by `until_ms`. Each step goes on from the one before, so that looking far costs what it is long.
    """
    if step_ms <= 0:
        raise ValueError(f"a step must be positive, not {step_ms}")
    before = belief
    while question(before) < share:
        if before.at_ms >= until_ms:
            return None
        after = estimator.predict(before, min(until_ms, before.at_ms + step_ms))
        if after.at_ms <= before.at_ms:
            return None  # an estimator that does not go on by itself
        if question(after) >= share:
            return _within_a_second(estimator, before, after.at_ms, question, share)
        before = after
    return before.at_ms


def _within_a_second(
    estimator: Estimator, before: Belief, after_ms: int, question: Question, share: float
) -> int:
    low_ms, high_ms = before.at_ms, after_ms
    while high_ms - low_ms > 1000:
        middle_ms = (low_ms + high_ms) // 2
        if question(estimator.predict(before, middle_ms)) >= share:
            high_ms = middle_ms
        else:
            low_ms = middle_ms
    return high_ms
