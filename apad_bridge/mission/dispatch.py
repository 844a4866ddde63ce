"""The rules of dispatch and release: how many aMussels to collect now, and which of the docked ones to release now.

The strategy decides whom and in which order; the rule is the scenario's `mission.dispatch` and serves every strategy. So a
study can split a gain into the rule's part and the strategy's.

Source of `batch`: the paper's Fig. 7, which waits for as many aMussels as there are docks and releases them when all are
full. Source of `asynchronous`: the on-demand charging of single nodes, with a full or a partial charge, as in L. He and
others, MASS 2013.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Protocol

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.charging_watch import (
    ChargingWatch,
    counted_charge,
    is_charged,
    is_full,
    makes_room,
    room_above,
)
from apad_bridge.planning.exchange import is_worth_it
from apad_bridge.scenario.schema import Dispatch, Mission, Places

Docked = Mapping[int, Belief | None]
"""The beliefs of the docked aMussels, by id; None for one that was never heard."""
Pool = Callable[[], Sequence[Belief]]
"""Looks up the pool, which takes long: nobody asks before a docked aMussel may make room."""


class DispatchRule(Protocol):
    def to_collect(self, pool: Sequence[Belief], docked: Docked, free_docks: int) -> int:
        """Returns the number of aMussels of the pool to collect now; 0 means to wait."""

    def to_release(self, docked: Docked, pool: Pool) -> Collection[int]:
        """Returns the ids of the docked aMussels to release now."""

    def to_exchange(self, pool: Sequence[Belief], released: int) -> int:
        """Returns the number of the pool to collect on the tour on which so many are released."""


def due_now(
    rule: DispatchRule,
    config: Mission,
    watch: ChargingWatch,
    pool: Pool,
    docked: Docked,
    free_docks: int,
    kept: Collection[int] = (),
) -> tuple[tuple[int, ...], Sequence[Belief], int]:
    """Decides what is due: (the docked ones to release, those to collect from, how many of these to collect).

    A release comes first, and a collection beside it is an exchange of places on the same tour. `kept` are docked ones that
    cannot be released now. The mission flies what this says, and a shadow compares with it.
    """
    released = tuple(it for it in rule.to_release(docked, pool) if it not in kept) if docked else ()
    if released:
        if config.places is not Places.EXCHANGED:
            return released, (), 0
        led = _worth_an_exchange(pool(), {it: docked[it] for it in released}, config, watch)
        return released, led, rule.to_exchange(led, len(released))
    if not free_docks:
        return (), (), 0
    waiting = pool()
    return (), waiting, rule.to_collect(waiting, docked, free_docks)


def _worth_an_exchange(
    pool: Sequence[Belief], leaving: Docked, config: Mission, watch: ChargingWatch
) -> list[Belief]:
    """Selects those of the pool for whom each of the `leaving` makes room; for one that leaves anyway, all of the pool.

    `planning/exchange.py` has the rule, which projections share.
    """
    early = [
        counted_charge(belief, config)
        for agent_id, belief in leaving.items()
        if belief is not None and not is_full(belief, config) and not watch.has_given_up(agent_id)
    ]
    least, above = min(early, default=None), room_above(config)
    if least is None:
        return list(pool)
    return [it for it in pool if is_worth_it(least, counted_charge(it, config), above, config.charge_lead)]


class BatchDispatch:
    """Collects when nobody is docked and a batch waits; releases all when all are charged, or given up."""

    def __init__(
        self, config: Mission, watch: ChargingWatch, batch_of: Callable[[Sequence[Belief]], int]
    ) -> None:
        self._config = config
        self._watch = watch
        self._batch_of = batch_of

    def to_collect(self, pool: Sequence[Belief], docked: Docked, free_docks: int) -> int:
        return 0 if docked else min(self._batch_of(pool), free_docks)

    def to_release(self, docked: Docked, pool: Pool) -> Collection[int]:
        left = [belief for agent_id, belief in docked.items() if not self._watch.has_given_up(agent_id)]
        if all(is_full(belief, self._config) for belief in left):
            return tuple(docked)
        if not all(is_charged(belief, self._config) for belief in left):
            return ()
        waiting = pool()
        charges = sorted(counted_charge(it, self._config) for it in waiting)[: self._batch_of(waiting)]
        if charges and all(makes_room(belief, self._config, charges[-1]) for belief in left):
            return tuple(docked)
        return ()

    def to_exchange(self, pool: Sequence[Belief], released: int) -> int:
        return self._batch_of(pool)


class AsynchronousDispatch:
    """Collects one aMussel as soon as a dock is free; releases each when it is full, or given up.

    When another waits, the fullest makes room, if it is charged enough for that. It does so with a free dock, too, because
    in a dock it measures nothing.
    """

    def __init__(self, config: Mission, watch: ChargingWatch) -> None:
        self._config = config
        self._watch = watch

    def to_collect(self, pool: Sequence[Belief], docked: Docked, free_docks: int) -> int:
        return min(1, len(pool), free_docks)

    def to_release(self, docked: Docked, pool: Pool) -> Collection[int]:
        done = tuple(
            agent_id
            for agent_id, belief in docked.items()
            if self._watch.has_given_up(agent_id) or is_full(belief, self._config)
        )
        if done:
            return done
        charged = [it for it in docked.values() if it is not None and is_charged(it, self._config)]
        charges = [counted_charge(it, self._config) for it in pool()] if charged else []
        able = [it for it in charged if charges and makes_room(it, self._config, min(charges))]
        return [it.agent_id for it in fullest_first(able)[:1]]

    def to_exchange(self, pool: Sequence[Belief], released: int) -> int:
        return min(len(pool), released)


def fullest_first(docked: Iterable[Belief]) -> list[Belief]:
    return sorted(docked, key=lambda it: (-it.primary, it.agent_id))


def dispatch_of(
    config: Mission, watch: ChargingWatch, batch_of: Callable[[Sequence[Belief]], int]
) -> DispatchRule:
    """Builds the scenario's rule. `batch_of` tells how many of a pool make a batch now, 0 if it must grow."""
    if config.dispatch is Dispatch.ASYNCHRONOUS:
        return AsynchronousDispatch(config, watch)
    return BatchDispatch(config, watch, batch_of)
