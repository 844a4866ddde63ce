"""A journal's lines as plain data, which tests write down, and read without the code that they test."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from scenario_files import POOL_FILE

from agents.mussel.outputs import Truth
from agents.time_scale import MissionMs
from apad_bridge.events.all_events import event_of
from apad_bridge.records.journal import Entry, JournalContents
from apad_bridge.records.run_state import RunState
from apad_bridge.runs.in_memory import MemoryRecorder
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario

Line = dict[str, Any]


def journal_of(lines: Iterable[Line], dropped: int = 0) -> JournalContents:
    """The events of these lines."""
    return JournalContents(
        [Entry(MissionMs(line["t"]), event_of(line["kind"], line)) for line in lines], dropped
    )


def state_of(lines: Iterable[Line]) -> RunState:
    """The state of a run in the pool after these lines, which go through JSON as a journal's do."""
    return RunState.of(load(POOL_FILE), journal_of(json.loads(json.dumps(list(lines)))))


def lines_in(journal: Path) -> list[Line]:
    """The whole lines of a journal so far; none without such a file."""
    whole = journal.read_bytes().split(b"\n")[:-1] if journal.exists() else []
    return [json.loads(line) for line in whole]


def facts_of(entries: MemoryRecorder | Iterable[Entry]) -> list[tuple[int, str, Line]]:
    """The time, the kind and the fields of each event."""
    found = entries.journal.entries if isinstance(entries, MemoryRecorder) else entries
    return [(at_ms, event.kind, event.data) for at_ms, event in found]


class Witness(MemoryRecorder):
    """Keeps the truths, too."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.kept: list[Truth] = []

    def truths(self, truths: list[Truth]) -> None:
        super().truths(truths)
        self.kept += truths
