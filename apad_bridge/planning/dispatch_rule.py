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
from dataclasses import dataclass, replace
from enum import StrEnum
from math import inf
from typing import Annotated, Self

from annotated_types import Ge, Gt, Le
from pydantic import AfterValidator

from agents.water.bounds import not_tiny

MAX_DOCKS = 16
"""More would not fit around a hull of the paper's size."""
Charge = Annotated[float, Ge(0), Le(1)]
Lead = Annotated[float, Gt(0), Le(1), AfterValidator(not_tiny)]
BatchSize = Annotated[int, Ge(1), Le(MAX_DOCKS)]


class FullWhen(StrEnum):
    """The batteries that must be above the threshold for a docked aMussel to be full."""

    PRIMARY = "primary"
    BOTH = "both"


class Dispatch(StrEnum):
    """The rule of collecting and releasing, for every strategy alike. `batch`: the paper's, a whole batch is collected,
    charged and released. `asynchronous`: each aMussel by itself, as soon as a dock is free for it, until it is charged."""

    BATCH = "batch"
    ASYNCHRONOUS = "asynchronous"


class Places(StrEnum):
    """The place to which an aMussel is brought back. `own`: its own, as in the paper. `exchanged`: that of one which is
    collected on the same tour, or else the nearest of the docked ones' places; the two exchange places."""

    OWN = "own"
    EXCHANGED = "exchanged"


class Horizon(StrEnum):
    """The time for which aMussels are charged. `open`: as long as they live. `end`: until the mission's end, so nobody is
    collected who lasts until then, and nobody is charged for longer."""

    OPEN = "open"
    END = "end"


@dataclass(frozen=True, kw_only=True)
class ServiceRules:
    """The rules by which a mission decides who is collected and who leaves, each with its number.

    The scenario's block `mission` has them as keys, an `EnergyModel` has them for strategies, and a branch of a run can
    change them. Only the scenario checks bounds.
    """

    places: Places = Places.OWN
    pool_threshold: Charge
    """An aMussel at or below this charge is a candidate."""
    batch: BatchSize
    """The number of candidates for which the aPad waits before it plans. Left out in a file: the number of the aPad's
    docks. `dispatch: asynchronous` has no batches."""
    dispatch: Dispatch = Dispatch.BATCH
    again_threshold: Charge | None = None
    """An aMussel that the mission brought back is in the pool again once one in it is at or below this, which is below
    `pool_threshold`. None: at once at `pool_threshold`."""
    full_threshold: Charge
    """An aMussel above this charge, which is above `pool_threshold`, counts as full."""
    charge_to: Charge | None = None
    """A docked aMussel above this, which is above `pool_threshold`, makes room when others wait for its dock. None: only
    full aMussels leave."""
    charge_lead: Lead | None = None
    """A docked aMussel that has so much more charge than the one that waits makes room for it, too; below `charge_to`.
    None: it does not."""
    full_when: FullWhen = FullWhen.PRIMARY
    horizon: Horizon = Horizon.OPEN

    @property
    def is_asynchronous(self) -> bool:
        """The mission releases each when it is full, and not the batch together."""
        return self.dispatch is Dispatch.ASYNCHRONOUS

    @property
    def exchanges_places(self) -> bool:
        """A released aMussel takes the place of one that is collected, while one is."""
        return self.places is Places.EXCHANGED

    @property
    def makes_room(self) -> float:
        """The charge above which the mission releases a docked aMussel when others wait, whatever their charge."""
        return self.full_threshold if self.charge_to is None else self.charge_to

    def leaves_for(self, charge: float, waiting: float) -> bool:
        """A docked one with this `charge` makes room for one with `waiting`: it is above the limit, or leads."""
        return charge > self.makes_room or (
            self.charge_lead is not None and charge >= waiting + self.charge_lead
        )

    def at_most(self, charge: float) -> Self:
        """These rules with no threshold above `charge`."""
        return replace(
            self,
            pool_threshold=min(self.pool_threshold, charge),
            again_threshold=None if self.again_threshold is None else min(self.again_threshold, charge),
            full_threshold=min(self.full_threshold, charge),
            charge_to=None if self.charge_to is None else min(self.charge_to, charge),
        )


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
