"""The usual baselines of on-demand mobile charging: nearest job next (NJNP), and earliest deadline first (EDF)."""

from __future__ import annotations

from math import fsum

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.explanation import Option, with_exchanges
from apad_bridge.planning.solution import Solution
from apad_bridge.planning.strategies.paper_strategies import Greedy
from apad_bridge.planning.strategy import CollectionStrategy, collect_in_order, docks_to_fill


class NearestJobNext(Greedy):
    """Plans as Greedy does, and lets the mission plan the rest of a batch again after each docking.

    Source: L. He, Y. Gu, J. Pan, T. Zhu, "On-Demand Charging in Wireless Sensor Networks: Theories and Applications", MASS
    2013. A node asks when its charge falls below a threshold (here: it enters the pool), and the charger serves the nearest
    request. It decides anew when a service ends or a request comes.

    An aPad decides anew after each docking, over the whole pool as it is then, requests that came on the way included. It
    does not turn round on its way: the aMussel that it goes to was called up, and has paid for its surfacing.
    """

    pre_empts = True


class EarliestDeadline(CollectionStrategy):
    """Chooses the agents with the least charge in both batteries together, of equal ones the lowest id.

    Source: C. L. Liu, J. W. Layland, "Scheduling Algorithms for Multiprogramming in a Hard-Real-Time Environment", JACM
    1973. It fails where the charger is overloaded: it runs after the most urgent, wherever they are.

    An aMussel's deadline is when it is lost, with both batteries empty. All boards of a fleet drain alike as far as the
    mission knows, so the order is by the charge of both batteries together. In the paper's worst case every secondary is
    full, and the order is that of Cautious.
    """

    def plan(self, situation: Situation, batch: int) -> Solution:
        count = docks_to_fill(situation, batch)
        by_deadline = sorted(
            situation.candidates, key=lambda agent: (agent.charge + agent.secondary, agent.agent_id)
        )
        return collect_in_order(by_deadline[:count], situation)

    def explain(self, situation: Situation, solution: Solution) -> list[Option]:
        return with_exchanges(
            situation,
            solution,
            lambda agents: {
                "primary": fsum(agent.charge for agent in agents),
                "secondary": fsum(agent.secondary for agent in agents),
            },
        )
