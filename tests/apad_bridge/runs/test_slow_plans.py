"""A strategy that thinks for long is told while it thinks."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest
from scenario_files import POOL_FILE

from apad_bridge.assembly.division import members
from apad_bridge.planning import registry
from apad_bridge.planning.strategies.paper_strategies import Cautious
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs import flying
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.runs.several.lockstep import fly_in_step
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.starts import starts_of

PATIENCE_S = 60.0


def test_it_is_told_while_it_plans_and_at_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = threading.Event()

    class Thinks(Cautious):
        def plan(self, situation: Any, batch: int) -> Any:
            assert told.wait(PATIENCE_S), "nobody tells"
            return super().plan(situation, batch)

    class Progress(FlightProgress):
        def print_message(self, text: str) -> None:
            super().print_message(text)
            told.set()

    monkeypatch.setitem(registry._BUILT_IN, "cautious", Thinks)
    monkeypatch.setattr(flying, "SLOW_PLAN_S", 0.01)
    data = resolve(load(POOL_FILE))
    data |= {"duration_s": 60}
    data["fleet"] |= {"hosting": "one_process", "start": {"charge": [0.5, 0.6]}}
    scenario = from_data(data, "test")
    directory = RunDirectory(tmp_path)
    directory.write_inputs(scenario, starts_of(scenario))
    progress = Progress("test", 60_000, quiet=True)
    fly_in_step(members(scenario, starts_of(scenario)), scenario.sharing, directory, progress)
    waits, at_last = [it for it in progress.messages if it.startswith("strategy cautious")][:2]
    assert waits == "strategy cautious has planned for 0.01 s by now: mission time waits for it"
    assert at_last == "strategy cautious planned for 0 s"


def test_a_quick_one_is_not_told() -> None:
    lines: list[str] = []
    with flying.progress_when_slow("greedy", lines.append):
        pass
    assert lines == []
