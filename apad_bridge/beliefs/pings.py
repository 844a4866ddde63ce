"""Whether an aMussel of which too little is known is worth waking: an answer costs it energy, and may change a plan."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Protocol

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.questions import Question


class PingPolicy(Protocol):
    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        """Whether to ping it at mission time `now_ms`."""
        ...

    def urgency(self, belief: Belief) -> float:
        """The greater, the sooner it is pinged, of those that are worth it."""
        ...


@dataclass(frozen=True, slots=True)
class WorthItsEnergy:
    """Pings when what a wrong plan is expected to cost exceeds what an answer does.

    The chance of deciding wrongly without asking is the smaller one of a question's two answers. Charges are of a primary
    battery: a wrong plan fetches one that needs nothing, or leaves one that does.
    """

    question: Question
    wrong_plan_charge: float
    """What deciding wrongly costs, as charge: a needless way up and down, or more."""
    answer_charge: float
    """What waking, answering and listening cost the aMussel."""
    not_before_ms: int
    """Mission time since the newest packet: one that was just heard has said what it can."""
    spare_charge: float
    """Below this, with all its uncertainty, nobody is woken to be asked."""
    answer_deviation: float
    """Of a charge as an answer says it: one that is known better learns nothing by asking."""

    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        if now_ms - belief.heard_ms < self.not_before_ms:
            return False
        if belief.charge_cov[0] <= self.answer_deviation**2:
            return False
        answer = self.question(belief)
        if min(answer, 1 - answer) * self.wrong_plan_charge <= self.answer_charge:
            return False
        return belief.charge_interval(0.9)[1] >= self.spare_charge

    def urgency(self, belief: Belief) -> float:
        return belief.charge_cov[0]


@dataclass(frozen=True, slots=True)
class WorthItsWay:
    """Pings when the aPad may have to look for it farther than an answer is worth.

    The way that is expected to be lost is the chance that it will be fetched times how far, by the standard deviation along
    both axes, it lies from where it is believed to be. A range says nothing of its charge.
    """

    question: Question
    """How probable it is that it has to be fetched."""
    answer_m: float
    """What an answer is worth, as metres of the aPad's way: the sound keeps others silent, and costs both energy."""

    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        return self.urgency(belief) > self.answer_m

    def urgency(self, belief: Belief) -> float:
        north, _, east = belief.place_cov
        return self.question(belief) * sqrt(north + east)


def to_ping(policy: PingPolicy, beliefs: list[Belief], now_ms: int) -> list[int]:
    """The ids that are worth a ping now, the most urgent first, for the water carries one word at a time."""
    worth = [belief for belief in beliefs if policy.is_worth(belief, now_ms)]
    worth.sort(key=lambda belief: (-policy.urgency(belief), belief.agent_id))
    return [belief.agent_id for belief in worth]
