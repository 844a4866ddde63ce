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
"""

from __future__ import annotations

from apad_bridge.planning.by_route import Blend
from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import Scales
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.paper_strategies import Cautious
from apad_bridge.planning.solution import Solution, StepKind
from apad_bridge.planning.strategy import CollectionStrategy, collect_in_order, docks_to_fill

FLOOR_DISCHARGES = 4.0
SPARING_FLOOR_DISCHARGES = 8.0
"""The floor of `by-load`. Most of triage's metres are ways to those at the floor."""


class Triage:
    """Raises ValueError for a situation without an energy model."""

    plans = StepKind.COLLECT
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
