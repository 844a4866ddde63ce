"""`musselbed replay`, as a person types it: the page's path, or one line with the fault."""

import argparse
import json
import shutil
from datetime import UTC, datetime

import pytest
from scenario_files import POOL_FILE

from apad_bridge.commands.look import replay
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import journal_start
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of


def command(*words):
    parser = argparse.ArgumentParser()
    replay.add_parser(parser.add_subparsers())
    arguments = parser.parse_args(["replay", *map(str, words)])
    return replay.run(arguments)


@pytest.fixture
def run_dir(tmp_path):
    scenario = load(POOL_FILE)
    directory = RunDirectory.create("pool-12", datetime(2026, 5, 4, tzinfo=UTC), tmp_path / "run")
    directory.write_inputs(scenario, starts_of(scenario))
    recorder = Recorder(directory, scenario, [1])
    journal_start(recorder, scenario, starts_of(scenario)[:1])
    recorder.tick(0, [], None, None, "none", (None, None, None, None))
    recorder.close()
    return directory.path


def test_the_page_of_a_run_that_has_not_ended(run_dir, capsys):
    page = run_dir / "replay.html"
    assert (command(run_dir), capsys.readouterr().out) == (0, f"{page}\n")
    assert page.read_text().startswith("<!DOCTYPE html>")


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        (None, "", "run/nowhere: no such folder: name the directory of a run"),
        (".", "", r"no run: it has no journal\.jsonl"),
        ("journal.jsonl", '{"t":0,"kind":"tick"}\n', r"cannot be shown: the journal has no line `run`"),
        ("scenario.yaml", "name: x\n", r"scenario\.yaml: .*missing\Z"),
    ],
)
def test_what_is_no_run_is_said_in_one_line(run_dir, file, text, told):
    run = run_dir if text else run_dir / "nowhere"
    if text:
        (run_dir / file).write_text(text)
    elif file:
        run.mkdir()
    with pytest.raises(UserError, match=rf"\A.*{told}"):
        command(run)


def test_a_browser_that_is_not_there_is_said(run_dir, monkeypatch):
    opened = []
    monkeypatch.setattr(replay.webbrowser, "open", lambda address: bool(opened.append(address)))
    with pytest.raises(UserError, match="no browser could be started"):
        command(run_dir, "--open")
    assert opened == [(run_dir / "replay.html").as_uri()]


@pytest.mark.parametrize(
    "line", [b'{"t":9,"kind":"belief","id":1}', b'{"t":9,"kind":"dock","dock":99,"agent":1,"closed":true}']
)
def test_a_damaged_line_is_said_by_file_and_number(run_dir, line):
    journal = run_dir / "journal.jsonl"
    number = journal.read_bytes().count(b"\n") + 1
    journal.write_bytes(journal.read_bytes() + line + b"\n")
    with pytest.raises(UserError) as raised:
        command(run_dir)
    assert str(raised.value).startswith(f"{journal}, line {number}: ") and "\n" not in str(raised.value)


def test_a_second_run_is_put_beside_the_first(run_dir, tmp_path, capsys):
    other = tmp_path / "other"
    shutil.copytree(run_dir, other)
    assert command(run_dir, other, "--json") == 0
    page = run_dir / "compared-with-other.html"
    assert json.loads(capsys.readouterr().out) == {"page": str(page), "bytes": page.stat().st_size}
    with pytest.raises(UserError, match="gone"):
        command(run_dir, tmp_path / "gone")
