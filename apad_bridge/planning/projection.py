"""The mission, carried forward from beliefs: how active the fleet is when a plan is flown, and how far the aPad drives.

The projection follows the mission's rule of dispatch (`mission/dispatch.py`) and the energy model, leg by leg. It begins
with the plan that is judged and goes on with a base policy: the next aMussel costs the way to it, less
`gain_m_per_charge` times the charge that it lacks, and the least cost is next. Where places are exchanged
(`planning/exchange.py`), one way serves the collected and the released one. Nothing is random and no docking misses. The
sea, if the situation knows it, stays as it is at the decision, and the aMussels stay in their places.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import dist, inf

from apad_bridge.planning.candidates import Situation
from apad_bridge.planning.energy_model import EnergyModel
from apad_bridge.planning.exchange import is_worth_it

_LEG_S = 2.5
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


class Projection:
    """Projects any number of plans from one situation; an aMussel is its index in candidates, others and leaving ones."""

    def __init__(
        self, situation: Situation, model: EnergyModel, horizon_s: float, gain_m_per_charge: float
    ) -> None:
        self._agents = (*situation.candidates, *situation.others, *situation.leaving)
        self._leaving = range(len(self._agents) - len(situation.leaving), len(self._agents))
        self._model = model
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
        count = len(self._agents)
        self._charge = [agent.charge for agent in self._agents]
        self._since_s = [0.0] * count
        self._served = {index for index, agent in enumerate(self._agents) if agent.is_served}
        self._active_s = [0.0] * count
        self._docked = [index for index, agent in enumerate(self._agents) if agent.dock_index is not None]
        self._now_s, self._metres = 0.0, 0.0
        self._place_m = self._apad_m
        self._places = list(self._own_places)
        self._fly_tour(plan, self._leaving)
        advance = self._advance_asynchronous if self._model.is_asynchronous else self._advance_batch
        while self._now_s < self._horizon_s and advance():
            pass
        return self._outcome()

    def _advance_batch(self) -> bool:
        """Flies one release of all, or one collection of a batch; False if nothing more will happen."""
        model, docked = self._model, self._docked
        swimming = [index for index in range(len(self._agents)) if index not in docked]
        wanted = min(model.batch, len(self._agents))
        enters_s = self._enters_s(swimming)
        waits_s = _last_of(enters_s, wanted)
        if docked:
            full_s = max(self._reaches_s(index, model.full) for index in docked)
            room_s = inf if waits_s == inf else max(waits_s, self._room_s(docked, swimming, wanted))
            self._now_s = max(self._now_s, min(full_s, room_s))
            exchanged_s = self._worth_an_exchange_s(swimming, enters_s, docked)
            if model.exchanges_places and _last_of(exchanged_s, wanted) <= self._now_s:
                self._fly_tour(self._chosen(swimming, exchanged_s, wanted), self._fullest_first(docked))
            else:
                self._fly_tour((), docked)
            return True
        if waits_s == inf:
            return False
        self._now_s = max(self._now_s, waits_s)
        self._fly_tour(self._chosen(swimming, enters_s, wanted))
        return True

    def _chosen(self, swimming: Sequence[int], enters_s: Sequence[float], count: int) -> Iterator[int]:
        """The base policy's choices one by one, each at its time and place, from those that are in the pool by then."""
        chosen: set[int] = set()
        for _ in range(count):
            pool = [
                index
                for index, at_s in zip(swimming, enters_s, strict=True)
                if at_s <= self._now_s and index not in chosen
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
            if self._now_s >= self._horizon_s:
                return
            self._go_to(index)
            self._dock(index)
            if left:
                released = left.pop(0)
                places = self._places
                places[index], places[released] = places[released], places[index]
                self._undock(released)
        while left and self._now_s < self._horizon_s:
            way_m, place_m, places = self._way_m, self._place_m, self._places
            owners = self._docked if self._model.exchanges_places else left
            owner = min(owners, key=lambda it: (way_m(place_m, places[it]), it))
            released = owner if owner in left else left[0]
            places[owner], places[released] = places[released], places[owner]
            left.remove(released)
            self._go_to(released)
            self._undock(released)

    def _advance_asynchronous(self) -> bool:
        """Flies one release or one collection, or waits for the next; False if nothing more will happen."""
        model, now_s, docked = self._model, self._now_s, self._docked
        full_s = [self._reaches_s(index, model.full) for index in docked]
        done = [index for index, at_s in zip(docked, full_s, strict=True) if at_s <= now_s]
        swimming = [index for index in range(len(self._agents)) if index not in docked]
        enters_s = self._enters_s(swimming)
        if done:
            count = len(done) if model.exchanges_places else 0
            self._fly_tour(self._chosen(swimming, enters_s, count), self._fullest_first(done))
            return True
        pool = [index for index, at_s in zip(swimming, enters_s, strict=True) if at_s <= now_s]
        events_s = list(full_s)
        if pool:
            room_s = self._room_s(docked, pool, 1)
            if room_s <= now_s:
                leaves, count = self._fullest_first(docked)[:1], 1 if model.exchanges_places else 0
                enters_s = self._worth_an_exchange_s(swimming, enters_s, leaves)
                self._fly_tour(self._chosen(swimming, enters_s, count), leaves)
                return True
            if len(docked) < model.docks:
                self._fly_tour([self._next(pool)])
                return True
            events_s.append(room_s)
        else:
            events_s += enters_s
        self._now_s = min(events_s, default=inf)
        return self._now_s < inf

    def _next(self, pool: Sequence[int]) -> int:
        """The base policy's choice."""
        way_m, place_m = self._way_m, self._place_m
        places, drain, now_s, gain = self._places, self._model.drain_per_s, self._now_s, self._gain
        best, least = pool[0], inf
        for index in pool:
            charge = max(0.0, self._charge[index] - drain * (now_s - self._since_s[index]))
            cost = way_m(place_m, places[index]) + gain * charge
            if cost < least:
                best, least = index, cost
        return best

    def _go_to(self, index: int) -> None:
        place_m = self._places[index]
        way_m = self._way_m(self._place_m, place_m)
        self._metres += way_m
        if self._sea is None:
            self._now_s += way_m / self._model.speed_m_s + _LEG_S
        else:
            self._now_s += self._sea.seconds(self._place_m, place_m) + _LEG_S
        self._place_m = place_m

    def _dock(self, index: int) -> None:
        self._now_s += self._model.dock_s
        if self._now_s < self._horizon_s:
            self._settle_active(index, self._now_s)
            self._charge[index] = max(0.0, self._charge[index] - self._model.motor_run)
            self._docked.append(index)

    def _undock(self, index: int) -> None:
        self._now_s += self._model.undock_s
        if self._now_s < self._horizon_s:
            self._docked.remove(index)
            charge = self._model.charged(self._charge[index], self._now_s - self._since_s[index])
            self._charge[index] = max(0.0, charge - self._model.motor_run)
            self._since_s[index] = self._now_s
            self._served.add(index)

    def _enters_s(self, swimming: Sequence[int]) -> list[float]:
        """When each enters the pool. Those that were served wait until one falls to the threshold of `again`."""
        low_s = [self._falls_to_s(index, self._model.pool_threshold) for index in swimming]
        again = self._model.again_threshold
        if again is None:
            return low_s
        urgent_s = min((self._falls_to_s(index, again) for index in swimming), default=inf)
        return [
            max(at_s, urgent_s) if index in self._served else at_s
            for index, at_s in zip(swimming, low_s, strict=True)
        ]

    def _worth_an_exchange_s(
        self, swimming: Sequence[int], enters_s: Sequence[float], leaving: Sequence[int]
    ) -> list[float]:
        """When each enters the pool for an exchange: never for one for whom the leaving ones make no room now."""
        model, now_s = self._model, self._now_s
        early = [index for index in leaving if self._reaches_s(index, model.full) > now_s]
        if not early:
            return list(enters_s)
        least = min(model.charged(self._charge[it], now_s - self._since_s[it]) for it in early) + _ROUNDING

        def pays(index: int) -> bool:
            charge = max(0.0, self._charge[index] - model.drain_per_s * (now_s - self._since_s[index]))
            return is_worth_it(least, charge, model.makes_room, model.charge_lead)

        return [at_s if pays(it) else inf for it, at_s in zip(swimming, enters_s, strict=True)]

    def _room_s(self, docked: Sequence[int], waiting: Sequence[int], wanted: int) -> float:
        """When the docked ones make room for the `wanted` lowest that wait: one by one the first of them, else all."""
        model = self._model
        if not docked:
            return inf
        ready = min if model.is_asynchronous else max
        room_s = ready(self._reaches_s(index, model.makes_room) for index in docked)
        if model.charge_lead is None or not wanted:
            return room_s
        lead, drain = model.charge_lead, model.drain_per_s

        def leads(at_s: float) -> bool:
            charges = sorted(
                max(0.0, self._charge[index] - drain * (at_s - self._since_s[index])) for index in waiting
            )
            led = min(model.makes_room, charges[wanted - 1] + lead)
            return ready(self._reaches_s(index, led) for index in docked) <= at_s

        low_s, high_s = self._now_s, max(self._now_s, room_s)
        if leads(low_s):
            return low_s
        for _ in range(_HALVINGS):
            middle_s = (low_s + high_s) / 2
            low_s, high_s = (low_s, middle_s) if leads(middle_s) else (middle_s, high_s)
        return high_s

    def _falls_to_s(self, index: int, charge: float) -> float:
        """When an aMussel in the water falls to `charge`."""
        above = self._charge[index] - charge
        return self._since_s[index] + max(0.0, above) / self._model.drain_per_s

    def _reaches_s(self, index: int, charge: float) -> float:
        return self._since_s[index] + self._model.charging_s(self._charge[index], charge)

    def _fullest_first(self, docked: Sequence[int]) -> list[int]:
        charged, now_s = self._model.charged, self._now_s
        return sorted(docked, key=lambda it: (-charged(self._charge[it], now_s - self._since_s[it]), it))

    def _settle_active(self, index: int, now_s: float) -> None:
        """Counts the active time of an aMussel in the water up to now, and lets its battery fall."""
        drain = self._model.drain_per_s
        active_s = min(now_s - self._since_s[index], self._charge[index] / drain)
        self._active_s[index] += active_s
        self._charge[index] = max(0.0, self._charge[index] - drain * active_s)
        self._since_s[index] = now_s

    def _outcome(self) -> ProjectedOutcome:
        end_s = self._horizon_s
        for index in range(len(self._agents)):
            if index not in self._docked:
                self._settle_active(index, end_s)
            elif self._since_s[index] < end_s:
                self._charge[index] = self._model.charged(self._charge[index], end_s - self._since_s[index])
        return ProjectedOutcome(tuple(self._active_s), tuple(self._charge), self._metres)


def _last_of(times_s: Sequence[float], count: int) -> float:
    """When so many have come; infinite if there are fewer, or none is wanted."""
    return sorted(times_s)[count - 1] if 0 < count <= len(times_s) else inf
