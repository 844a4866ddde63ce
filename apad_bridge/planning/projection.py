"""The mission, carried forward from beliefs: how active the fleet is when a plan is flown, and how far the aPad drives.

The projection follows the mission's rule (`planning/dispatch_rule.py`) and the energy model, leg by leg. It begins
with the plan that is judged and goes on with a base policy: the next aMussel costs the way to it, less
`gain_m_per_charge` times the charge that it lacks, and the least cost is next. Where places are exchanged
(`planning/exchange_of_places.py`), one way serves the collected and the released one. Nothing is random and no docking
misses. The sea, if the situation knows it, stays as it is at the decision, and the aMussels stay in their places.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import dist, inf

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.dispatch_rule import DispatchRule
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.exchange_of_places import is_worth_it

LEG_S = 2.5
"""Time of a leg beyond its way at full speed: to accelerate, to brake, and to be sure of the arrival."""
_HALVINGS = 8
"""They find the time of a lead within a second or two of an hour's charge."""
_ROUNDING = 1e-9
"""The charge at the time at which one makes room is a sum of floats, and may be so much below."""


@dataclass(frozen=True, slots=True)
class ProjectedOutcome:
    """A projection's result, over its horizon."""

    active_s: tuple[float, ...]
    """The active time of each aMussel: in the water, with charge. In the order of candidates, others, and leaving ones."""
    charges: tuple[float, ...]
    """Their charges at the end."""
    metres: float
    """The way, in a known sea that of calm water which costs as much."""


