"""Flies a script in virtual time, in this process, without ROS or files: for tests of scripts and behaviours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from apad_bridge.events.mission_events import MissionState
from apad_bridge.events.run_events import EndReason
from apad_bridge.planning.registry import Trust
from apad_bridge.records.journal import Entry
from apad_bridge.runs.in_memory import open_flight
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api
from apad_bridge.scripting.program import Program, ScriptSource, as_program
from apad_bridge.scripting.rendezvous import AS_FAST_AS_POSSIBLE, TurnTimeouts
from apad_bridge.supervisor.run_spec import RunSpec


@dataclass(frozen=True, slots=True)
class ScriptFlight:
    """The result: the reason and time of the end, the script's output, the events, the mission's last state."""

    ended_by: str
    end_reason: EndReason
    mission_s: float
    said: tuple[str, ...]
    events: tuple[Entry, ...]
    state: MissionState
    error: BaseException | None
    """The exception that the script raised."""


def fly_script(
    scenario: Scenario, script: Path | Callable[[Api], object], turns: TurnTimeouts = AS_FAST_AS_POSSIBLE
) -> ScriptFlight:
    """Flies a script's file, or a function that takes the API, to its end. ScriptError when the file is not a script, and
    ScenarioError when it cannot be read."""
    program: Program = as_program(script, Trust()) if isinstance(script, Path) else script
    name = script.name if isinstance(script, Path) else Path(script.__code__.co_filename).name
    messages: list[str] = []
    command_source = ScriptSource(scenario, program, name, messages.append, turns)
    flight, recorder = open_flight(scenario, RunSpec(command_sources=(command_source,)))
    end = flight.run()
    command_source.join()
    return ScriptFlight(
        ended_by=str(end),
        end_reason=end.reason,
        mission_s=flight.now_ms / 1000,
        said=tuple(messages),
        events=tuple(recorder.journal.entries),
        state=flight.supervisor.mission.state,
        error=command_source.error,
    )
