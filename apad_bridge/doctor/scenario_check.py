"""Checks that a scenario could be flown here: reads it as `musselbed run` does, before anything starts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from apad_bridge.doctor.finding import Check, Finding, fail, ok, run_checks, warn
from apad_bridge.scenario.errors import ScenarioError, in_ranges

if TYPE_CHECKING:
    from apad_bridge.planning.registry import Trust
    from apad_bridge.scenario.schema import Scenario

_MEND = "docs/reference/scenario-keys.md explains every key"


def read(path: Path, trust: Trust | None = None) -> tuple[Scenario | None, list[Finding]]:
    """Returns the scenario, if it can be read and its strategies can be loaded, and the findings.

    Strategies in files are executed with `trust` alone, and otherwise named as left out.
    """
    try:
        # Here and not above: a package that shadows one of ours must not keep the doctor from loading.
        from apad_bridge.scenario.loader import load
    except ImportError as error:
        return None, [fail(f"cannot be read here: {error}", "see the checks of packages", check="scenario")]
    try:
        scenario = load(path)
    except ScenarioError as error:
        return None, [fail(line, _MEND, check="scenario") for line in error.lines]
    mission = scenario.mission
    found = f"{path} can be read; strategies {mission.collection} and {mission.redeployment}"
    return scenario, [ok(found, check="scenario"), *run_checks(CHECKS, (scenario, trust))]


def _check_outcome(scenario: Scenario) -> list[Finding]:
    from apad_bridge.scenario.flight_readiness import warnings

    return [warn(happens, mend) for happens, mend in warnings(scenario)]


def _check_strategies(scenario: Scenario, trust: Trust | None) -> Iterator[Finding]:
    from apad_bridge.planning.registry import NotTrusted
    from apad_bridge.scenario.flight_readiness import problems_with_strategies

    for key, problem in problems_with_strategies(scenario, trust):
        if isinstance(problem, NotTrusted):
            yield warn(f"{key} was left out: {problem}", "it is then loaded and checked")
        else:
            yield fail(f"{key}: {problem}", _MEND)


def _check_starts(scenario: Scenario) -> Iterator[Finding]:
    from apad_bridge.assembly.safety import unreachable_starts
    from apad_bridge.scenario.starts import further_columns, starts_of

    try:
        starts = starts_of(scenario)
        found = (
            f"{len(starts)} aMussels, ids {in_ranges(it.agent_id for it in starts)}"
            if starts
            else "no aMussels"
        )
        further = further_columns(starts)
        yield ok(f"{found}; further columns are kept: {', '.join(further)}" if further else found)
        yield from (warn(happens, mend) for happens, mend in unreachable_starts(scenario, starts))
    except ScenarioError as error:
        for line in error.lines:
            yield fail(line, "mend the file that fleet.start names")


def _check_codec(scenario: Scenario) -> Finding:
    from firmware_model.packets.codec import load_codec

    codec = scenario.hearing.codec
    try:
        load_codec(codec)
    except Exception as error:
        return fail(f"{codec}: {error}", "install its package, or name another in hearing.codec")
    return ok(codec)


CHECKS: tuple[Check[tuple[Scenario, Trust | None]], ...] = (
    Check("scenario", lambda it: _check_outcome(it[0])),
    Check("scenario", lambda it: _check_strategies(*it)),
    Check("starts", lambda it: _check_starts(it[0])),
    Check("codec", lambda it: _check_codec(it[0])),
)
