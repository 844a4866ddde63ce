"""Checks that a scenario could be flown here: reads it as `musselbed run` does, before anything starts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from apad_bridge.doctor.finding import Finding, fail, ok, warn
from apad_bridge.scenario.errors import ScenarioError, in_ranges

if TYPE_CHECKING:
    from apad_bridge.planning.registry import Trust
    from apad_bridge.scenario.schema import Scenario


def read(path: Path, trust: Trust | None = None) -> tuple[Scenario | None, list[Finding]]:
    """Returns the scenario, if it can be read and its strategies can be loaded, and the findings.

    Strategies in files are executed with `trust` alone, and otherwise named as left out.
    """
    try:
        # Here and not above: a package that shadows one of ours must not keep the doctor from loading.
        from apad_bridge.scenario.cross_checks import warnings
        from apad_bridge.scenario.loader import load
    except ImportError as error:
        return None, [fail("scenario", f"cannot be read here: {error}", "see the checks of packages")]
    try:
        scenario = load(path)
    except ScenarioError as error:
        return None, [
            fail("scenario", line, "mend the file: docs/scenarios.md explains every key")
            for line in error.lines
        ]
    mission = scenario.mission
    found = f"{path} can be read; strategies {mission.collection} and {mission.redeployment}"
    doubts = [warn("scenario", happens, mend) for happens, mend in warnings(scenario)]
    return scenario, [
        ok("scenario", found),
        *doubts,
        *_check_strategies(scenario, trust),
        *_check_starts_and_codec(scenario),
    ]


def _check_strategies(scenario: Scenario, trust: Trust | None) -> Iterator[Finding]:
    from apad_bridge.planning.registry import NotTrusted
    from apad_bridge.scenario.cross_checks import problems_with_strategies

    for key, problem in problems_with_strategies(scenario, trust):
        if isinstance(problem, NotTrusted):
            yield warn("scenario", f"{key} was left out: {problem}", "it is then loaded and checked")
        else:
            yield fail("scenario", f"{key}: {problem}", "mend the file: docs/scenarios.md explains every key")


def _check_starts_and_codec(scenario: Scenario) -> Iterator[Finding]:
    from apad_bridge.scenario.starts import starts_of
    from firmware_model.packets.codec import load_codec

    try:
        starts = starts_of(scenario)
        if starts:
            yield ok("starts", f"{len(starts)} aMussels, ids {in_ranges(it.agent_id for it in starts)}")
        else:
            yield ok("starts", "no aMussels")
    except ScenarioError as error:
        for line in error.lines:
            yield fail("starts", line, "mend the file that fleet.start names")
    codec = scenario.hearing.codec
    try:
        load_codec(codec)
        yield ok("codec", codec)
    except Exception as error:
        yield fail("codec", f"{codec}: {error}", "install its package, or name another in hearing.codec")
