"""Divides a scenario with several aPads into a scenario for each, with the aPad's share of the fleet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from apad_bridge.ros_names.names import plain
from apad_bridge.scenario.another_apad import AnotherAPad
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import with_values
from apad_bridge.scenario.schema import APad, Scenario
from apad_bridge.scenario.starts_table import Start


@dataclass(frozen=True, slots=True)
class Member:
    """One aPad and the aMussels that it serves: a scenario that flies by itself, and its starts."""

    name: str
    scenario: Scenario
    starts: tuple[Start, ...]


def members(scenario: Scenario, starts: Sequence[Start]) -> tuple[Member, ...]:
    """Returns the members in the scenario's order of aPads, each with its planned share. A single one has all."""
    if not scenario.apads:
        return (Member(scenario.apad.name, scenario, tuple(starts)),)
    # Imported here, because it computes with numpy, and most fleets have one aPad.
    from apad_bridge.planning.fleet_shares import allocate

    places_m = {start.agent_id: (start.north_m, start.east_m) for start in starts}
    return divided(scenario, starts, allocate([apad.start_m for apad in _apads(scenario)], places_m))


def divided(
    scenario: Scenario, starts: Sequence[Start], shares_of_apads: Sequence[tuple[int, ...]]
) -> tuple[Member, ...]:
    """Returns the members with the given shares. They keep the whole scenario's ids, seed, timeslots and starts.

    In water each aPad has its turn to send.
    """
    turns = [(n, 1 + len(scenario.apads)) for n in range(1, 2 + len(scenario.apads))]
    return tuple(
        Member(
            apad.name,
            _of_one(scenario, apad, ids, turn),
            tuple(start for start in starts if start.agent_id in ids),
        )
        for apad, ids, turn in zip(_apads(scenario), shares_of_apads, turns, strict=True)
    )


def with_apad(scenario: Scenario, name: str) -> Scenario:
    """Returns the scenario with this aPad alone, over the whole fleet. Raises ScenarioError if it has no such aPad."""
    apads = {apad.name: apad for apad in _apads(scenario)}
    if name not in apads:
        raise ScenarioError([f"{scenario.name} has no aPad {name}: its aPads are {', '.join(apads)}"])
    return _of_one(scenario, apads[name], scenario.fleet.share)


def _apads(scenario: Scenario) -> list[APad | AnotherAPad]:
    """Lists all aPads, `apad` first."""
    return [scenario.apad, *scenario.apads]


def _of_one(
    scenario: Scenario, apad: APad | AnotherAPad, ids: tuple[int, ...], turn: tuple[int, int] | None = None
) -> Scenario:
    values: dict[str, Any] = {
        "name": f"{scenario.name}-{plain(apad.name)}",
        "apads": [],
        "fleet.share": ids,
        "apad.name": apad.name,
        "apad.start_m": apad.start_m,
    }
    if scenario.water is not None:
        values["water.talk.turn"] = turn
    if isinstance(apad, AnotherAPad):
        values |= {"apad.battery.start_fraction": apad.battery_start_fraction, "apad.fault": apad.fault}
    given = {key: value for key, value in values.items() if value is not None}
    if scenario.sharing.consensus is not None:
        given["sharing.consensus"] = None
    return with_values(scenario, given, f"{scenario.name}: {apad.name}")
