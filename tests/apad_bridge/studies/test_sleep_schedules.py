"""The study of sleep: what it flies, and which schedule it recommends."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from apad_bridge.commands.main import main
from apad_bridge.studies import runner, study_report
from apad_bridge.studies.sleep_schedules import (
    AMUSSELS,
    ScheduleOutcome,
    reason_of,
    schedules_of,
    schedules_table,
    sleep_study,
)
from apad_bridge.studies.specification import StudyPlan


def rows_of(plan: StudyPlan, lost_above_samples: float) -> list[dict[str, Any]]:
    """Made-up rows: a schedule takes all its samples, and loses two aMussels where they are more than the limit."""
    figures = dict.fromkeys(("longest_gap_h", "dead_time_h", "metres"), 1.0)
    taken = [1e6 / dict(it.parameters)["board.whole.cycle.alarm_s"] for it in plan.settings]
    return [
        {
            "setting": index,
            "strategy": "cautious",
            "seed": seed,
            "amussels_lost": 2 if samples > lost_above_samples else 0,
            "samples_taken": samples,
            **figures,
        }
        for index, samples in enumerate(taken)
        for seed in plan.seeds
    ]


def test_it_varies_the_period_the_sampling_and_the_wake_around_what_the_docks_sustain() -> None:
    plan = sleep_study(2)
    schedules = schedules_of(plan, rows_of(plan, 0))
    assert len({(it.alarm_s, it.sample_s, it.processing_s) for it in schedules}) == 12 == len(plan.settings)
    assert all(len(plan.scenario(it, 0, 1).fleet.ids) == AMUSSELS for it in range(12))
    assert min(it.sustained for it in schedules) < AMUSSELS < max(it.sustained for it in schedules)


def test_it_recommends_the_most_samples_without_a_loss_and_says_what_more_would_cost() -> None:
    plan = sleep_study(2)
    schedules = schedules_of(plan, rows_of(plan, 600.0))
    assert (schedules[0].alarm_s, schedules[0].sample_s) == (1800.0, 60.0)
    reason = reason_of(schedules)
    assert reason.startswith("Of the 12 schedules 8 lose none; it takes the most samples of these, 556,")
    assert "The most samples, 1111, come from a wake every 15 min" in reason and "loses 2.00" in reason


def test_if_all_lose_some_it_says_so() -> None:
    plan = sleep_study(1)
    reason = reason_of(schedules_of(plan, rows_of(plan, 0)))
    assert "12 lose the fewest, 2.00 aMussels" in reason and "None takes more samples." in reason


def test_the_command_prints_the_schedules_and_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = runner.fly_block(_short_study(), 0, 1)[0]

    def fly_study(plan: StudyPlan, *arguments: Any) -> list[dict[str, Any]]:
        tmp_path.joinpath("out").mkdir(exist_ok=True)
        return [{**figures, **row} for row in rows_of(plan, 600.0)]

    monkeypatch.setattr(runner, "fly_study", fly_study)
    # Its twelve figures, twice, took longer than all the rest; other tests of studies draw theirs.
    monkeypatch.setattr(study_report, "_figures", lambda *_: iter(()))
    assert main(["study", "sleep", "--seeds", "2", "--out", str(tmp_path / "out")]) == 0
    recommended = "Recommended: a wake every 30 min, sensors on for 60 s"
    assert recommended in capsys.readouterr().out
    assert f"<p>{recommended}" in (tmp_path / "out" / "report.html").read_text()
    assert main(["study", "sleep", "--seeds", "2", "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["schedules"][0]["alarm_s"] == 1800 and "lose none" in printed["reason"]


def _short_study() -> StudyPlan:
    from scenario_files import POOL_FILE

    from apad_bridge.studies.specification import plan_of

    study = {
        "name": "one",
        "scenarios": [str(POOL_FILE)],
        "strategies": ["cautious"],
        "seeds": 1,
        "parameters": {"duration_s": [60.0]},
    }
    return plan_of(study, "test", Path("/"))


def test_a_screen_of_80_columns_cuts_no_number_and_no_heading(capsys: pytest.CaptureFixture[str]) -> None:
    schedule = ScheduleOutcome(3600, 60, 240, 24.1, 0.25, 1_105_123.0, 123.4, 1103.2, 12345.0)
    Console(width=80).print(schedules_table([schedule]))
    printed = capsys.readouterr().out
    assert "…" not in printed
    assert {"60", "240", "0.25", "1105123", "123.4", "1103.2", "12345", "24.1"} <= set(printed.split())
