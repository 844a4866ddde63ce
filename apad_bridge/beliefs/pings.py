"""Whether an aMussel of which too little is known is worth waking: an answer costs it energy, and may change a plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.questions import Question


class PingPolicy(Protocol):
    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        """Whether to ping it at mission time `now_ms`."""
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

    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        if now_ms - belief.heard_ms < self.not_before_ms:
            return False
        if belief.charge_interval(0.9)[1] < self.spare_charge:
            return False
        answer = self.question(belief)
        return min(answer, 1 - answer) * self.wrong_plan_charge > self.answer_charge


def to_ping(policy: PingPolicy, beliefs: list[Belief], now_ms: int, at_most: int) -> list[int]:
    """The ids that are worth a ping now, the least certain charge first, for the water carries one word at a time."""
    worth = [belief for belief in beliefs if policy.is_worth(belief, now_ms)]
    worth.sort(key=lambda belief: (-belief.charge_cov[0], belief.agent_id))
    return [belief.agent_id for belief in worth[:at_most]]
