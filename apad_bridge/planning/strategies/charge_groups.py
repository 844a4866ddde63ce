"""Groups of similar charging times: a batch waits in its docks for the slowest, so equally slow ones go together.

Source: scheduling of batch processing machines, where a batch takes as long as its longest job and jobs are grouped by
their processing times; C.-Y. Lee, R. Uzsoy, L. A. Martin-Vega, "Efficient Algorithms for Scheduling Semiconductor Burn-In
Operations", Operations Research 40(4), 1992. In such a schedule a batch holds neighbours in the order of charging times,
so only those groups are tried. (The group with the longest charging times is that of Cautious.)

The best group is the one with the most worth a second of its whole cycle, which is to collect it, to charge it, and to
bring it home:

    (energy_per_charge x (charge given) - distance_per_m x (metres there and back)) / seconds

with the factors of the scenario's `mission.costs`. This is the charging throughput of on-demand charging, less the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import fsum

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import Scales
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.explanation import Option, way_m, way_s, with_exchanges
from apad_bridge.planning.routes import cheapest_choice
from apad_bridge.planning.solution import Solution
from apad_bridge.planning.strategy import CollectionStrategy, collect_in_order, docks_to_fill


class ChargeGroups(CollectionStrategy):
    """Chooses neighbours in the order of charging times, as the group with the most worth in a second of its cycle.

    Raises ValueError for a situation without an energy model.
    """

    def __init__(self, scales: Scales) -> None:
        self._scales = scales

    def plan(self, situation: Situation, batch: int) -> Solution:
        model, count = situation.model, docks_to_fill(situation, batch)
        if model is None:
            raise ValueError("groups by charging time need the mission's energy model")
        if not count:
            return Solution(())
        by_charge = sorted(situation.candidates, key=lambda agent: (agent.charge, agent.agent_id))
        groups = [by_charge[first : first + count] for first in range(len(by_charge) - count + 1)]
        routes = [
            cheapest_choice(situation.apad_m, group, count, 1.0, 0.0, situation.metres) for group in groups
        ]
        worths = [self._worth_per_s(situation, route, model) for route in routes]
        return collect_in_order(routes[worths.index(max(worths))], situation)

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        model = situation.model
        assert model is not None  # it made the plan
        return with_exchanges(
            situation,
            solution,
            lambda agents: {"worth a second": -self._worth_per_s(situation, agents, model)},
        )

    def _worth_per_s(self, situation: Situation, route: Sequence[Candidate], model: EnergyModel) -> float:
        there_m, driving_s = way_m(situation, route), way_s(situation, route, model.speed_m_s)
        there_s = driving_s + len(route) * model.dock_s
        charging_s = max(model.charging_s(agent.charge, model.full) for agent in route)
        back_s = driving_s + len(route) * model.undock_s
        given = fsum(model.full - agent.charge for agent in route)
        worth = self._scales.energy_per_charge * given - self._scales.distance_per_m * 2 * there_m
        return worth / (there_s + charging_s + back_s)
