"""`musselbed script`, and its page: every script on the page is flown, every command on it runs."""

import json
import re
import shlex
from pathlib import Path

import pytest
from journals import lines_in
from scenario_files import POOL_FILE

from apad_bridge.commands.main import main
from apad_bridge.events.run_events import EndReason
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.script_in_memory import fly_script
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs/scripting.md"
POOL = str(POOL_FILE)
HERE = ["--time", "asap", "--hosting", "one_process"]


def test_a_script_leaves_a_run_behind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text("api.collect(10, 4)\nprint('got', api.docks()[4])\n")
    run = tmp_path / "run"
    words = ["script", str(tmp_path / "mine.py"), "--scenario", POOL, *HERE, "--out", str(run), "--json"]
    assert main(words) == Exit.DONE
    summary = json.loads(capsys.readouterr().out)
    assert (summary["ended_by"], summary["run"]) == (EndReason.SCRIPT_ENDED, str(run))
    assert (run / "script.py").read_text() == (tmp_path / "mine.py").read_text()
    journal = lines_in(run / "journal.jsonl")
    assert [line["said"] for line in journal if line["kind"] == "script"] == ["got 10"]
    dock = next(it for it in journal if it["kind"] == "dock")
    assert (dock["dock"], dock["agent"]) == (3, 10)
    assert main(["replay", str(run)]) == Exit.DONE
    assert main(["resume", str(run)]) == Exit.USER_MISTAKE


@pytest.mark.parametrize(
    ("text", "told", "ended"),
    [
        (
            "time.sleep(1)\napi.docking(True, 7, 3)\n",
            "api.docking(True, 7, 3)",
            "Refused: there is no dock 7",
        ),
        (
            "print('to [lat, lon]', '[/home]')\nraise ValueError('not [north]')\n",
            "to [lat, lon] [/home]\n",
            "ValueError: not [north]",
        ),
    ],
)
def test_what_a_script_prints_and_raises_is_shown_as_it_is(
    tmp_path: Path, text: str, told: str, ended: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """An author of missions is shown no lines of the API's insides, and no table of a script that took no time."""
    script = tmp_path / "wrong.py"
    script.write_text(f"# scenario: {POOL}\n{text}")
    assert main(["script", str(script), *HERE, "--out", str(tmp_path / "run")]) == Exit.PEER_FAILED
    out, error = capsys.readouterr()
    assert told in error and "apad_bridge/scripting/" not in error
    assert ("Table II" in out) == ("sleep" in text)
    for shown in (out, error):
        assert f"failure of the script: wrong.py, line 3: {ended}" in shown


@pytest.mark.parametrize(
    ("text", "words", "told"),
    [
        ("x = (\n", ["--scenario", POOL], "line 1: '(' was never closed"),
        ("pass\n", [], "in which scenario?"),
        ("# scenario: no.yaml\n", [], "no.yaml: No such file"),
        (None, ["--scenario", POOL], "No such file"),
        ("pass\n", ["--scenario", POOL, "--apad", "ros"], "--time asap flies the simulated aPad"),
        ("pass\n", ["--scenario", POOL, "--no-fleet"], "it needs --apad ros"),
    ],
)
def test_a_mistake_is_one_line_before_anything_starts(
    tmp_path: Path, text: str | None, words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "s.py"
    if text is not None:
        script.write_text(text)
    assert main(["script", str(script), *HERE, "--out", str(tmp_path / "run"), *words]) == Exit.USER_MISTAKE
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def blocks(kind: str) -> list[str]:
    return re.findall(rf"^```{kind}\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("n", range(len(blocks("python"))))
def test_every_script_on_the_page_flies(
    n: int, pool: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    text = blocks("python")[n]
    if "def test_" in text:
        names: dict[str, object] = {}
        exec(text, names)
        for name, test in names.items():
            if name.startswith("test_"):
                assert callable(test)
                test()
        return
    path = tmp_path / "page.py"
    path.write_text(text)
    named = re.match(r"# scenario: (\S+)", text)
    flight = fly_script(load(ROOT / named[1]) if named else pool, path)
    assert (flight.error, flight.ended_by) == (None, EndReason.SCRIPT_ENDED)
    expected = re.findall(r"# prints: (.*)", text)
    assert list(flight.said[: len(expected)]) == expected


def test_every_command_on_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    commands = re.findall(r"^    musselbed (script .*--time asap.*)$", PAGE.read_text(), re.MULTILINE)
    assert len(commands) >= 2
    for n, command in enumerate(commands):
        words = [
            *shlex.split(command, comments=True),
            "--hosting",
            "one_process",
            "--out",
            str(tmp_path / f"{n}"),
        ]
        assert main(words) == Exit.DONE
        assert capsys.readouterr().out
