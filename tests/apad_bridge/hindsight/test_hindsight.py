from __future__ import annotations

import json
from pathlib import Path

import pytest

from apad_bridge.beliefs.modes import Mode
from apad_bridge.commands.main import main
from apad_bridge.hindsight.compared import Compared
from apad_bridge.hindsight.scored import age_bin, scores_of

SCENARIOS = Path(__file__).parents[3] / "launch_scripts/scenarios"
TWIN = """beliefs:
  estimator: twin
  twin: {drain_deviation: 0.01, sensor_noise: 0.002, bias_deviation: 0.0005, unscheduled: 0.001, fix_deviation_m: 0.05}
"""


def row(
    agent_id: int, age_h: float, error: float, deviation: float | None, clamped: bool = False
) -> Compared:
    covered = None if deviation is None else abs(error) <= 1.96 * deviation
    return Compared(agent_id, 0, age_h, Mode.IDLE, True, error, deviation, covered, clamped, None)


def test_scores_are_counted_by_hand() -> None:
    scores = scores_of(
        [
            row(1, 0.0, 0.03, 0.01),
            row(1, 3.0, 0.0, 0.01),
            row(2, 3.0, -0.04, 0.04),
            row(2, 30, 0.0, 0.0, True),
        ]
    )
    assert scores is not None
    assert scores.overall.rmse == pytest.approx(0.025)
    assert scores.overall.bias == pytest.approx(-0.0025)
    assert scores.overall.coverage == 0.75
    assert scores.overall.nees == pytest.approx((9 + 0 + 1) / 3)
    assert {name: score.samples for name, score in scores.by_age.items()} == {
        "a minute": 1,
        "6 h": 2,
        "48 h": 1,
    }
    assert scores.by_agent["2"].coverage == 1.0 and scores.by_agent["2"].place_rmse_m is None
    assert list(scores.by_mode) == ["idle"]
    assert scores_of([]) is None
    assert [age_bin(age_h) for age_h in (0.0, 0.5, 24.0, 24.1, 100)] == [
        "a minute",
        "1 h",
        "24 h",
        "48 h",
        "older",
    ]


def test_beliefs_that_claim_to_be_certain_have_no_coverage() -> None:
    scores = scores_of([row(1, 0.0, 0.03, None)])
    assert scores is not None and scores.overall.coverage is None and scores.overall.nees is None


def fly(folder: Path, twins: bool, capsys: pytest.CaptureFixture[str]) -> Path:
    text = (SCENARIOS / "pool-12.yaml").read_text()
    text = text.replace("duration_s: 2400", "duration_s: 90").replace(
        "count: 12", "count: 3\n  hosting: one_process"
    )
    (folder / "few.yaml").write_text(text + (TWIN if twins else ""))
    (folder / "pool-12.csv").write_text((SCENARIOS / "pool-12.csv").read_text())
    assert main(["run", str(folder / "few.yaml"), "--time", "asap", "--out", str(folder / "run")]) == 0
    capsys.readouterr()
    return folder / "run"


def test_a_flight_on_twins_is_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = fly(tmp_path, True, capsys)
    picture = tmp_path / "beliefs.png"
    assert main(["beliefs", str(run), "--json", "--figure", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["overall"]["samples"] == 3 * 9 and set(found["by_agent"]) == {"1", "2", "3"}
    assert found["overall"]["rmse"] < 0.003 and found["overall"]["coverage"] > 0.8
    assert found["overall"]["mode_right"] == 1.0
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and picture.stat().st_size > 20_000
    assert main(["beliefs", str(run)]) == 0
    assert "packet up to" in capsys.readouterr().out


def test_mistakes_are_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (
        [str(tmp_path)],
        [str(tmp_path), "--period", "0"],
        [str(tmp_path), "--figure", "beliefs.jpeg"],
    ):
        assert main(["beliefs", *arguments]) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1 and told.startswith("musselbed beliefs: ")
