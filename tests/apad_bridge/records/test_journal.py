"""Tests the journal: lines are read as they were written, and a kill costs only the line that it tore."""

import json
import math
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from apad_bridge.events.all_events import UnknownEvent, event_of
from apad_bridge.events.fleet_events import BeliefChanged, Presence, PresenceChanged, TruthChanged
from apad_bridge.events.mission_events import DockSwitched, LegBegan
from apad_bridge.events.person_events import ScriptReported
from apad_bridge.events.run_events import RunEnded, TickPassed
from apad_bridge.events.sound_events import LinksRead, PacketPassed
from apad_bridge.records.journal import (
    FORMAT_VERSION,
    Journal,
    JournalDamaged,
    JournalTail,
    format_of,
    read_journal,
)
from firmware_model.actions import Buoyancy
from firmware_model.states import State

ROOT = Path(__file__).parents[3]
SAID = {"what": "collect", "strategy": "größte", "steps": [{"agent": 3, "dock": 0}], "beliefs": []} | {
    "costs": {"distance_m": 1.5, "demand": 0.5, "distance_cost": 1.5, "energy_cost": 2}
}

RUN = {"kind": "run", "scenario": "a", "theta": 1, "seed": 1, "duration_s": 9.0, "agents": []} | {
    "pool_threshold": 0.8,
    "full_threshold": 0.99,
}


def lines(contents):
    return [it.line for it in contents.entries]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "journal.jsonl"


@pytest.fixture
def journal(path) -> Journal:
    return Journal(path)


def written(path, *lines):
    """The contents of a journal of these lines."""
    with closing(Journal(path)) as journal:
        for at_ms, event in lines:
            journal.append(at_ms, event)
    return read_journal(path)


def test_lines_of_one_flush_come_back_by_time_and_else_as_they_were_appended(journal, path):
    for at_ms, event in ((1000, LegBegan(3.25)), (500, event_of("plan", SAID)), (1000, LegBegan(1.5))):
        journal.append(at_ms, event)
    before = path.read_bytes()
    journal.flush()
    contents = read_journal(path)
    assert (before, contents.dropped, contents.last_ms) == (b"", 0, 1000)
    assert lines(contents) == [
        {"t": 500, "kind": "plan", **SAID},
        {"t": 1000, "kind": "leg", "metres": 3.25},
        {"t": 1000, "kind": "leg", "metres": 1.5},
    ]
    journal.close()


@given(flushes=st.lists(st.lists(st.integers(0, 5000), max_size=6), max_size=6))
def test_time_never_falls_in_a_journal(tmp_path_factory, flushes):
    path = tmp_path_factory.mktemp("law") / "journal.jsonl"
    journal, kept, newest_ms = Journal(path), [], 0
    for times in flushes:
        for at_ms in times:
            if at_ms < newest_ms:
                with pytest.raises(
                    ValueError, match=f"time went back: .* {at_ms} ms after one of {newest_ms} ms"
                ):
                    journal.append(at_ms, TickPassed())
            else:
                journal.append(at_ms, LegBegan(len(kept)))
                kept.append(at_ms)
        journal.flush()
        newest_ms = max(kept, default=0)
    journal.close()
    assert [it.at_ms for it in read_journal(path).entries] == sorted(kept)
    again = Journal(path, newest_ms)
    with pytest.raises(ValueError, match="time went back"):
        again.append(newest_ms - 1, TickPassed())
    again.close()


def test_every_torn_length_costs_one_line_and_is_said(path):
    written(path, (0, TickPassed()), (1000, LegBegan(1)))
    whole = path.read_bytes()
    first = whole.index(b"\n") + 1
    for length in range(first + 1, len(whole)):
        path.write_bytes(whole[:length])
        contents = read_journal(path)
        assert ([line["kind"] for line in lines(contents)], contents.dropped) == (["tick"], 1)


@pytest.mark.parametrize("torn", [b'{"t":1000,"ki', b"x" * 200_000], ids=["short", "longer than one look"])
def test_a_journal_goes_on_after_a_torn_line(path, torn):
    path.write_bytes(b'{"t":0,"kind":"tick"}\n' + torn)
    journal = Journal(path)
    assert journal.torn_bytes == len(torn)
    journal.append(2000, RunEnded("a call"))
    journal.close()
    contents = read_journal(path)
    assert ([line["kind"] for line in lines(contents)], contents.dropped) == (["tick", "end"], 0)


@pytest.mark.parametrize(
    "line",
    [b"[1]", b"{}", b'{"t":"0","kind":"run"}', b'{"t":0,"kind":7}', b"\xff\xfe", b"null", b"[" * 100_000],
    ids=lambda it: repr(it[:30]),
)
def test_a_line_that_is_none_is_counted(path, line):
    path.write_bytes(line + b'\n{"t":0,"kind":"tick"}\n')
    contents = read_journal(path)
    assert ([it["kind"] for it in lines(contents)], contents.dropped) == (["tick"], 1)


def test_a_journal_says_its_format_in_its_first_line(path):
    written(path, (0, event_of("run", {"format": FORMAT_VERSION, **RUN})))
    assert format_of(path) == FORMAT_VERSION
    path.write_text("garbage\n")
    assert format_of(path) is None


