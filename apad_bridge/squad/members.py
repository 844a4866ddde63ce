"""A scenario with several aPads, taken apart: for each of them a scenario with its share of the fleet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from apad_bridge.planning.shares import shares
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start


@dataclass(frozen=True, slots=True)
class Member:
    """One aPad and the aMussels that it serves: a scenario that flies by itself, and its starts."""

    name: str
    scenario: Scenario
    starts: tuple[Start, ...]


def members(scenario: Scenario, starts: Sequence[Start]) -> tuple[Member, ...]:
    """In the scenario's order of aPads, each with the share that is planned for it."""
    places_m = {start.agent_id: (start.north_m, start.east_m) for start in starts}
    return divided(scenario, starts, shares([start_m for _, start_m in _apads(scenario)], places_m))


def divided(
    scenario: Scenario, starts: Sequence[Start], served: Sequence[tuple[int, ...]]
) -> tuple[Member, ...]:
    """The same with these shares. Ids, seed, timeslots and starts are those of the whole; only who serves is new."""
    return tuple(
        Member(
            name,
            _of_one(scenario, name, start_m, share),
            tuple(start for start in starts if start.agent_id in share),
        )
        for (name, start_m), share in zip(_apads(scenario), served, strict=True)
    )


def with_apad(scenario: Scenario, name: str) -> Scenario:
    """The scenario with this one of its aPads alone, over the whole fleet. ScenarioError when it has none of this name."""
    starts_m = dict(_apads(scenario))
    if name not in starts_m:
        raise ScenarioError([f"{scenario.name} has no aPad {name}: its aPads are {', '.join(starts_m)}"])
    return _of_one(scenario, name, starts_m[name], scenario.fleet.share)


def _apads(scenario: Scenario) -> list[tuple[str, tuple[float, float]]]:
    """Names and starts, `apad` first."""
    first = scenario.apad
    return [(first.name, first.start_m), *((it.name, it.start_m) for it in scenario.apads)]


def _of_one(scenario: Scenario, apad: str, start_m: tuple[float, float], share: tuple[int, ...]) -> Scenario:
    data = resolve(scenario)
    data.update(name=f"{scenario.name}-{apad}", apads=[])
    data["fleet"]["share"] = list(share)
    data["apad"].update(name=apad, start_m=list(start_m))
    return from_data(data, f"{scenario.name}: {apad}")
