"""The rule of dispatch by beliefs: how many aMussels to collect now, and which of the docked ones to release now."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.policy.charged_enough import counted_charge, is_charged, is_full, makes_room
from apad_bridge.mission.policy.charging_watch import ChargingWatch
from apad_bridge.planning.dispatch_rule import DispatchRule, ServiceRules
from apad_bridge.planning.exchange_of_places import is_worth_it

Docked = Mapping[int, Belief | None]
"""The beliefs of the docked aMussels, by id; None for one that was never heard."""
Pool = Sequence[Belief]


@dataclass(frozen=True, slots=True)
class Due:
    released: Sequence[int]
    """The docked ones to release."""
    pool: Pool = ()
    """Those to collect from."""
    count: int = 0
    """The number of these to collect."""


NOTHING_DUE = Due(())


class BelievedDispatch(DispatchRule):
    """The docks and the pool of a mission, as believed now: each time is now or never."""

    now_s = 0.0

    def __init__(
        self,
        config: ServiceRules,
        watch: ChargingWatch,
        docked: Docked,
        free_docks: int,
        pool: Callable[[], Pool],
        batch_of: Callable[[Pool], int],
    ) -> None:
        """`pool` looks the pool up, which takes long: nobody asks before a docked aMussel may make room.

        `batch_of` tells how many of a pool make a batch now, 0 if it must grow.
        """
        self.is_asynchronous = config.is_asynchronous
        self.docked = tuple(docked)
        self._config, self._watch = config, watch
        self._beliefs, self._free_docks = docked, free_docks
        self._look_up, self._batch_of = pool, batch_of

    def due(self, kept: Collection[int]) -> Due:
        """Decides what is due.

        A release comes first, and a collection beside it is an exchange of places on the same tour. `kept` are docked ones
        that cannot be released now. The mission flies what this says, and a shadow compares with it.
        """
        at_s, leaving = self.released()
        released = [it for it in leaving if it not in kept] if at_s <= self.now_s else []
        if released:
            if not self._config.exchanges_places:
                return Due(released)
            led = self._worth_an_exchange(released)
            return Due(released, led, self._count_of(led, len(released)))
        if self.collected_s() > self.now_s:
            return NOTHING_DUE
        return Due((), self._pool, min(self._count_of(self._pool), self._free_docks))

    def full_s(self, docked: int) -> float:
        is_done = self._watch.has_given_up(docked) or is_full(self._beliefs[docked], self._config)
        return self.now_s if is_done else inf

    def room_s(self) -> float:
        config, ready = self._config, any if self.is_asynchronous else all
        left = [it for agent_id, it in self._beliefs.items() if not self._watch.has_given_up(agent_id)]
        if not ready(is_charged(it, config) for it in left):
            return inf
        waiting = self._waiting_charge
        return (
            self.now_s
            if waiting is not None and ready(makes_room(it, config, waiting) for it in left)
            else inf
        )

    def fullest(self) -> Sequence[int]:
        waiting = self._waiting_charge or 0.0
        able = [
            it for it in self._beliefs.values() if it is not None and makes_room(it, self._config, waiting)
        ]
        return [it.agent_id for it in fullest_first(able)[:1]]

    def waits_s(self) -> float:
        return self.now_s if self._free_docks and self._count_of(self._pool) else inf

    @cached_property
    def _pool(self) -> Pool:
        return self._look_up()

    def _count_of(self, pool: Pool, most: int = 1) -> int:
        """The number of a pool to collect on one tour; `most` bounds those that are collected one by one."""
        return min(len(pool), most) if self.is_asynchronous else self._batch_of(pool)

    @property
    def _waiting_charge(self) -> float | None:
        """The highest charge of those of the pool that are collected next, the lowest first; None if nobody is."""
        charges = sorted(counted_charge(it, self._config) for it in self._pool)[: self._count_of(self._pool)]
        return charges[-1] if charges else None

    def _worth_an_exchange(self, leaving: Iterable[int]) -> Pool:
        """Selects those of the pool for whom each of the `leaving` makes room; for one that leaves anyway, all of the pool.

        `planning/exchange_of_places.py` has the rule, which projections share.
        """
        config = self._config
        early = [
            counted_charge(belief, config)
            for agent_id in leaving
            if (belief := self._beliefs[agent_id]) is not None and self.full_s(agent_id) > self.now_s
        ]
        least = min(early, default=None)
        if least is None:
            return self._pool
        return [it for it in self._pool if is_worth_it(least, counted_charge(it, config), config)]


def fullest_first(docked: Iterable[Belief]) -> list[Belief]:
    return sorted(docked, key=lambda it: (-it.primary, it.agent_id))
