"""A script flown in virtual time, in this process, without ROS or files: for tests of scripts and behaviours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from apad_bridge.mission.state import MissionState
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api
from apad_bridge.scripting.program import Program, ScriptSource, as_program
from apad_bridge.scripting.rendezvous import AS_FAST_AS_POSSIBLE, Turns


@dataclass(frozen=True, slots=True)
class ScriptFlight:
    """What came of it: why it ended and when, what the script said, the journal's events, and the mission's last state."""

    ended_by: str
    mission_s: float
    said: tuple[str, ...]
    events: tuple[tuple[int, str, dict[str, Any]], ...]
    state: MissionState
    error: BaseException | None
    """What the script raised."""


def fly_script(
    scenario: Scenario, script: Path | Callable[[Api], object], turns: Turns = AS_FAST_AS_POSSIBLE
) -> ScriptFlight:
    """Flies a script's file, or a function that is given the API, to its end. ScriptError when the file cannot be one."""
    program: Program = as_program(script) if isinstance(script, Path) else script
    name = script.name if isinstance(script, Path) else Path(script.__code__.co_filename).name
    said: list[str] = []
    command_source = ScriptSource(scenario, program, name, said.append, turns)
    flight, recorder = open_flight(scenario, (command_source,))
    ended_by = flight.run()
    command_source.join()
    return ScriptFlight(
        ended_by,
        flight.now_ms / 1000,
        tuple(said),
        tuple(recorder.events),
        flight.supervisor.mission.state,
        command_source.error,
    )