@pytest.mark.parametrize(
    ("event", "why"),
    [
        (LegBegan(math.nan), "`leg` with a wrong `metres`"),
        (LegBegan("1"), "`leg` with a wrong `metres`"),  # type: ignore[arg-type]
        (LegBegan(None), "`leg` with a wrong `metres`"),  # type: ignore[arg-type]
        (DockSwitched(99, 1, True), "`dock` with a wrong `dock`"),
        (DockSwitched(True, 1, True), "`dock` with a wrong `dock`"),
        (PresenceChanged(1, "lost", "me"), "`presence` with a wrong `is`"),  # type: ignore[arg-type]
        (ScriptReported(5), "`script` with a wrong `said`"),  # type: ignore[arg-type]
    ],
)
def test_an_event_with_a_wrong_value_is_our_own_mistake(journal, path, event, why):
    with pytest.raises(ValueError, match=why):
        journal.append(0, event)
    journal.close()
    assert path.read_bytes() == b""


@pytest.mark.parametrize(
    ("damaged", "why"),
    [
        (b'{"t":5,"kind":"leg"}', "a line `leg` without `metres`"),
        (b'{"t":5,"kind":"leg","metres":"far"}', "a line `leg` with a wrong `metres`"),
        (b'{"t":5,"kind":"leg","metres":NaN}', "a line `leg` with a wrong `metres`"),
        (
            b'{"t":5,"kind":"mission","phase":"dock","snapshot":{}}',
            "a line `mission` with a wrong `snapshot`",
        ),
        (b'{"t":5,"kind":"truth","id":1}', "a line `truth` without `agent_ms`"),
    ],
)
def test_a_damaged_line_is_named_by_file_and_number(path, damaged, why):
    quiet = b'{"t":1,"kind":"tick"}\n' * 3
    path.write_bytes(quiet + b"torn\n" + quiet + damaged + b"\n" + quiet)
    with pytest.raises(JournalDamaged) as raised:
        read_journal(path)
    assert f"{path}, line 8: {why}" in str(raised.value) and "\n" not in str(raised.value)


def test_kinds_and_fields_of_another_version_are_left_alone(path):
    path.write_bytes(b'{"t":5,"kind":"leak","litres":2}\n{"t":6,"kind":"leg","metres":1,"feet":3}\n')
    (leak, leg) = read_journal(path).entries
    assert leak.line == {"t": 5, "kind": "leak", "litres": 2} and leak.event.text() is None
    assert leg == (6, LegBegan(1))


def test_a_journal_of_before_the_first_release_is_refused_in_one_line_and_a_newer_one_is_not(path):
    path.write_text(json.dumps({"t": 0, "format": 1, **RUN}) + "\n")
    with pytest.raises(JournalDamaged, match=r"before 0\.1\.0 \(format 1\).*the version that flew the run"):
        read_journal(path)
    path.write_text(json.dumps({"t": 0, "format": FORMAT_VERSION + 1, **RUN}) + "\n")
    assert read_journal(path).last_ms == 0


@pytest.mark.parametrize(
    "event",
    [
        TruthChanged(
            1,
            5,
            State.FLOATING,
            (1, 2, 0, 0, 0),
            (1, 2, 1, 0, 0),
            3,
            4,
            (5, 6),
            Buoyancy.FLOAT,
            False,
            log=(2, 1),
        ),
        PacketPassed(
            3, None, "status", 3, 1000, 693, None, None, [(0, "received", 1.5, 2, 3.5, 4.5)], "0102ff"
        ),
        LinksRead([(1, None, 0.5, 0, None)], None),
        PresenceChanged(1, Presence.REAL, "me"),
        BeliefChanged(1, 0, State.FLOATING, 0.5, 1.0, 2.0, 3.0),
        ScriptReported(what="leak", own={"litres": [1, {"a": None}]}),
        UnknownEvent("leak", {"litres": 2}),
        ScriptReported(said="caf\udce9.yaml"),  # a name of bytes that are no text
    ],
)
def test_an_event_is_read_as_it_was_written_with_its_tuples_and_enums(path, event):
    assert written(path, (7, event)).entries == [(7, event)]


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cuts=st.lists(st.integers(0, 400), max_size=12))
def test_a_tail_reads_a_growing_file_as_it_is_read_whole_wherever_it_was_cut(path, cuts):
    whole = b"".join(
        [
            *(b'{"t":%d,"kind":"leg","metres":1.5}\n' % n for n in range(5)),
            b"damaged\n",
            '{"t":9,"kind":"remark","text":"größer","by":"Anna"}\n'.encode(),
        ]
    )
    path.write_bytes(b"")
    tail = JournalTail(path)
    found, dropped = [], 0
    ends = [*sorted(min(cut, len(whole)) for cut in cuts), len(whole)]
    for begin, end in zip([0, *ends], ends, strict=False):
        with path.open("ab") as file:
            file.write(whole[begin:end])
        new = tail.read_new()
        found += lines(new)
        dropped += new.dropped
    tail.close()
    assert [line["t"] for line in found] == [0, 1, 2, 3, 4, 9] and dropped == 1
    assert found == lines(read_journal(path))


def test_a_tail_names_the_line_that_is_damaged(path):
    path.write_bytes(b'{"t":0,"kind":"tick"}\n{"t":1,"kind":"leg"}\n')
    with closing(JournalTail(path)) as tail, pytest.raises(JournalDamaged, match=r"journal\.jsonl, line 2: "):
        tail.read_new()


def test_a_page_reads_the_lines_of_a_resumed_supervisor_behind_a_torn_one(path):
    """It has read the torn line's beginning when the next supervisor cuts that off and writes on."""
    path.write_bytes(b'{"t":1000,"kind":"tick"}\n{"t":34')
    with closing(JournalTail(path)) as tail:
        assert [it.at_ms for it in tail.read_new().entries] == [1000]
        with closing(Journal(path, 1000)) as second:
            second.append(337_000, TickPassed())
            second.append(338_000, TickPassed())
        assert [it.at_ms for it in tail.read_new().entries] == [337_000, 338_000]
