"""Cautious collection in the shortest order: the agents that Cautious chooses, collected along the shortest route.

Source: the paper's section V-A calls the collection of a chosen set a problem like the Travelling Salesman's. The order is
exact for six docks and fewer (`routes.py`).
"""

from __future__ import annotations

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.cautious import Cautious
from apad_bridge.planning.explanation import Option
from apad_bridge.planning.routes import cheapest_choice
from apad_bridge.planning.solution import Solution, StepKind
from apad_bridge.planning.strategy import collect_in_order


class ShortestOrder:
    """All of a batch wait for the last one to be docked, so their order costs way alone, and not charge."""

    plans = StepKind.COLLECT

    def plan(self, situation: Situation, batch: int) -> Solution:
        chosen = {step.agent_id for step in Cautious().plan(situation, batch).steps}
        agents = [agent for agent in situation.candidates if agent.agent_id in chosen]
        return collect_in_order(
            cheapest_choice(situation.apad_m, agents, len(agents), per_m=1.0, per_charge=0.0), situation
        )

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        return Cautious().explain(situation, solution)
