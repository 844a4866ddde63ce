"""The batch that is charged soonest for what it lacks: the aPad is bound until the last of a batch is full.

Source: a batch takes as long as its longest job (Lee and others, Operations Research 40(4), 1992; see `charge_groups`), and
what a decision gains is set against the time that it takes (W. Dinkelbach, "On Nonlinear Fractional Programming",
Management Science 13(7), 1967). The order of collection counts too: the emptiest should begin to charge first. A plan
costs, in seconds,

    (time until all of it is charged) + WAY x (time under way) - BATTERY x (time of a whole charge) x (batteries lacking)

One that is much emptier than the rest would hold up the others, so it waits for a batch of its like. The plan is the least
over all orders of all batches from the lowest charges and `MORE` others that follow them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, permutations

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.explanation import Option, with_exchanges
from apad_bridge.planning.solution import Solution, StepKind
from apad_bridge.planning.strategy import collect_in_order, docks_to_fill

WAY = 0.5
BATTERY = 0.8
"""Both were chosen on seeds 101 to 300 of the pool."""
MORE = 4
"""Candidates beyond the batch with the lowest charges."""
MOST_AT_ONCE = 4
"""aMussels that are chosen at once. More follow from the last one's place, so that a plan of many docks stays quick."""


class SoonestCharged:
    """Raises ValueError for a situation without an energy model."""

    plans = StepKind.COLLECT

    def plan(self, situation: Situation, batch: int) -> Solution:
        model, count = situation.model, docks_to_fill(situation, batch)
        if model is None:
            raise ValueError("the time until a batch is charged needs the mission's energy model")
        left = sorted(situation.candidates, key=lambda agent: (agent.charge, agent.agent_id))
        order: list[Candidate] = []
        place_m = situation.apad_m
        while len(order) < count:
            order += _soonest(place_m, left, min(MOST_AT_ONCE, count - len(order)), model)
            left = [agent for agent in left if agent not in order]
            place_m = order[-1].place_m
        return collect_in_order(order, situation)

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        model = situation.model
        assert model is not None  # it made the plan
        return with_exchanges(situation, solution, lambda agents: _parts_of(situation.apad_m, agents, model))


def _soonest(
    place_m: tuple[float, float], by_charge: Sequence[Candidate], count: int, model: EnergyModel
) -> Sequence[Candidate]:
    orders = (
        order for chosen in combinations(by_charge[: count + MORE], count) for order in permutations(chosen)
    )
    return min(orders, key=lambda order: sum(_parts_of(place_m, order, model).values()))


def _parts_of(
    place_m: tuple[float, float], order: Sequence[Candidate], model: EnergyModel
) -> dict[str, float]:
    """The parts of the cost, in mission seconds. An aMussel that waits for its collection loses charge."""
    to = min(model.full, model.makes_room)
    now_s = way_s = charged_s = 0.0
    for agent in order:
        leg_s = agent.metres_from(place_m) / model.speed_m_s
        way_s += leg_s
        now_s += leg_s + model.dock_s
        place_m = agent.place_m
        charge = max(0.0, agent.charge - now_s * model.drain_per_s)
        charged_s = max(charged_s, now_s + model.charging_s(charge, to))
    lacking = sum(model.full - agent.charge for agent in order)
    return {
        "until all are charged": charged_s,
        "way": WAY * way_s,
        "batteries lacking": -BATTERY * model.charging_s(0.0, model.full) * lacking,
    }
