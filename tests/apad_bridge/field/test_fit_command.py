"""`musselbed fit battery`: its block goes into a scenario, each refusal is one line, and the page is true."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml
from scenario_files import POOL_FILE, WHOLE_FILE

from apad_bridge.commands.main import main
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.loader import from_data, load, resolve

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs/battery-fit.md"


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """charge.csv by equation (2) and discharge.csv by equation (1), a row a minute, with 3 mV of noise."""
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(7)
    rows = [0.0]
    while (u := rows[-1]) < 1:
        rows.append(u + (0.001045 if u <= 0.16197 else 0.00223 if u <= 0.5634 else 0.002911))
    falling = [1 - 0.0010427134 * minute for minute in range(959)]
    for name, scaled in (("charge.csv", rows[:-1]), ("discharge.csv", falling)):
        lines = [f"{n},{3600 + 600 * u + random.normal(0, 3):.1f}" for n, u in enumerate(scaled)]
        (tmp_path / name).write_text("\n".join(["time_min,voltage_mv", *lines]) + "\n")
    return tmp_path


def test_the_printed_block_makes_a_scenario(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "battery", "charge.csv", "discharge.csv"]) == Exit.DONE
    told = capsys.readouterr().out
    block = yaml.safe_load(told[told.index("board:") :])["board"]
    scenario = yaml.safe_load(POOL_FILE.read_text())
    scenario["board"] |= block
    scenario["fleet"]["start"] = {"charge": [0.6, 1.0]}
    (logs / "mine.yaml").write_text(yaml.safe_dump(scenario))
    board = load(logs / "mine.yaml").board
    assert board.discharge_per_min == pytest.approx(0.0010427134, rel=0.01)
    flat = [number for segment in board.charge_segments for number in segment]
    assert flat == pytest.approx([0.16197, 0.001045, 0.5634, 0.00223, 1.0, 0.002911], rel=0.05)


def test_a_bent_discharge_makes_a_whole_board(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["fit", "battery", "charge.csv", "discharge.csv", "--segments", "2", "--lift-mv", "24"]
    assert main(words) == Exit.DONE
    told = capsys.readouterr().out
    block = yaml.safe_load(told[told.index("board:") :])["board"]["whole"]["power"]
    data = resolve(load(WHOLE_FILE))
    data["board"]["whole"]["power"] |= block
    power = from_data(data, "mine").board.whole.power
    # The log's discharge is a straight line, so its two pieces lie on it.
    assert [volts for _, volts in power.metering.discharge_curve] == pytest.approx(
        [charge for charge, _ in power.metering.discharge_curve], abs=0.02
    )
    assert power.charge_segments == tuple(map(tuple, block["charge_segments"]))


def test_json_has_the_fit_the_residuals_and_the_block(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "battery", "charge.csv", "--segments", "2", "--json"]) == Exit.DONE
    told = json.loads(capsys.readouterr().out)
    (fit,) = told["fits"]
    rows = [segment["rows"] for segment in fit["segments"]]
    assert (fit["direction"], len(rows), sum(rows)) == ("charging", 2, fit["rows"])
    assert fit["rmse"] > 0.005  # two pieces do not fit three; the noise alone is 0.005
    assert list(told["board"]) == ["charge_segments"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("charge.csv charge.csv", "both logs are charging"),
        ("charge.csv --segments 0", "one or more"),
        ("charge.csv --direction discharging", "goes the wrong way"),
        ("charge.csv discharge.csv charge.csv", "one log, or one of a charge"),
        ("charge.csv discharge.csv --figure a.svg", "draws one log"),
        ("charge.csv --figure a.jpeg", "must end in one of .png, .svg, .pdf"),
        ("charge.csv --figure no/a.svg", "no/a.svg: No such file"),
        ("charge.csv --empty-mv 4300", "--empty-mv must lie below"),
        ("missing.csv", "No such file"),
    ],
)
def test_a_mistake_is_one_line(logs: Path, words: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "battery", *words.split()]) == Exit.USER_MISTAKE
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1


def test_every_command_on_the_page_runs(logs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    commands = re.findall(r"^    musselbed (fit .*)$", PAGE.read_text(), re.MULTILINE)
    assert len(commands) >= 3
    for command in commands:
        assert main(shlex.split(command, comments=True)) == Exit.DONE, command
        assert capsys.readouterr().out
    assert (logs / "charge.svg").read_text().startswith("<?xml")
