"""A flight in virtual time with the supervisor and the simulated aPad in this process, and with its records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from apad_bridge.assembly import parts
from apad_bridge.mission.manual import Front
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs import flying
from apad_bridge.runs.nurseries import FOLDER
from apad_bridge.runs.progress import Shows
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start


def fly_here(
    scenario: Scenario,
    starts: Sequence[Start],
    directory: RunDirectory,
    progress: Shows,
    fronts: Sequence[Front] = (),
) -> dict[str, Any]:
    """Flies to the end and gives the summary."""
    recorder = Recorder(directory, scenario, parts.agent_ids(scenario))
    flying.journal_start(recorder, scenario, starts)
    fleet = flying.open_fleet(scenario, starts, directory.path / FOLDER)
    try:
        course = flying.Course(fronts=tuple(fronts))
        return flying.fly(scenario, flying.in_process(scenario, fleet), recorder, progress.show, course)
    finally:
        recorder.close()
        fleet.host.close()
