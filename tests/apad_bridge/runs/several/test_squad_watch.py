"""What the parent of several aPads makes of what their runs say, and of their ends."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from apad_bridge.runs.several.parent import Watch
from apad_bridge.runs.status import Status


class Run:
    """A run of one aPad: what it says comes through a real pipe; asked to end, it says `last` and ends."""

    def __init__(self, *said: dict[str, Any] | str, last: dict[str, Any] | None = None) -> None:
        reader, self._writer = os.pipe()
        self.lines = os.fdopen(reader)
        self.log = Path("somewhere/parent.log")
        self._last = last
        self.asked = 0
        for it in said:
            self._say(it)
        if last is None:
            os.close(self._writer)

    def ask_to_end(self) -> None:
        self.asked += 1
        if self._last is not None:
            self._say(self._last)
            os.close(self._writer)

    def end(self, timeout_s: float) -> None:
        pass

    def last_words(self) -> str:
        return "its last words"

    def _say(self, said: dict[str, Any] | str) -> None:
        text = said if isinstance(said, str) else json.dumps(said)
        os.write(self._writer, f"{text}\n".encode())


class Shown:
    def __init__(self) -> None:
        self.said: list[str] = []
        self.statuses: list[Status] = []

    def say(self, text: str) -> None:
        self.said.append(text)

    def show(self, status: Status) -> None:
        self.statuses.append(status)


def status(now_ms: int, served: int, way_m: float) -> str:
    return Status(now_ms, "dock", "dock", 4, 3, 1, served, way_m, 0.9, 0.0).to_line()


def watched(runs: dict[str, Run], nodes: dict[str, Any], shown: Shown) -> Any:
    try:
        return Watch(runs, nodes, shown).until_all_ended()  # type: ignore[arg-type]
    finally:
        for run in runs.values():
            run.lines.close()


def test_statuses_are_added_and_words_stand_with_their_aPad() -> None:
    shown = Shown()
    runs = {
        "a": Run(status(9000, 2, 10.0), {"said": "hello"}, {"summary": {"services": 2}}),
        "b": Run(status(7000, 1, 5.0), {"summary": {"services": 1}}),
    }
    assert watched(runs, {}, shown) == ({"a": {"services": 2}, "b": {"services": 1}}, {})
    last = shown.statuses[-1]
    assert (last.now_ms, last.phase, last.agents, last.services, last.cost_m) == (7000, "2 aPads", 8, 3, 15.0)
    assert shown.said == ["a: hello"]


def test_one_that_fails_leaves_the_others_their_summaries() -> None:
    runs = {"a": Run({"summary": {}}), "b": Run({"failed": "no fleet"}), "c": Run()}
    summaries, failures = watched(runs, {}, Shown())
    assert summaries == {"a": {}}
    assert failures == {"b": "no fleet", "c": "ended without a summary: its last words; see somewhere"}


def test_a_simulated_aPad_that_died_ends_its_own_run_only() -> None:
    """Run `a` waits for nothing: it has said its summary. Run `b` would fly on without its vehicle."""
    runs = {"a": Run({"summary": {}}), "b": Run(last={"summary": {"services": 1}})}
    nodes = {"a": SimpleNamespace(poll=lambda: None), "b": SimpleNamespace(poll=lambda: -9)}
    summaries, failures = watched(runs, nodes, Shown())
    assert summaries == {"a": {}, "b": {"services": 1}}
    assert failures == {"b": "the simulated aPad's node ended with status -9"}
    assert (runs["a"].asked, runs["b"].asked) == (0, 1)
