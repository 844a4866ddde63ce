"""`musselbed runs` lists the runs of a folder, whatever became of them."""

import json
import os
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from apad_bridge.commands.look.runs import RunRow, lines_of
from apad_bridge.commands.main import main
from apad_bridge.runs.supervisor_lock import supervising


@pytest.fixture
def folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """A run that ended, one that was killed, one that is damaged and a folder that is no run."""
    runs = tmp_path / "runs"
    command = ["run", str(POOL_FILE), "--time", "asap", "--hosting", "one_process", "--out"]
    assert main([*command, str(runs / "whole")]) == 0
    for name, at_s in (("killed", 2_000_000_000), ("damaged", 2_000_000_100)):
        (runs / name).mkdir()
        for file in ("scenario.yaml", "versions.json"):
            (runs / name / file).write_bytes((runs / "whole" / file).read_bytes())
        os.utime(runs / name / "versions.json", (at_s, at_s))
    (runs / "damaged" / "summary.json").write_text("{")
    (runs / "notes").mkdir()
    capsys.readouterr()
    return runs


def test_runs_are_listed_newest_first_with_their_figures(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with supervising(folder / "killed"):
        assert main(["runs", str(folder), "--json"]) == 0
    damaged, killed, whole = json.loads(capsys.readouterr().out)
    summary = json.loads((folder / "whole" / "summary.json").read_text())
    assert damaged["run"] == "damaged" and damaged["state"].startswith("summary.json cannot be read")
    expected = {"run": "killed", "begun": "2033-05-18T03:33:20Z", "state": "flies", "services": None}
    assert killed | expected == killed
    uptime = pytest.approx(summary["uptime_paper"]["mean"], abs=0.005)
    expected = {"run": "whole", "state": "mission time", "services": summary["services"], "uptime": uptime}
    assert {name: whole[name] for name in expected} == expected
    assert main(["runs", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert "did not end" in shown and "mission time" in shown


def test_a_long_error_takes_one_line_and_a_stop_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = folder / "whole" / "summary.json"
    error = "failure of the script: " + "a long reason, and another; " * 40
    path.write_text(json.dumps(json.loads(path.read_text()) | {"ended_by": error, "stopped_s": 1260.0}))
    monkeypatch.setenv("COLUMNS", "120")
    assert main(["runs", str(folder)]) == 0
    (line,) = (it for it in capsys.readouterr().out.splitlines() if it.strip().startswith("whole"))
    assert "stopped for 21 min; failure of the script" in line and "…" in line
    assert main(["runs", str(folder), "--json"]) == 0
    whole = json.loads(capsys.readouterr().out)[-1]
    assert whole["state"] == error and whole["stopped_s"] == 1260


FAILED, FIGURES = "a failure of the script with a long reason", (100.0, 123456.0, 1234, 119)


@pytest.mark.parametrize("width", [80, 100, 120, 160])
def test_no_name_and_no_figure_is_cut_on_a_screen_of_any_width(width: int) -> None:
    rows = [
        RunRow("pool-12-20261126T172923Z", "", "mission time", 12, 2400.0, 74.3, 276.87, 16, 0),
        RunRow("whole-board-12-20261126T172923Z", "", "flies"),
        RunRow("energy_exchange-real-apad-20261126T172923Z", "", FAILED, 120, 604800.0, *FIGURES, 1260.0),
    ]
    lines = lines_of(rows, width)
    assert max(map(len, lines)) <= width
    text = " ".join("\n".join(lines).split())
    for told in (
        *(row.run for row in rows),
        " 12 40 74.30 277 16 0 ",
        " 120 10080 100.00 123456 1234 119",
        "agents minutes uptime %",
        "stopped for 21 m",
    ):
        assert told in text


def test_a_folder_that_is_not_there_is_a_mistake_and_an_empty_one_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["runs", str(tmp_path / "gone")]) == 2
    assert "fly a scenario first" in capsys.readouterr().err
    assert main(["runs", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"no runs in {tmp_path}\n"
