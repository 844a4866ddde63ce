"""Ping policies: an answer of an uncertain aMussel costs it energy, but may change a plan."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt
from typing import Protocol

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.questions import Question


class PingPolicy(Protocol):
    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        """True if the aMussel should be pinged at mission time `now_ms`."""

    def urgency(self, belief: Belief) -> float:
        """Among the aMussels worth a ping, the most urgent is pinged first."""


@dataclass(frozen=True, slots=True)
class PingForCharge:
    """Pings when the expected cost of a wrong plan exceeds the cost of an answer.

    The chance of a wrong decision without asking is the smaller probability of a question's two answers. Charges are of a
    primary battery: a wrong plan fetches an aMussel that needs nothing, or leaves one that needs charge.
    """

    question: Question
    wrong_plan_charge: float
    """The cost of a wrong decision, as charge: a needless way up and down, or more."""
    answer_charge: float
    """The charge that waking, answering and listening cost the aMussel."""
    not_before_ms: int
    """Mission time since the newest packet: sooner, a ping would learn nothing new."""
    spare_charge: float
    """An aMussel whose charge lies below this, with all its uncertainty, is not woken."""
    answer_deviation: float
    """Deviation of a charge in an answer: asking does not improve a charge that is known better."""

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
class PingSuspects:
    """Pings each aMussel whose packets contradict physics, and the others by another policy."""

    others: PingPolicy | None
    """None: the others are not pinged."""
    not_before_ms: int
    """Mission time since the newest packet."""

    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        if belief.suspicion is not None:
            return now_ms - belief.heard_ms >= self.not_before_ms
        return self.others is not None and self.others.is_worth(belief, now_ms)

    def urgency(self, belief: Belief) -> float:
        return inf if belief.suspicion is not None or self.others is None else self.others.urgency(belief)


@dataclass(frozen=True, slots=True)
class PingForPlace:
    """Pings when the expected search distance of the aPad exceeds the worth of an answer.

    The expected search distance is the probability that the aMussel will be fetched times the standard deviation of its
    place along both axes. A range carries no information about its charge.
    """

    question: Question
    """The probability that the aMussel has to be fetched."""
    answer_m: float
    """The worth of an answer, in metres of the aPad's way: the sound keeps others silent, and costs both sides energy."""

    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        return self.urgency(belief) > self.answer_m

    def urgency(self, belief: Belief) -> float:
        north, _, east = belief.place_cov
        return self.question(belief) * sqrt(north + east)


def ids_to_ping(policy: PingPolicy, beliefs: list[Belief], now_ms: int) -> list[int]:
    """The ids that are worth a ping now, the most urgent first, because the water carries one packet at a time."""
    worth = [belief for belief in beliefs if policy.is_worth(belief, now_ms)]
    worth.sort(key=lambda belief: (-policy.urgency(belief), belief.agent_id))
    return [belief.agent_id for belief in worth]
