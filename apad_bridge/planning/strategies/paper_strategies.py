"""The strategies of the paper's section V-B and Table II: greedy, cautious and no collection, and greedy redeployment."""

from __future__ import annotations

from itertools import islice
from math import fsum

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.explanation import Option, way_m, with_exchanges
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategy import (
    CollectionStrategy,
    RedeploymentStrategy,
    collect_in_order,
    docks_to_fill,
    nearest_first,
)


class Greedy(CollectionStrategy):
    """Goes from the aPad's place to the nearest candidate, from there to the nearest of the rest, and so on.

    Equally near candidates follow by id, lowest first. The strategy ignores charge, and its whole route need not be
    the shortest.
    """

    def plan(self, situation: Situation, batch: int) -> Solution:
        agents = {agent.agent_id: agent for agent in situation.candidates}
        points_m = {agent_id: agent.place_m for agent_id, agent in agents.items()}
        nearest = islice(nearest_first(situation.apad_m, points_m), docks_to_fill(situation, batch))
        return collect_in_order([agents[agent_id] for agent_id in nearest], situation)

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        return with_exchanges(situation, solution, lambda agents: {"way_m": way_m(situation, agents)})


class Cautious(CollectionStrategy):
    """Chooses the lowest charge in each step, of equal charges the lowest id, and ignores the aPad's movement."""

    def plan(self, situation: Situation, batch: int) -> Solution:
        count = docks_to_fill(situation, batch)
        by_need = sorted(situation.candidates, key=lambda agent: (agent.charge, agent.agent_id))
        return collect_in_order(by_need[:count], situation)

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        return with_exchanges(
            situation, solution, lambda agents: {"charge": fsum(agent.charge for agent in agents)}
        )


class NoCollection(CollectionStrategy):
    """Never collects anybody: the aPad waits for the whole mission."""

    def plan(self, situation: Situation, batch: int) -> Solution:
        return Solution(())

    def refuses(self, situation: Situation) -> bool:
        return True


class GreedyRedeploy(RedeploymentStrategy):
    """Goes from the aPad's place to the nearest home, from there to the nearest home of the rest, and so on.

    The strategy takes "current" proximity from the aPad's place at each step. Equally near homes follow by id,
    lowest first. Raises ValueError if a candidate is not docked: that is our own mistake.
    """

    def plan(self, situation: Situation) -> Solution:
        docks: dict[int, int] = {}
        for agent in situation.candidates:
            if agent.dock_index is None:
                raise ValueError(f"aMussel {agent.agent_id} is not docked: it cannot be redeployed")
            docks[agent.agent_id] = agent.dock_index
        homes_m = {agent.agent_id: agent.home_m for agent in situation.candidates}
        order = nearest_first(situation.apad_m, homes_m)
        return Solution(tuple(Step(StepKind.DEPLOY, agent_id, docks[agent_id]) for agent_id in order))
