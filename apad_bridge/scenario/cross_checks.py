"""What no single block of a scenario can see: values that are possible each by itself, but not together."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from agents.water.current import CurrentField
from apad_bridge.planning.registry import collection, redeployment
from apad_bridge.scenario.schema import DriftMode, Scenario

Contradiction = tuple[str, str]


def contradictions(scenario: Scenario) -> list[Contradiction]:
    """(path to the key, message) of each contradiction, in the order of the schema; none if the scenario can be run.

    Looks whether the files that the scenario names are there, reads the current's, and looks its strategies up.
    """
    return [*_of_the_fleet(scenario), *_of_the_mission(scenario)]


def _of_the_fleet(scenario: Scenario) -> list[Contradiction]:
    found = []
    fleet = scenario.fleet
    if isinstance(fleet.start, str) and not Path(fleet.start).exists():
        found.append(("fleet.start", f"no such file or directory: {fleet.start}"))
    drift = fleet.drift
    if drift.current_file is not None:
        problem = _problem_with_current(Path(drift.current_file))
        if problem:
            found.append(("fleet.drift.current_file", problem))
    if drift.mode is DriftMode.PHYSICAL and drift.amplitude_m:
        found.append(
            (
                "fleet.drift.amplitude_m",
                "physical drift has no random step: leave this key out, or use mode: paper",
            )
        )
    return found


def _problem_with_current(path: Path) -> str:
    try:
        CurrentField.parse(path.read_text(encoding="utf-8"))
    except OSError as error:
        return f"{error.strerror}: {path}"
    except ValueError as error:  # not UTF-8, or not a field
        return f"{path}: {error}"
    return ""


def _of_the_mission(scenario: Scenario) -> list[Contradiction]:
    found = []
    mission = scenario.mission
    named: tuple[tuple[str, Callable[[str], object], str], ...] = (
        ("mission.collection", collection, mission.collection),
        ("mission.redeployment", redeployment, mission.redeployment),
    )
    for key, look_up, name in named:
        try:
            look_up(name)
        except ValueError as error:
            found.append((key, str(error)))
    if mission.full_threshold <= mission.pool_threshold:
        found.append(
            (
                "mission.full_threshold",
                f"must be above mission.pool_threshold ({mission.pool_threshold}), "
                "or one that was charged would be a candidate again at once",
            )
        )
    if mission.speed_m_s > scenario.apad.max_speed_m_s:
        found.append(
            (
                "mission.speed_m_s",
                f"the aPad cannot go faster than apad.max_speed_m_s ({scenario.apad.max_speed_m_s})",
            )
        )
    return found
