from math import dist

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.solution import Solution, Step, StepKind


class Farthest:
    """The farthest candidates first; of equally far ones the lowest id."""

    plans = StepKind.COLLECT

    def plan(self, situation: Situation, batch: int) -> Solution:
        here = (situation.apad_north_m, situation.apad_east_m)
        order = sorted(
            situation.candidates,
            key=lambda agent: (-dist(here, (agent.north_m, agent.east_m)), agent.agent_id),
        )
        pairs = zip(order[:batch], situation.free_docks, strict=False)
        return Solution(
            tuple(Step(StepKind.COLLECT, agent.agent_id, dock_index) for agent, dock_index in pairs)
        )
