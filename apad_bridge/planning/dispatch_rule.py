"""The rule of dispatch: when docked aMussels leave, and when others are collected.

The strategy decides whom and in which order; the rule is the scenario's `mission.dispatch` and serves every strategy. So a
study can split a gain into the rule's part and the strategy's. It is written once, in times: a mission sees the present
alone, and each of its times is now or never, while a projection looks ahead.

Source of the batch: the paper's Fig. 7, which waits for as many aMussels as there are docks and releases them when all are
full. Source of the asynchronous rule: the on-demand charging of single nodes, with a full or a partial charge, as in L. He
and others, MASS 2013. It collects one as soon as a dock is free. When another waits, the fullest makes room, with a free
dock, too, because in a dock it measures nothing.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import inf


class DispatchRule(ABC):
    """The rule over docks and a pool, as somebody sees them. An aMussel is an integer; times are seconds of one clock."""

    is_asynchronous: bool
    now_s: float
    docked: Sequence[int]

    @abstractmethod
    def full_s(self, docked: int) -> float:
        """When a docked one is full, or given up."""

    @abstractmethod
    def room_s(self) -> float:
        """When the docked ones make room for those that are collected next: all of them in a batch, or else the first.

        A time to come may be one at which to ask again.
        """

    @abstractmethod
    def fullest(self) -> Sequence[int]:
        """The docked one that makes room first."""

    @abstractmethod
    def waits_s(self) -> float:
        """When those that are collected next wait in the pool, and docks for them are free."""

    def released(self) -> tuple[float, Sequence[int]]:
        """When the next docked ones leave, and who; nobody for a time at which to ask again."""
        if not (full_s := [self.full_s(it) for it in self.docked]):
            return inf, ()
        if not self.is_asynchronous:
            all_s = max(full_s)
            return (all_s if all_s <= self.now_s else min(all_s, self.room_s())), self.docked
        if done := [it for it, at_s in zip(self.docked, full_s, strict=True) if at_s <= self.now_s]:
            return self.now_s, done
        room_s = self.room_s()
        return (room_s, self.fullest()) if room_s <= self.now_s else (min(*full_s, room_s), ())

    def collected_s(self) -> float:
        """When the next ones are collected, if nobody leaves before."""
        return self.waits_s() if self.is_asynchronous or not self.docked else inf
