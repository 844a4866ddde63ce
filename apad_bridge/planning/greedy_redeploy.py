"""Greedy Redeploy (paper, section V-B): charged agents go home in the order of current proximity."""

from __future__ import annotations

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.solution import Solution, Step, StepKind
from apad_bridge.planning.strategy import nearest


class GreedyRedeploy:
    """Goes from the aPad's place to the nearest home, from there to the nearest home of the rest, and so on.

    The strategy takes "current" proximity from the aPad's place at each step. Equally near homes follow by id,
    lowest first. Raises ValueError if a candidate is not docked: that is our own mistake.
    """

    plans = StepKind.DEPLOY

    def plan(self, situation: Situation) -> Solution:
        docks: dict[int, int] = {}
        for agent in situation.candidates:
            if agent.dock_index is None:
                raise ValueError(f"aMussel {agent.agent_id} is not docked: it cannot be redeployed")
            docks[agent.agent_id] = agent.dock_index
        homes_m = {agent.agent_id: agent.home_m for agent in situation.candidates}
        place_m = situation.apad_m
        steps: list[Step] = []
        while homes_m:
            agent_id = nearest(place_m, homes_m)
            place_m = homes_m.pop(agent_id)
            steps.append(Step(StepKind.DEPLOY, agent_id, docks[agent_id]))
        return Solution(tuple(steps))
