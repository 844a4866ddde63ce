"""The cost modules of a plan: distance and energy, each with a scale factor (paper, sections III and IV-B).

A finished plan is priced here. A strategy measures legs by `Situation.metres` (`candidates.py`).

Distance is the Euclidean way from the aPad's place to each goal in turn; it stands for the thrusters' energy. Where the
situation knows a current or a wind, its cost is that of the metres of calm water that take as much energy. Energy is the
aMussels' charging DEMAND: the charge that each collected aMussel lacks to be full.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import dist, fsum
from typing import Protocol

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.solution import Solution, StepKind

Place = tuple[float, float]


class Scales(Protocol):
    """Cost per metre, and cost per whole battery of charging demand, such as the scenario's `mission.costs`."""

    @property
    def distance_per_m(self) -> float:
        """The cost of a metre."""

    @property
    def energy_per_charge(self) -> float:
        """The cost of a whole battery."""


@dataclass(frozen=True, slots=True)
class CostScales:
    """The factors of the two costs: 1 each where nobody states others."""

    distance_per_m: float = 1.0
    energy_per_charge: float = 1.0


@dataclass(frozen=True, slots=True)
class CostBreakdown:
    """A plan's cost: the bare quantities, and the same after scaling. `demand` is in whole batteries.

    `distance_m` is the way over ground, in a current too.
    """

    distance_m: float
    demand: float
    distance_cost: float
    energy_cost: float

    @property
    def total(self) -> float:
        """The scaled costs of distance and energy together."""
        return self.distance_cost + self.energy_cost


def distance_m(solution: Solution, situation: Situation) -> float:
    """Sums the metres from the aPad's place through the goals of all steps: agents to collect, homes to deploy at."""
    return _over_legs(solution, situation, dist)


def _over_legs(solution: Solution, situation: Situation, metres: Callable[[Place, Place], float]) -> float:
    agents = {agent.agent_id: agent for agent in situation.candidates}
    place_m, total_m = situation.apad_m, 0.0
    for step in solution.steps:
        agent = agents[step.agent_id]
        goal_m = agent.place_m if step.kind is StepKind.COLLECT else agent.home_m
        total_m += metres(place_m, goal_m)
        place_m = goal_m
    return total_m


def charging_demand(solution: Solution, situation: Situation) -> float:
    """Sums (full - charge) over the agents to collect, full being 1. A deployment demands nothing."""
    charges = {agent.agent_id: agent.charge for agent in situation.candidates}
    return fsum(1.0 - charges[step.agent_id] for step in solution.steps if step.kind is StepKind.COLLECT)


def cost_of(solution: Solution, situation: Situation, scales: Scales | None = None) -> CostBreakdown:
    """Computes the plan's cost in the situation that it was made for, with factors of 1 by default.

    Raises KeyError if a step names an agent that is not a candidate; `check_solution` refuses such plans first.
    """
    factors = scales or CostScales()
    metres, calm_m = distance_m(solution, situation), _over_legs(solution, situation, situation.metres)
    demand = charging_demand(solution, situation)
    return CostBreakdown(metres, demand, calm_m * factors.distance_per_m, demand * factors.energy_per_charge)
