"""The parent of several aPads handles the lines that their runs write, and their ends."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from apad_bridge.runs.parent_protocol import Failed, Message, Said, Summary, to_line
from apad_bridge.runs.several.parent import MemberWatch
from apad_bridge.runs.status import Status


class Run:
    """A run of one aPad: it writes its lines to a real pipe; asked to end, it writes `last` and ends."""

    def __init__(self, *message: Message | str, last: Message | None = None) -> None:
        reader, self._writer = os.pipe()
        self.lines = os.fdopen(reader)
        self.log = Path("somewhere/parent.log")
        self._last = last
        self.asked = 0
        for it in message:
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

    def last_log_line(self) -> str:
        return "its last words"

    def _say(self, message: Message | str) -> None:
        text = message if isinstance(message, str) else to_line(message)
        os.write(self._writer, f"{text}\n".encode())


class ProgressLog:
    def __init__(self) -> None:
        self.message: list[str] = []
        self.statuses: list[Status] = []

    def print_message(self, text: str) -> None:
        self.message.append(text)

    def show_status(self, status: Status) -> None:
        self.statuses.append(status)


def status(now_ms: int, served: int, way_m: float) -> Status:
    return Status(now_ms, "dock", "dock", 4, 3, 1, served, way_m, 0.9, 0.0)


def read_all(runs: dict[str, Run], nodes: dict[str, Any], progress: ProgressLog) -> Any:
    try:
        return MemberWatch(runs, nodes, progress).read_until_all_ended()  # type: ignore[arg-type]
    finally:
        for run in runs.values():
            run.lines.close()


def test_statuses_are_added_and_words_stand_with_their_aPad() -> None:
    progress = ProgressLog()
    runs = {
        "a": Run(status(9000, 2, 10.0), Said("hello"), Summary({"services": 2})),
        "b": Run(status(7000, 1, 5.0), Summary({"services": 1})),
    }
    assert read_all(runs, {}, progress) == ({"a": {"services": 2}, "b": {"services": 1}}, {})
    last = progress.statuses[-1]
    assert (last.now_ms, last.phase, last.agents, last.services, last.cost_m) == (7000, "2 aPads", 8, 3, 15.0)
    assert progress.message == ["a: hello"]


def test_one_that_fails_leaves_the_others_their_summaries() -> None:
    runs = {"a": Run(Summary({})), "b": Run(Failed("no fleet")), "c": Run()}
    summaries, failures = read_all(runs, {}, ProgressLog())
    assert summaries == {"a": {}}
    assert failures == {"b": "no fleet", "c": "ended without a summary: its last words; see somewhere"}


def test_a_simulated_aPad_that_died_ends_its_own_run_only() -> None:
    """Run `a` has written its summary and needs no end. Run `b` would fly on without its vehicle."""
    runs = {"a": Run(Summary({})), "b": Run(last=Summary({"services": 1}))}
    nodes = {"a": SimpleNamespace(poll=lambda: None), "b": SimpleNamespace(poll=lambda: -9)}
    summaries, failures = read_all(runs, nodes, ProgressLog())
    assert summaries == {"a": {}, "b": {"services": 1}}
    assert failures == {"b": "the simulated aPad's node ended with status -9"}
    assert (runs["a"].asked, runs["b"].asked) == (0, 1)


def test_a_line_that_is_no_message_is_shown_as_text() -> None:
    lines = ["a warning", "{", '{"status": {"now_ms": "x"}}', '{"summary": 5}', "[]", "5", '{"gave": [[1]]}']
    progress = ProgressLog()
    assert read_all({"a": Run(*lines, Summary({}))}, {}, progress) == ({"a": {}}, {})
    assert progress.message == [f"a: {line}" for line in lines]
