"""Strategies by name: the built-in ones, and those that a user's package adds by entry point.

A package adds a strategy with an entry point in the group `musselbed.strategies`. The entry point's value is a class
(or a function) that returns a strategy when it is called without arguments. See docs/extending.md. Names are a user's
input, so every problem with one is a ValueError of one line.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import lru_cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any, cast

from apad_bridge.planning.by_route import BestOfPool, Blend, Exact, ShortestOrder
from apad_bridge.planning.charge_groups import ChargeGroups
from apad_bridge.planning.costs import CostScales, Scales
from apad_bridge.planning.on_demand import EarliestDeadline, NearestJobNext
from apad_bridge.planning.paper_strategies import Cautious, Greedy, GreedyRedeploy, NoCollection
from apad_bridge.planning.rollout import FairRollout, Rollout
from apad_bridge.planning.solution import StepKind
from apad_bridge.planning.strategy import CollectionStrategy, RedeploymentStrategy
from apad_bridge.planning.triage import ByLoad, Triage

GROUP = "musselbed.strategies"

_BUILT_IN: dict[str, Callable[[], Any]] = {
    "best-of-pool": BestOfPool,
    "cautious": Cautious,
    "edf": EarliestDeadline,
    "greedy": Greedy,
    "greedy-redeploy": GreedyRedeploy,
    "njnp": NearestJobNext,
    "none": NoCollection,
    "shortest-order": ShortestOrder,
    "triage": Triage,
}
_SCALED: dict[str, Callable[[Scales], Any]] = {
    "blend": Blend,
    "by-load": ByLoad,
    "charge-groups": ChargeGroups,
    "exact": Exact,
    "rollout": Rollout,
    "rollout-fair": FairRollout,
}
"""Built-in strategies that weigh distance and energy by the scenario's scale factors."""


def known_names() -> list[str]:
    """Returns every strategy's name, sorted, without loading the strategies of packages."""
    return sorted({*_BUILT_IN, *_SCALED, *(entry.name for entry in _entries())})


def _known_of(kind: StepKind) -> list[str]:
    """Returns the strategies that can be of this kind: a package's may be of either, for none is loaded."""
    other = {
        name for name, strategy in _BUILT_IN.items() if getattr(strategy, "plans", None) not in (None, kind)
    }
    scaled = set() if kind is StepKind.COLLECT else set(_SCALED)
    return [name for name in known_names() if name not in other | scaled]


def collection(name: str, scales: Scales | None = None) -> CollectionStrategy:
    """Creates a collection strategy by name. Raises ValueError if there is none, or it cannot be used.

    `scales` are the factors of distance and energy, 1 by default, for the strategies that weigh the two.
    """
    return cast(CollectionStrategy, _create(name, StepKind.COLLECT, scales or CostScales()))


def redeployment(name: str) -> RedeploymentStrategy:
    """Creates a redeployment strategy by name. Raises ValueError if there is none, or it cannot be used."""
    return cast(RedeploymentStrategy, _create(name, StepKind.DEPLOY, CostScales()))


def _create(name: str, kind: StepKind, scales: Scales) -> object:
    entries = tuple(entry for entry in _entries() if entry.name == name)
    sources = ["musselbed itself"] * (name in _BUILT_IN or name in _SCALED) + [
        _package(entry) for entry in entries
    ]
    if not sources:
        raise ValueError(f"unknown strategy {name!r}; known: {', '.join(_known_of(kind))}")
    if len(sources) > 1:
        raise ValueError(f"strategy {name!r} is in each of {', '.join(sources)}: rename or remove one")
    strategy: object = _built_in(name, scales) or _load(entries[0])
    if getattr(strategy, "plans", None) is not kind or not callable(getattr(strategy, "plan", None)):
        raise ValueError(
            f"strategy {name!r} (from {sources[0]}) is no {kind} strategy: "
            f"that needs `plans = StepKind.{kind.name}` and a method `plan`"
        )
    return strategy


def _built_in(name: str, scales: Scales) -> object | None:
    if name in _SCALED:
        return cast(object, _SCALED[name](scales))
    return cast(object, _BUILT_IN[name]()) if name in _BUILT_IN else None


def _entries() -> EntryPoints:
    return _entries_on(tuple(sys.path))


@lru_cache(maxsize=8)
def _entries_on(path: tuple[str, ...]) -> EntryPoints:
    """The entry points of the packages on this search path. A study asks for strategies in each of its missions, and
    reading the packages' metadata would take a tenth of such a mission."""
    return entry_points(group=GROUP)


def _load(entry: EntryPoint) -> object:
    try:
        return entry.load()()
    except Exception as error:  # a package's import or constructor may raise anything
        raise ValueError(
            f"strategy {entry.name!r} (from {_package(entry)}, {entry.value}) cannot be loaded: "
            f"{type(error).__name__}: {error}"
        ) from error


def _package(entry: EntryPoint) -> str:
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.value
