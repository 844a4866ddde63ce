"""A scenario with several aPads, taken apart: for each of them a scenario with its share of the fleet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from apad_bridge.planning.shares import shares
from apad_bridge.ros_names.names import plain
from apad_bridge.scenario.another_apad import AnotherAPad
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import from_data, resolve
from apad_bridge.scenario.schema import APad, Scenario
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
    return divided(scenario, starts, shares([apad.start_m for apad in _apads(scenario)], places_m))


def divided(
    scenario: Scenario, starts: Sequence[Start], served: Sequence[tuple[int, ...]]
) -> tuple[Member, ...]:
    """The same with these shares. Ids, seed, timeslots and starts are those of the whole; only who serves is new."""
    return tuple(
        Member(
            apad.name,
            _of_one(scenario, apad, share),
            tuple(start for start in starts if start.agent_id in share),
        )
        for apad, share in zip(_apads(scenario), served, strict=True)
    )


def with_apad(scenario: Scenario, name: str) -> Scenario:
    """The scenario with this one of its aPads alone, over the whole fleet. ScenarioError when it has none of this name."""
    apads = {apad.name: apad for apad in _apads(scenario)}
    if name not in apads:
        raise ScenarioError([f"{scenario.name} has no aPad {name}: its aPads are {', '.join(apads)}"])
    return _of_one(scenario, apads[name], scenario.fleet.share)


def _apads(scenario: Scenario) -> list[APad | AnotherAPad]:
    """`apad` first."""
    return [scenario.apad, *scenario.apads]


def _of_one(scenario: Scenario, apad: APad | AnotherAPad, share: tuple[int, ...]) -> Scenario:
    data = resolve(scenario)
    data.update(name=f"{scenario.name}-{plain(apad.name)}", apads=[])
    data["fleet"]["share"] = list(share)
    data["apad"].update(name=apad.name, start_m=list(apad.start_m))
    if isinstance(apad, AnotherAPad):
        if apad.battery_start_fraction is not None:
            data["apad"]["battery"]["start_fraction"] = apad.battery_start_fraction
        if apad.fault is not None:
            data["apad"]["fault"] = apad.fault.value
    return from_data(data, f"{scenario.name}: {apad.name}")
