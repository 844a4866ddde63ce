"""Messages cross a pipe as they were written, whatever else is on it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.runs.children import Child, EndedTooSlowly, Interrupts, read_children
from apad_bridge.runs.parent import watch_supervisor
from apad_bridge.runs.parent_protocol import (
    Broken,
    Failed,
    Gave,
    HandedOver,
    Kept,
    Message,
    Said,
    Seen,
    Summary,
    from_line,
    to_line,
)
from apad_bridge.runs.status import Status
from apad_bridge.vehicle.errors import PeerFailed

IDS, NUMBERS = st.integers(1, 65535), st.floats(allow_nan=False)
PLACES = st.tuples(NUMBERS, NUMBERS)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | NUMBERS | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
)
STATUSES = st.builds(
    Status,
    *(st.integers(), st.text(), st.text(), st.integers(), st.integers(), st.integers(), st.integers()),
    *(NUMBERS, st.none() | NUMBERS, NUMBERS),
)
MESSAGES: dict[type, st.SearchStrategy[Message]] = {
    Status: STATUSES,
    Said: st.builds(Said, st.text()),
    Summary: st.builds(Summary, st.dictionaries(st.text(), PLAIN)),
    Failed: st.builds(Failed, st.text()),
    Seen: st.builds(Seen, st.text(), st.booleans(), PLACES, st.dictionaries(IDS, PLACES), st.frozensets(IDS)),
    Gave: st.builds(Gave, st.lists(st.builds(HandedOver, IDS, IDS, PLAIN)).map(tuple)),
    Kept: st.builds(Kept, st.lists(IDS).map(tuple)),
    Broken: st.builds(Broken, st.text()),
}


def test_no_message_is_left_out() -> None:
    assert set(MESSAGES) == set(get_args(Message))


@given(st.one_of(*MESSAGES.values()))
def test_a_message_is_read_as_it_was_written(message: Message) -> None:
    line = to_line(message)
    assert "\n" not in line
    assert from_line(line) == message


@given(
    st.text() | PLAIN.map(json.dumps) | st.builds(lambda name, it: json.dumps({name: it}), st.text(), PLAIN)
)
def test_any_other_line_is_said(line: str) -> None:
    assert from_line(line) == Said(line)


class Shown:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def print_message(self, text: str) -> None:
        self.lines.append(text)

    def show_status(self, status: Status) -> None:
        self.lines.append(status.phase)


def writer_of(folder: Path, text: str, monkeypatch: pytest.MonkeyPatch) -> Child:
    """A real process that writes this text and ends."""
    (folder / "spoken.py").write_text(
        "import os, pathlib, sys\nos.write(1, pathlib.Path(sys.argv[1]).read_bytes())\n"
    )
    (folder / "lines").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return Child("supervisor", "spoken", [str(folder / "lines")], folder / "log", {})


def test_a_supervisor_is_read_to_its_last_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    status = Status(1, "dock", "dock", 4, 3, 1, 0, 1.0, None, 0.0)
    lines = ["a warning", to_line(status), '{"summary": 5}', to_line(Summary({"services": 1})), '{"torn']
    shown = Shown()
    child = writer_of(tmp_path, "\n".join(lines), monkeypatch)
    assert watch_supervisor(child, shown) == (0, {"services": 1})
    assert shown.lines == ["a warning", "dock", '{"summary": 5}', '{"torn']


def test_a_failure_that_it_names_is_a_peers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    child = writer_of(tmp_path, to_line(Failed("no fleet")) + "\n", monkeypatch)
    with pytest.raises(PeerFailed, match="no fleet"):
        watch_supervisor(child, Shown())


def test_one_that_does_not_end_in_time_is_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "deaf.py").write_text(
        "import signal\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nprint('up', flush=True)\nsignal.pause()\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    child = Child("supervisor", "deaf", [], tmp_path / "log", {})
    interrupts = Interrupts()
    try:
        with pytest.raises(EndedTooSlowly):
            for _, message in read_children({"supervisor": child}, interrupts, 0.2):
                assert message == Said("up")
                interrupts.interrupted = True
    finally:
        child.end(5.0)
