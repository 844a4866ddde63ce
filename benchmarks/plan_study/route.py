"""Plans by prize-collecting routes: rounds of a capacitated vehicle that may pass over customers, solved by PyVRP.

A round is the classic problem of mobile charging: with empty docks, choose whom to fetch and in which order. Each aMussel
has a prize, in metres, for the charge that it lacks. The vehicle's capacity is its docks, and the route ends anywhere. Then
all wait until each has been charged, and the shortest route brings them home. PyVRP knows neither the charging curve nor
what happens meanwhile. `pip install pyvrp` brings it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

from benchmarks.instances.check import World

_ITERATIONS = 50
"""PyVRP's, for a route of at most four of twenty."""
_PATIENCE_S = 10.0


@dataclass(frozen=True, slots=True)
class Rounds:
    threshold: float
    charge_to: float
    prize_m: float
    """The prize for a whole battery that an aMussel lacks."""

    @property
    def name(self) -> str:
        return f"routes by PyVRP, from {self.threshold:g} to {self.charge_to:g}, {self.prize_m:g} m a battery"


def all_rounds() -> Iterator[Rounds]:
    for threshold, charge_to, prize_m in product((0.7, 0.95), (0.7, 0.9, 0.99), (100.0, 1000.0)):
        yield Rounds(threshold, charge_to, prize_m)


def flown(instance: dict[str, Any], rounds: Rounds) -> World:
    """The world at the end of the mission. ImportError without PyVRP."""
    world = World(instance)
    while _fly_round(world, rounds):
        pass
    return world


def _fly_round(world: World, rounds: Rounds) -> bool:
    """Flies one round, or a wait where no route is worth its way; False at the end of the mission."""
    everybody = range(len(world.instance["places_m"]))
    prizes_m = {
        it: rounds.prize_m * (1 - charge)
        for it in everybody
        if (charge := world.charge(it)) <= rounds.threshold
    }
    fetched = _route(world, prizes_m, world.instance["docks"])
    if not fetched:
        return world.fly(["wait", _PATIENCE_S])
    if not all(world.fly(["collect", it]) for it in fetched):
        return False
    while any(world.charge(it) < rounds.charge_to for it in fetched):
        if not world.fly(["wait", _PATIENCE_S]):
            return False
    return all(world.fly(["deploy", it]) for it in _route(world, dict.fromkeys(fetched), len(fetched)))


def _route(world: World, prizes_m: dict[int, Any], capacity: int) -> list[int]:
    """The order of a route from the aPad's place; those without a prize must be visited."""
    from pyvrp import Model, PenaltyParams, SolveParams
    from pyvrp.stop import MaxIterations

    if not prizes_m:
        return []
    model = Model()
    start = model.add_location(*world.place_m)
    anywhere = model.add_location(*world.place_m)
    places = {it: model.add_location(*world.goal_m(it)) for it in prizes_m}
    model.add_vehicle_type(
        capacity=capacity, start_depot=model.add_depot(start), end_depot=model.add_depot(anywhere)
    )
    for agent, prize_m in prizes_m.items():
        model.add_client(places[agent], pickup=1, prize=_mm(prize_m or 0.0), required=prize_m is None)
    for a in (start, anywhere, *places.values()):
        for b in (start, anywhere, *places.values()):
            way_m = 0.0 if anywhere in (a, b) else ((a.x - b.x) ** 2 + (a.y - b.y) ** 2) ** 0.5
            model.add_edge(a, b, distance=_mm(way_m))
    # A place too few costs more than all prizes, so that the best route is one that the docks can hold.
    penalty = 1.0 + _mm(sum(it or 0.0 for it in prizes_m.values()))
    best = model.solve(
        MaxIterations(_ITERATIONS),
        seed=1,
        display=False,
        params=SolveParams(penalty=PenaltyParams(min_penalty=penalty, max_penalty=penalty)),
    ).best
    agents = list(prizes_m)
    return [agents[visit.idx] for route in best.routes() for visit in route if visit.is_client()]


def _mm(metres: float) -> int:
    """PyVRP takes whole numbers."""
    return round(1000 * metres)
