"""Triage: in overload it serves those in whom a dock's time does most, above a floor that nobody falls through.

In overload a rule of deadlines fails for all: each is served when it is empty already, where its battery charges slowest.
Source: the refusal of requests under overload, S. Baruah and others, "On the Competitiveness of On-Line Real-Time Task
Scheduling", Real-Time Systems 4, 1992.

- Overload: the fleet is larger than what the docks sustain, D (1 + c / d), with the mean rate c of a charge from the
  pool's threshold to full, and the drain d (docs/studies.md, "What nobody can exceed").
- The floor: an aMussel that was not released for FLOOR_DISCHARGES times as long as a full battery lasts goes first, the
  longest unserved before the others. Nobody who falls into the pool is passed over for longer.
- The others follow by the charge given for each second of the aPad: the charge that one lacks, by the seconds to go
  there, to dock it, to charge it and to release it.

Without overload the plan is that of Cautious. `by-load` blends in both cases: a way counts by the scenario's
`mission.costs`, so that it spares metres.

`core` lets go in heavy overload, with more than twice the aMussels that the docks sustain. Otherwise it is `by-load`. It
keeps as many alive as the docks sustain, near to each other, and serves an empty one only if too few are alive. A service
from empty takes three times as long as one from the begin of the fast part, and gives twice its charge. So it may refuse a
pool of empty ones, and then its docks wait for one of the core.
"""

from __future__ import annotations

from math import dist, fsum
from typing import NamedTuple

from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import Scales
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.solution import Solution
from apad_bridge.planning.strategies.by_route import Blend
from apad_bridge.planning.strategies.paper_strategies import Cautious
from apad_bridge.planning.strategy import CollectionStrategy, collect_in_order, docks_to_fill

FLOOR_DISCHARGES = 4.0
SPARING_FLOOR_DISCHARGES = 8.0
"""The floor of `by-load`, and the least of `core`. Most of triage's metres are ways to those at the floor."""


class Triage(CollectionStrategy):
    """In overload serves those in whom a dock's time gives most charge, above a floor of unserved time; else as Cautious.

    Raises ValueError for a situation without an energy model.
    """

    floor_discharges = FLOOR_DISCHARGES

    def __init__(self, without_overload: CollectionStrategy | None = None) -> None:
        """`without_overload` plans where the docks sustain the fleet; None is Cautious."""
        self._without_overload = Cautious() if without_overload is None else without_overload

    def plan(self, situation: Situation, batch: int) -> Solution:
        model, count = situation.model, docks_to_fill(situation, batch)
        if model is None:
            raise ValueError("triage needs the mission's energy model, which a script's plan has not")
        if not is_overloaded(
            len(situation.candidates) + len(situation.others) + len(situation.leaving), model
        ):
            return self._without_overload.plan(situation, batch)
        left, chosen, place_m = list(situation.candidates), list[Candidate](), situation.apad_m
        while len(chosen) < count:
            agent = min(left, key=lambda it: self._rank(it, place_m, situation, model))
            left.remove(agent)
            chosen.append(agent)
            place_m = agent.place_m
        return collect_in_order(chosen, situation)

    def _rank(
        self, agent: Candidate, place_m: tuple[float, float], situation: Situation, model: EnergyModel
    ) -> tuple[int, float, int]:
        """The lowest is next."""
        if agent.unserved_s > self.floor_discharges / model.drain_per_s:
            return 0, -agent.unserved_s, agent.agent_id
        seconds = (
            situation.seconds(place_m, agent.place_m, model.speed_m_s)
            + model.dock_s
            + model.charging_s(agent.charge, model.full)
            + model.undock_s
        )
        gain_per_s = (model.full - agent.charge) / seconds
        return 1, self._cost(gain_per_s, situation.metres(place_m, agent.place_m), model), agent.agent_id

    def _cost(self, gain_per_s: float, way_m: float, model: EnergyModel) -> float:
        return -gain_per_s


class ByLoad(Triage):
    """Chooses by the load of the docks: a blend where they sustain the fleet, or else triage that spares metres.

    In overload a service costs distance_per_m x way - energy_per_charge x q x g / c. q is the charge from the pool's
    threshold to full, c its mean rate in a dock, and g the charge given for each second of the aPad.
    """

    floor_discharges = SPARING_FLOOR_DISCHARGES

    def __init__(self, scales: Scales) -> None:
        super().__init__(Blend(scales))
        self._scales = scales

    def _cost(self, gain_per_s: float, way_m: float, model: EnergyModel) -> float:
        usual_s = model.charging_s(model.pool_threshold, model.full)
        return self._scales.distance_per_m * way_m - self._scales.energy_per_charge * gain_per_s * usual_s


def is_overloaded(amussels: int, model: EnergyModel) -> bool:
    """The docks cannot keep so many aMussels from ever being empty."""
    per_s = (model.full - model.pool_threshold) / model.charging_s(model.pool_threshold, model.full)
    return amussels > model.docks * (1 + per_s / model.drain_per_s)


ALIVE = 0.2
"""`core` lets an aMussel with less charge go in overload, unless too few have more. Tuned: docs/results/tables.md."""
HEAVY = 2.0
"""Overload is heavy with more than so many times the aMussels that the docks sustain."""
FLOORS_SHARE = 0.1
"""The part of the docks' time that `core` spends on those who were unserved for long."""


