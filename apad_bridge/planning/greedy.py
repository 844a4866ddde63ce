"""Greedy collection (paper, section V-B): the closest agent in each planning step."""

from __future__ import annotations

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.explanation import Option, way_m, with_exchanges
from apad_bridge.planning.solution import Solution, StepKind
from apad_bridge.planning.strategy import collect_in_order, docks_to_fill, nearest


class Greedy:
    """Goes from the aPad's place to the nearest candidate, from there to the nearest of the rest, and so on.

    Equally near candidates follow by id, lowest first. The strategy ignores charge, and its whole route need not be
    the shortest.
    """

    plans = StepKind.COLLECT

    def plan(self, situation: Situation, batch: int) -> Solution:
        agents = {agent.agent_id: agent for agent in situation.candidates}
        points_m = {agent_id: agent.place_m for agent_id, agent in agents.items()}
        place_m = situation.apad_m
        chosen: list[Candidate] = []
        while len(chosen) < docks_to_fill(situation, batch):
            agent_id = nearest(place_m, points_m)
            place_m = points_m.pop(agent_id)
            chosen.append(agents[agent_id])
        return collect_in_order(chosen, situation)

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        return with_exchanges(situation, solution, lambda agents: {"way_m": way_m(situation, agents)})
