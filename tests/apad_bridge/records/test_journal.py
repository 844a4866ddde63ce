"""Tests the journal: lines are read as they were written, and a kill costs only the line that it tore."""

import math

import pytest

from apad_bridge.records.journal import FORMAT_VERSION, Journal, format_of, read_journal


@pytest.fixture
def path(tmp_path):
    return tmp_path / "journal.jsonl"


def test_lines_come_back_in_order(path):
    journal = Journal(path)
    journal.append(1000, "leg", {"metres": 3.25})
    journal.append(500, "plan", {"steps": [{"agent": 3, "dock": 0}], "strategy": "größte"})
    journal.close()
    contents = read_journal(path)
    assert contents.lines == [
        {"t": 1000, "kind": "leg", "metres": 3.25},
        {"t": 500, "kind": "plan", "steps": [{"agent": 3, "dock": 0}], "strategy": "größte"},
    ]
    assert (contents.dropped, contents.last_ms) == (0, 1000)


def test_what_is_flushed_is_on_disk_before_the_close(path):
    journal = Journal(path)
    journal.append(0, "run", {})
    assert path.read_bytes() == b""
    journal.flush()
    assert path.read_bytes() == b'{"t":0,"kind":"run"}\n'


def test_every_torn_length_costs_one_line_and_is_said(path):
    journal = Journal(path)
    journal.append(0, "run", {})
    journal.append(1000, "leg", {"metres": 1})
    journal.close()
    whole = path.read_bytes()
    first = whole.index(b"\n") + 1
    for length in range(first + 1, len(whole)):
        path.write_bytes(whole[:length])
        contents = read_journal(path)
        assert [line["kind"] for line in contents.lines] == ["run"]
        assert contents.dropped == 1


def test_a_journal_goes_on_after_a_torn_line(path):
    path.write_bytes(b'{"t":0,"kind":"run"}\n{"t":1000,"ki')
    journal = Journal(path)
    assert journal.torn_bytes == 13
    journal.append(2000, "end", {})
    journal.close()
    contents = read_journal(path)
    assert [line["kind"] for line in contents.lines] == ["run", "end"]
    assert contents.dropped == 0


def test_a_torn_line_longer_than_one_look_is_cut_whole(path):
    path.write_bytes(b'{"t":0,"kind":"run"}\n' + b"x" * 200_000)
    journal = Journal(path)
    journal.close()
    assert journal.torn_bytes == 200_000
    assert path.read_bytes() == b'{"t":0,"kind":"run"}\n'


@pytest.mark.parametrize(
    "line", [b"[1]", b"{}", b'{"t":"0","kind":"run"}', b'{"t":0,"kind":7}', b"\xff\xfe", b"null"]
)
def test_a_line_that_is_none_is_counted(path, line):
    path.write_bytes(line + b'\n{"t":0,"kind":"run"}\n')
    contents = read_journal(path)
    assert (len(contents.lines), contents.dropped) == (1, 1)


def test_not_a_number_is_refused(path):
    journal = Journal(path)
    with pytest.raises(ValueError, match="not JSON compliant"):
        journal.append(0, "leg", {"metres": math.nan})
    journal.close()
    assert path.read_bytes() == b""


def test_a_journal_of_format_1_is_read_with_the_keys_of_today(path):
    path.write_text(
        '{"t":0,"kind":"run","format":1}\n'
        '{"t":1,"kind":"plan","steps":[{"agent":3,"slot":0}],"what":"collect"}\n'
        '{"t":2,"kind":"primitive","name":"dock","agent":3,"slot":0}\n'
        '{"t":3,"kind":"dock","slot":0,"agent":3,"closed":true}\n'
        '{"t":4,"kind":"packet","from":3,"slot":5}\n'
        '{"t":5,"kind":"apad","slots":[3,-1,-1,-1]}\n'
    )
    assert format_of(path) == 1
    _, plan, primitive, dock, packet, apad = read_journal(path).lines
    assert plan == {"t": 1, "kind": "plan", "steps": [{"agent": 3, "dock": 0}], "what": "collect"}
    assert primitive == {"t": 2, "kind": "primitive", "name": "dock", "agent": 3, "dock": 0}
    assert dock == {"t": 3, "kind": "dock", "dock": 0, "agent": 3, "closed": True}
    assert packet == {"t": 4, "kind": "packet", "from": 3, "timeslot": 5}
    assert apad == {"t": 5, "kind": "apad", "docks": [3, -1, -1, -1]}


def test_a_journal_says_its_format_in_its_first_line(path):
    journal = Journal(path)
    journal.append(0, "run", {"format": FORMAT_VERSION})
    journal.close()
    assert format_of(path) == FORMAT_VERSION
    path.write_text("garbage\n")
    assert format_of(path) is None


def test_a_line_that_is_nested_without_end_is_dropped_and_counted(path):
    path.write_text('{"t":0,"kind":"run"}\n' + "[" * 100_000 + "\n")
    contents = read_journal(path)
    assert ([line["kind"] for line in contents.lines], contents.dropped) == (["run"], 1)
