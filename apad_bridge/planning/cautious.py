"""Cautious collection (paper, section V-B): the agents most in need of charge first, wherever they are."""

from __future__ import annotations

from math import fsum

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.explanation import Option, with_exchanges
from apad_bridge.planning.solution import Solution, StepKind
from apad_bridge.planning.strategy import collect_in_order, docks_to_fill


class Cautious:
    """Chooses the lowest charge in each step, of equal charges the lowest id, and ignores the aPad's movement."""

    plans = StepKind.COLLECT

    def plan(self, situation: Situation, batch: int) -> Solution:
        count = docks_to_fill(situation, batch)
        by_need = sorted(situation.candidates, key=lambda agent: (agent.charge, agent.agent_id))
        return collect_in_order(by_need[:count], situation)

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        return with_exchanges(
            situation, solution, lambda agents: {"charge": fsum(agent.charge for agent in agents)}
        )
