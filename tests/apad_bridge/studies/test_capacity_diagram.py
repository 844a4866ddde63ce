"""The phase diagram of capacity: its two states by a balance worked by hand, and what is read from its rows."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from apad_bridge.assembly.capacity_bounds import bounds_of
from apad_bridge.commands.main import main
from apad_bridge.studies import runner
from apad_bridge.studies.capacity_diagram import (
    AMUSSELS,
    MEAN_CHARGES,
    borders_of,
    capacity_study,
    held_from,
    phases_of,
)
from apad_bridge.studies.models import Model, fly
from apad_bridge.studies.specification import StudyPlan

LATE_H = 48
"""The last fifth of ten days."""


def setting_of(plan: StudyPlan, amussels: int, mean: float) -> int:
    wanted = {
        "fleet.count": amussels,
        "fleet.start": {"charge": [round(mean - 0.2, 6), round(mean + 0.2, 6)]},
    }
    values = [dict(it.parameters) for it in plan.settings]
    return next(n for n, it in enumerate(values) if it | wanted == it)


@pytest.fixture
def plan() -> StudyPlan:
    return capacity_study(1)


@pytest.mark.parametrize("amussels", [12, 15])
def test_a_fleet_that_begins_low_has_as_many_dead_as_it_is_larger_than_the_bound_from_empty(
    plan: StudyPlan, amussels: int
) -> None:
    """Docks that fill each aMussel from empty hold 4 and keep 7.9 at work; the rest is dead.

    A fleet of 12 that begins high is held for ever: the command flies both.

    By equation (2) a battery takes 8.08 h from empty to full, and by equation (1) it lasts 15.98 h at work.
    4 x 15.98 / 8.08 is 7.9. The ways and the closing of docks take a few minutes of each charge on top.
    """
    scenario = plan.scenario(setting_of(plan, amussels, 0.2), 0, 1)
    bound = bounds_of([scenario]).sustained_from_empty
    assert bound == pytest.approx(11.9, abs=0.05)
    figures = fly(scenario, Model.EVENT_DRIVEN)
    assert LATE_H * (amussels - bound) < figures.dead_late_h < LATE_H * (amussels - bound) + 4


def test_late_dead_hours_are_those_of_the_last_fifth(plan: StudyPlan) -> None:
    """A fleet that nobody serves dies within 20 hours of 25, and stays dead in the last five."""
    scenario = plan.scenario(setting_of(plan, 9, 0.2), 0, 1)
    scenario = replace(
        scenario,
        duration_s=25 * 3600.0,
        mission=replace(scenario.mission, collection="none"),
    )
    figures = fly(scenario, Model.EVENT_DRIVEN)
    assert figures.dead_late_h == pytest.approx(9 * 5.0, abs=0.01)
    assert figures.dead_time_h > figures.dead_late_h


def rows_of(plan: StudyPlan, border: dict[int, float]) -> list[dict[str, Any]]:
    """Made-up rows: a fleet is held from its border on; no start holds a fleet that has none."""
    rows = []
    for index, setting in enumerate(plan.settings):
        values: dict[str, Any] = dict(setting.parameters)
        low, high = values["fleet.start"]["charge"]
        is_held = (low + high) / 2 >= border.get(values["fleet.count"], 2.0) - 1e-9
        figures = {"setting": index, "dead_late_h": 0.0 if is_held else 7.0, "uptime_paper_mean": 70.0}
        trials = product(plan.strategies, plan.seeds)
        rows += [{**figures, "strategy": strategy, "seed": seed} for strategy, seed in trials]
    return rows


def test_a_border_is_the_least_charge_from_which_on_every_flight_is_held() -> None:
    plan = capacity_study(2)
    phases = phases_of(plan, rows_of(plan, {9: 0.2, 12: 0.5}))
    assert len(phases) == 2 * len(AMUSSELS) * len(MEAN_CHARGES) and phases[0].flown == 2
    found = {amussels: least for strategy, amussels, least in borders_of(phases) if "batch" in strategy}
    assert (found[9], found[12], found[16]) == (0.2, 0.5, None)
    own = [it for it in phases if it.amussels == 12 and "batch" in it.strategy]
    assert held_from([replace(it, held=1) if it.start_charge == 0.7 else it for it in own]) == 0.8


def test_the_command_prints_both_states_and_draws_them(
    plan: StudyPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = replace(plan.scenario(0, 0, 1), duration_s=600.0)
    flown = runner.fly_block  # one short flight gives every other figure of the rows
    monkeypatch.setattr(StudyPlan, "scenario", lambda *_: scenario)
    figures = flown(plan, 0, 1)[0]
    monkeypatch.undo()

    def fly_study(plan: StudyPlan, *arguments: Any) -> list[dict[str, Any]]:
        tmp_path.joinpath("out").mkdir(exist_ok=True)
        return [{**figures, **row} for row in rows_of(plan, {9: 0.2, 12: 0.5})]

    monkeypatch.setattr(runner, "fly_study", fly_study)
    arguments = ["study", "capacity", "--seeds", "1", "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "held from" in printed and "never" in printed
    assert "at most 15.2 aMussels, and 11.9 if each charge begins at empty" in printed
    drawn = (tmp_path / "out" / "diagram.svg").read_text()
    assert drawn.count("cautious") >= 2
    for name in ("sustained at most", "sustained if each charge begins at empty"):
        assert f"<!-- {name} -->" in drawn
    assert "prefers-color-scheme: dark" in drawn
    assert main([*arguments, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["phases"]) == 112


def test_capacity_says_that_its_bound_is_no_promise_and_from_where_it_is_reached(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("apad_bridge.studies.capacity_diagram.MEAN_CHARGES", (0.2, 0.8))
    monkeypatch.setattr("apad_bridge.studies.commands.capacity._SEEDS", (1,))
    arguments = ["capacity", "pool-12", "--theta", "1"]
    assert main(arguments) == 0
    assert "15.2 is a bound and no promise: more than 11.9 aMussels" in capsys.readouterr().out
    assert main([*arguments, "--fly"]) == 0
    printed = capsys.readouterr().out
    assert "from a mean charge of 0.2: 0 of 1 flights held" in printed
    assert "the fleet is held for ever from a mean charge of 0.8 at the start" in printed
