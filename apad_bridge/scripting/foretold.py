"""What a script asks of the time to come: how probable something is by then, and from when on it is sure.

The answers are the estimator's, were nothing more heard and nothing more done until then.
"""

from __future__ import annotations

import math

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet import Estimator
from apad_bridge.beliefs.questions import Question, by, candidate_below, full_above, lost, sure_at_ms
from apad_bridge.mission.values import Refused
from apad_bridge.scenario.schema import Mission

_STEP_MS = 60_000
_STEPS = 200
"""At most: who looks far ahead looks in longer steps."""


def question_of(question: str | Question, config: Mission) -> Question:
    """A question by its name, as the scenario means it; or one of the script's own. Refused for another name."""
    if not isinstance(question, str):
        return question
    named = {
        "low": candidate_below(config.pool_threshold),
        "full": full_above(config.full_threshold),
        "lost": lost,
    }
    if question not in named:
        raise Refused(f"there is no question {question!r}: ask {', '.join(named)}, or a function of a belief")
    return named[question]


def chance(estimator: Estimator, belief: Belief, question: Question, at_ms: int, now_ms: int) -> float:
    """The probability at mission time `at_ms`, `now_ms` or later; 0 or 1 of what is simply believed."""
    if at_ms < now_ms:
        raise Refused(f"{at_ms / 1000:.0f} s are over: it is {now_ms / 1000:.0f} s")
    if at_ms > now_ms:
        _refuse_held(belief)
    return by(estimator, belief, question, at_ms)


def sure_at(
    estimator: Estimator, belief: Belief, question: Question, share: float, now_ms: int, within_ms: int
) -> float | None:
    """Mission seconds from which on the answer is `share` or more; None if that is not so within `within_ms`."""
    if not 0 < share <= 1:
        raise Refused(f"a share of {share}: it must be above 0 and at most 1")
    _refuse_held(belief)
    step_ms = max(_STEP_MS, math.ceil(within_ms / _STEPS))
    found_ms = sure_at_ms(estimator, belief, question, share, now_ms + within_ms, step_ms)
    return None if found_ms is None else found_ms / 1000


def _refuse_held(belief: Belief) -> None:
    if not belief.is_carried:
        raise Refused(
            "this scenario's estimator believes the last packet and foretells nothing: say beliefs: {estimator: twin} in it"
        )