class Projection(DispatchRule):
    """Projects any number of plans from one situation; an aMussel is its index in candidates, others and leaving ones."""

    def __init__(
        self,
        situation: Situation,
        model: EnergyModel,
        horizon_s: float,
        gain_m_per_charge: float,
        rates: Sequence[EnergyModel] = (),
    ) -> None:
        """`rates` are the aMussels' own drains and charging curves, where they are known; else all have the model's."""
        self._agents = (*situation.candidates, *situation.others, *situation.leaving)
        self._leaving = range(len(self._agents) - len(situation.leaving), len(self._agents))
        self._model = model
        self._rates = rates or [model] * len(self._agents)
        self.is_asynchronous = model.is_asynchronous
        self.docked: list[int] = []
        self._count = 1 if model.is_asynchronous else min(model.batch, len(self._agents))
        """The number that is collected next."""
        self._horizon_s = horizon_s
        self._gain = gain_m_per_charge
        self._apad_m = situation.apad_m
        self._sea = situation.sea
        self._way_m = dist if self._sea is None else self._sea.metres
        self._own_places = [
            agent.place_m if agent.dock_index is None else agent.home_m for agent in self._agents
        ]

    def of(self, plan: Sequence[int]) -> ProjectedOutcome:
        """Projects the collection of `plan` (indices, in order), and what follows."""
        self.begin(plan)
        while self.now_s < self._horizon_s and self.advance():
            pass
        return self._outcome()

    def begin(self, plan: Sequence[int], at_s: float = 0.0) -> None:
        """Flies the collection of `plan` alone, from `at_s` on."""
        count = len(self._agents)
        self._charge = [agent.charge for agent in self._agents]
        self._since_s = [0.0] * count
        self._served = {index for index, agent in enumerate(self._agents) if agent.is_served}
        self._active_s = [0.0] * count
        self.docked = [index for index, agent in enumerate(self._agents) if agent.dock_index is not None]
        self.now_s, self._metres = at_s, 0.0
        self.first_docking_s = inf
        self._place_m = self._apad_m
        self._places = list(self._own_places)
        self._fly_tour(plan, self._leaving)

    def advance(self) -> bool:
        """Flies the next tour, or waits; False if nothing more will happen."""
        self._swimming = [index for index in range(len(self._agents)) if index not in self.docked]
        self._pool_s = self._enters_s(self._swimming)
        at_s, leaving = self.released()
        if leaving:
            self.now_s = max(self.now_s, at_s)
            self._release(leaving)
        elif (collected_s := self.collected_s()) <= self.now_s:
            self._fly_tour(self._chosen(self._pool_s, self._count))
        else:
            self.now_s = min(at_s, collected_s)
        return self.now_s < inf

    def full_s(self, docked: int) -> float:
        return self._reaches_s(docked, self._model.full_threshold)

    def room_s(self) -> float:
        waits_s = _last_of(self._pool_s, self._count)
        if not self.is_asynchronous:
            return inf if waits_s == inf else max(waits_s, self._makes_room_s(self._swimming))
        waiting = [it for it, at_s in zip(self._swimming, self._pool_s, strict=True) if at_s <= self.now_s]
        return self._makes_room_s(waiting) if waiting else waits_s

    def fullest(self) -> Sequence[int]:
        return self._fullest_first(self.docked)[:1]

    def waits_s(self) -> float:
        return _last_of(self._pool_s, self._count) if len(self.docked) < self._model.docks else inf

    def _release(self, leaving: Sequence[int]) -> None:
        """Flies a release. Where places are exchanged, others are collected on the same tour, if enough wait."""
        count, pool_s = 0, self._pool_s
        if self._model.exchanges_places:
            pool_s = self._worth_an_exchange_s(leaving)
            count = len(leaving) if self.is_asynchronous else self._count
            if _last_of(pool_s, self._count) > self.now_s:
                count = 0
        self._fly_tour(self._chosen(pool_s, count), self._fullest_first(leaving))

    def _chosen(self, enters_s: Sequence[float], count: int) -> Iterator[int]:
        """The base policy's choices one by one, each at its time and place, from those that are in the pool by then."""
        chosen: set[int] = set()
        for _ in range(count):
            pool = [
                index
                for index, at_s in zip(self._swimming, enters_s, strict=True)
                if at_s <= self.now_s and index not in chosen
            ]
            if not pool:
                break
            chosen.add(best := self._next(pool))
            yield best

    def _fly_tour(self, collected: Iterable[int], leaving: Iterable[int] = ()) -> None:
        """Collects one after the other, and releases the leaving ones there.

        The rest are released at the nearest places: those of all docked ones where places are exchanged, or else their own.
        """
        left = list(leaving)
        for index in collected:
            if self.now_s >= self._horizon_s:
                return
            self._go_to(index)
            self._dock(index)
            if left:
                released = left.pop(0)
                places = self._places
                places[index], places[released] = places[released], places[index]
                self._undock(released)
        while left and self.now_s < self._horizon_s:
            way_m, place_m, places = self._way_m, self._place_m, self._places
            owners = self.docked if self._model.exchanges_places else left
            owner = min(owners, key=lambda it: (way_m(place_m, places[it]), it))
            released = owner if owner in left else left[0]
            places[owner], places[released] = places[released], places[owner]
            left.remove(released)
            self._go_to(released)
            self._undock(released)

    def _next(self, pool: Sequence[int]) -> int:
        """The base policy's choice."""
        way_m, place_m = self._way_m, self._place_m
        places, rates, now_s, gain = self._places, self._rates, self.now_s, self._gain
        best, least = pool[0], inf
        for index in pool:
            charge = max(0.0, self._charge[index] - rates[index].drain_per_s * (now_s - self._since_s[index]))
            if (cost := way_m(place_m, places[index]) + gain * charge) < least:
                best, least = index, cost
        return best

    def _go_to(self, index: int) -> None:
        place_m = self._places[index]
        way_m = self._way_m(self._place_m, place_m)
        self._metres += way_m
        if self._sea is None:
            self.now_s += way_m / self._model.speed_m_s + LEG_S
        else:
            self.now_s += self._sea.seconds(self._place_m, place_m) + LEG_S
        self._place_m = place_m

    def _dock(self, index: int) -> None:
        self.now_s += self._model.dock_s
        self.first_docking_s = min(self.first_docking_s, self.now_s)
        if self.now_s < self._horizon_s:
            self._settle_active(index, self.now_s)
            self._charge[index] = max(0.0, self._charge[index] - self._model.motor_run)
            self.docked.append(index)

    def _undock(self, index: int) -> None:
        self.now_s += self._model.undock_s
        if self.now_s < self._horizon_s:
            self.docked.remove(index)
            charge = self._rates[index].charged(self._charge[index], self.now_s - self._since_s[index])
            self._charge[index] = max(0.0, charge - self._model.motor_run)
            self._since_s[index] = self.now_s
            self._served.add(index)

    def _enters_s(self, swimming: Sequence[int]) -> list[float]:
        """When each enters the pool. Those that were served wait until one falls to the threshold of `again`."""
        low_s = [self._falls_to_s(index, self._model.pool_threshold) for index in swimming]
        if (again := self._model.again_threshold) is None:
            return low_s
        urgent_s = min((self._falls_to_s(index, again) for index in swimming), default=inf)
        return [
            max(at_s, urgent_s) if index in self._served else at_s
            for index, at_s in zip(swimming, low_s, strict=True)
        ]

    def _worth_an_exchange_s(self, leaving: Sequence[int]) -> list[float]:
        """When each enters the pool for an exchange: never for one for whom the leaving ones make no room now."""
        model, now_s = self._model, self.now_s
        early = [index for index in leaving if self._reaches_s(index, model.full_threshold) > now_s]
        if not early:
            return self._pool_s
        least = min(self._charge_in_dock(it) for it in early) + _ROUNDING

        def pays(index: int) -> bool:
            drain = self._rates[index].drain_per_s
            charge = max(0.0, self._charge[index] - drain * (now_s - self._since_s[index]))
            return is_worth_it(least, charge, model)

        return [at_s if pays(it) else inf for it, at_s in zip(self._swimming, self._pool_s, strict=True)]

    def _makes_room_s(self, waiting: Sequence[int]) -> float:
        """When the docked ones make room for the lowest of these, as many as are collected next."""
        model, docked, above = self._model, self.docked, self._model.makes_room
        ready = min if self.is_asynchronous else max
        room_s = ready(self._reaches_s(index, above) for index in docked)
        if model.charge_lead is None:
            return room_s
        lead, rates = model.charge_lead, self._rates

        def leads(at_s: float) -> bool:
            charges = sorted(
                max(0.0, self._charge[index] - rates[index].drain_per_s * (at_s - self._since_s[index]))
                for index in waiting
            )
            led = min(above, charges[self._count - 1] + lead)
            return ready(self._reaches_s(index, led) for index in docked) <= at_s

        low_s, high_s = self.now_s, max(self.now_s, room_s)
        if leads(low_s):
            return low_s
        for _ in range(_HALVINGS):
            middle_s = (low_s + high_s) / 2
            low_s, high_s = (low_s, middle_s) if leads(middle_s) else (middle_s, high_s)
        return high_s

    def _falls_to_s(self, index: int, charge: float) -> float:
        """When an aMussel in the water falls to `charge`."""
        above = self._charge[index] - charge
        return self._since_s[index] + max(0.0, above) / self._rates[index].drain_per_s

    def _reaches_s(self, index: int, charge: float) -> float:
        return self._since_s[index] + self._rates[index].charging_s(self._charge[index], charge)

    def _fullest_first(self, docked: Sequence[int]) -> list[int]:
        return sorted(docked, key=lambda it: (-self._charge_in_dock(it), it))

    def _charge_in_dock(self, index: int) -> float:
        return self._rates[index].charged(self._charge[index], self.now_s - self._since_s[index])

    def _settle_active(self, index: int, now_s: float) -> None:
        """Counts the active time of an aMussel in the water up to now, and lets its battery fall."""
        drain = self._rates[index].drain_per_s
        active_s = min(now_s - self._since_s[index], self._charge[index] / drain)
        self._active_s[index] += active_s
        self._charge[index] = max(0.0, self._charge[index] - drain * active_s)
        self._since_s[index] = now_s

    def _outcome(self) -> ProjectedOutcome:
        end_s = self._horizon_s
        for index in range(len(self._agents)):
            if index not in self.docked:
                self._settle_active(index, end_s)
            elif self._since_s[index] < end_s:
                self._charge[index] = self._rates[index].charged(
                    self._charge[index], end_s - self._since_s[index]
                )
        return ProjectedOutcome(tuple(self._active_s), tuple(self._charge), self._metres)


def _last_of(times_s: Sequence[float], count: int) -> float:
    """When so many have come; infinite if there are fewer, or none is wanted."""
    return sorted(times_s)[count - 1] if 0 < count <= len(times_s) else inf