class Core(CollectionStrategy):
    """Keeps a core of near aMussels alive in heavy overload; otherwise it plans as `by-load`. It may refuse the whole pool.

    Raises ValueError for a situation without an energy model.
    """

    def __init__(self, scales: Scales) -> None:
        self._by_load = ByLoad(scales)
        self._scales = scales

    def plan(self, situation: Situation, batch: int) -> Solution:
        model, count = situation.model, docks_to_fill(situation, batch)
        if model is None:
            raise ValueError("core needs the mission's energy model, which a script's plan has not")
        best, kept, amussels = _load(situation, model)
        if amussels <= HEAVY * kept:
            return self._by_load.plan(situation, batch)
        return collect_in_order(self._chosen(situation, model, best, kept, amussels)[:count], situation)

    def refuses(self, situation: Situation) -> bool:
        """True if it refuses the pool wherever its aMussels drift: they are empty, and enough others are alive."""
        if (model := situation.model) is None:
            return False
        best, kept, amussels = _load(situation, model)
        late_s = _floor_s(amussels - kept, best, model)
        alive = sum(it.charge >= ALIVE for it in _water(situation))
        return (
            amussels > HEAVY * kept
            and alive >= _wanted(situation, kept)
            and all(
                it.charge < min(ALIVE, best.begin) and it.unserved_s <= late_s for it in situation.candidates
            )
        )

    def _chosen(
        self, situation: Situation, model: EnergyModel, best: _Part, kept: int, amussels: int
    ) -> list[Candidate]:
        """Those to collect, the next one first."""
        late_s = _floor_s(amussels - kept, best, model)
        if late := [it for it in situation.candidates if it.unserved_s > late_s]:
            return sorted(late, key=lambda it: (-it.unserved_s, it.agent_id))
        core = _core(situation, kept)
        if waiting := [it for it in situation.candidates if it.agent_id in core]:
            return self._by_worth(waiting, situation, model, best)
        # The docks have time. Whoever is served once from the fast part costs no more than one of the core.
        once = [it for it in situation.candidates if not it.is_served and it.charge >= best.begin]
        return sorted(once, key=lambda it: (it.charge, it.agent_id))

    def _by_worth(
        self, waiting: list[Candidate], situation: Situation, model: EnergyModel, best: _Part
    ) -> list[Candidate]:
        """In the order of the charge given, less what the best services give in that time, and less the way's cost."""
        per_m = 0.0
        if self._scales.energy_per_charge > 0:
            per_m = self._scales.distance_per_m / self._scales.energy_per_charge
        left, ordered, place_m = list(waiting), list[Candidate](), situation.apad_m
        while left:

            def worth(it: Candidate, from_m: tuple[float, float] = place_m) -> tuple[float, int]:
                way_s = situation.seconds(from_m, it.place_m, model.speed_m_s)
                seconds = way_s + _handling_s(model) + model.charging_s(it.charge, model.full)
                way = per_m * situation.metres(from_m, it.place_m)
                return model.full - it.charge - best.per_s * seconds - way, -it.agent_id

            ordered.append(max(left, key=worth))
            left.remove(ordered[-1])
            place_m = ordered[-1].place_m
        return ordered


class _Part(NamedTuple):
    """The part of the charging curve that gives most for a dock's time, with docking and undocking."""

    per_s: float
    begin: float
    charging_s: float
    charge: float


def _handling_s(model: EnergyModel) -> float:
    return model.dock_s + model.undock_s


def _best_part(model: EnergyModel) -> _Part:
    ends = [0.0, *(end for end, _ in model.curve)]
    return max(
        _Part((to - begin) / (seconds + _handling_s(model)), begin, seconds, to - begin)
        for index, begin in enumerate(ends)
        for to in ends[index + 1 :]
        for seconds in (model.charging_s(begin, to),)
    )


def _sustained(best: _Part, model: EnergyModel) -> float:
    """The aMussels that the docks keep alive if each service is the best one: work, charge and handling take turns."""
    work_s = best.charge / model.drain_per_s
    return model.docks * (1 + (work_s - _handling_s(model)) / (best.charging_s + _handling_s(model)))


def _load(situation: Situation, model: EnergyModel) -> tuple[_Part, int, int]:
    """The best part, the number of aMussels that the docks keep alive by it, and the number of all."""
    best = _best_part(model)
    amussels = len(situation.candidates) + len(situation.others) + len(situation.leaving)
    return best, int(_sustained(best, model)), amussels


def _floor_s(left_out: int, best: _Part, model: EnergyModel) -> float:
    """The time after which one that is left out is served: this takes `FLOORS_SHARE` of the docks' time at most."""
    more_s = model.charging_s(0.0, model.full) - model.charging_s(best.begin, model.full)
    return max(SPARING_FLOOR_DISCHARGES / model.drain_per_s, more_s * left_out / (FLOORS_SHARE * model.docks))


def _water(situation: Situation) -> list[Candidate]:
    return [*situation.candidates, *(it for it in situation.others if it.dock_index is None)]


def _wanted(situation: Situation, kept: int) -> int:
    """The number of the core in the water."""
    docked = sum(it.dock_index is not None for it in situation.others) + len(situation.leaving)
    return max(1, kept - docked)


def _core(situation: Situation, kept: int) -> set[int]:
    """The ids of the core in the water: those nearest to each other, of all that have charge, or of all if too few have."""
    water, wanted = _water(situation), _wanted(situation, kept)
    alive = [it for it in water if it.charge >= ALIVE]
    lacking = len(alive) < wanted

    def nearest(centre: Candidate) -> tuple[float, list[Candidate]]:
        """The sum of the ways from the centre, and those of the core about it: first those that have charge."""
        near = sorted(
            water if lacking else alive,
            key=lambda it: (it.charge < ALIVE, dist(centre.place_m, it.place_m), it.agent_id),
        )[:wanted]
        return fsum(dist(centre.place_m, it.place_m) for it in near), near

    _, core = min((nearest(it) for it in alive or water), key=lambda it: it[0])
    return {it.agent_id for it in core}
