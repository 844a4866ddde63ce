"""Messages cross a pipe as they were written, whatever else is on it."""

from __future__ import annotations

import json
from typing import get_args

from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.runs.parent_protocol import (
    APadView,
    Failed,
    Gave,
    Kept,
    ParentMessage,
    Said,
    Summary,
    TransferredBelief,
    from_line,
    to_line,
)
from apad_bridge.runs.progress_status import RunStatus

IDS, NUMBERS = st.integers(1, 65535), st.floats(allow_nan=False)
PLACES = st.tuples(NUMBERS, NUMBERS)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | NUMBERS | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
)
STATUSES = st.builds(
    RunStatus,
    st.integers(),
    st.text(),
    st.text(),
    st.integers(),
    st.integers(),
    st.lists(IDS).map(tuple),
    st.integers(),
    NUMBERS,
    st.none() | NUMBERS,
    NUMBERS,
)
MESSAGES: dict[type, st.SearchStrategy[ParentMessage]] = {
    RunStatus: STATUSES,
    Said: st.builds(Said, st.text()),
    Summary: st.builds(Summary, st.dictionaries(st.text(), PLAIN)),
    Failed: st.builds(Failed, st.text()),
    APadView: st.builds(
        APadView, st.text(), st.booleans(), PLACES, st.dictionaries(IDS, PLACES), st.frozensets(IDS)
    ),
    Gave: st.builds(Gave, st.dictionaries(IDS, st.builds(TransferredBelief, IDS, PLAIN))),
    Kept: st.builds(Kept, st.lists(IDS).map(tuple)),
}


def test_no_message_is_left_out() -> None:
    assert set(MESSAGES) == set(get_args(ParentMessage))


@given(st.one_of(*MESSAGES.values()))
def test_a_message_is_read_as_it_was_written(message: ParentMessage) -> None:
    line = to_line(message)
    assert "\n" not in line
    assert from_line(line) == message


@given(
    st.text() | PLAIN.map(json.dumps) | st.builds(lambda name, it: json.dumps({name: it}), st.text(), PLAIN)
)
def test_any_other_line_is_said(line: str) -> None:
    assert from_line(line) == Said(line)
