"""The paper's Table II: its rows against an independent stepper and against random configurations."""

from dataclasses import asdict
from itertools import product
from pathlib import Path

import pytest
from journals import facts_of

from apad_bridge.runs.in_memory import fly_in_memory
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.loader import load, with_values
from apad_bridge.scenario.starts import read_starts, starts_of
from apad_bridge.studies.fitted_starts import TOLERANCES, FittedStarts, fitted_study, fly_fitted
from apad_bridge.studies.models import Model, fly
from apad_bridge.studies.runner import fly_study
from apad_bridge.studies.table_two import (
    BESIDE,
    CHARGES,
    COLUMNS,
    FIGURES,
    PAPER,
    TableTwo,
    notes,
    percentile_of,
    table_two,
    table_two_study,
)

SCENARIOS = Path(__file__).parents[3] / "launch_scripts/scenarios"


def stepped_uptimes(charges: list[float], theta: int, steps: int) -> list[float]:
    """Equation (3) over equation (1), literally: u_k = u_(k-1) - 0.0010427134 theta dt, dt = 1/60 min, in [0, 1]."""
    uptimes = []
    for u in charges:
        active = 0
        for _ in range(steps):
            u = min(1.0, max(0.0, u - 0.0010427134 * theta / 60))
            active += u > 0
        uptimes.append(100 * active / steps)
    return uptimes


def test_no_charging_is_the_paper_s_row_and_an_independent_stepper_s() -> None:
    scenario = load(SCENARIOS / "no-charging.yaml")
    flown = fly(scenario, Model.EVENT_DRIVEN)
    paper = next(row for row in PAPER if row.collection == "none")
    found = (flown.uptime_paper_mean, flown.uptime_paper_max, flown.uptime_paper_min)
    assert found == pytest.approx((paper.mean, paper.max, paper.min), abs=0.05)
    assert (flown.active_mean, flown.metres) == (pytest.approx(paper.active_mean, abs=0.05), 0)
    # One step is 0.042 points; the flight's own battery may differ from the stepper's floats by one step at most.
    uptimes = stepped_uptimes([start.primary for start in starts_of(scenario)], 30, 2400)
    assert found == pytest.approx((sum(uptimes) / len(uptimes), max(uptimes), min(uptimes)), abs=0.05)


def test_cautious_on_random_configurations_has_the_paper_s_row_inside_its_central_90_percent(
    tmp_path: Path,
) -> None:
    """Speed 0.5 m/s, 20 s for dock and undock together and a cluster of 28 x 21 m are the shipped pool-12's."""
    plan = table_two_study(30)
    findings = TableTwo(plan, fly_study(plan, tmp_path, 2))
    assert [it for it in findings.lines(80) if str(it).startswith("* ")] == [f"* {it}" for it in notes()]
    data = findings.as_data()
    assert [it["setting"] for it in data["settings"]] == [
        f"{name}, cell {charges}, theta 30" for name in ("pool-12", "bay-24") for charges in CHARGES
    ]
    compared = data["table2"]
    assert [(it["charges"], it["row"], it["column"]) for it in compared] == [
        (charges, row.name, column) for charges in CHARGES for row in PAPER for column in (*COLUMNS, *BESIDE)
    ]
    cautious = [it for it in compared if it["row"] == "Cautious" and it["column"] in COLUMNS]
    assert cautious and [it["column"] for it in cautious if not 5 <= it["percentile"] <= 95] == []


def test_the_two_greedy_rows_read_as_if_another_time_had_been_recorded() -> None:
    recorded = {row.name: 40 * row.recorded for row in PAPER if row.recorded != 1}
    assert recorded == {
        "Greedy": pytest.approx(38.76, abs=0.01),
        "Greedy (bay)": pytest.approx(42.56, abs=0.01),
    }
    first, second = notes()
    assert "1.032 times 12 x 72.27 / 100" in first and "38.8 of 40 minutes" in first
    assert "0.940 times 24 x 71.98 / 100" in second and "42.6 of 40 minutes" in second


def test_searched_starts_fit_cautious_and_keep_what_the_row_without_charging_says(tmp_path: Path) -> None:
    plan = fitted_study("cautious", 1)
    findings = FittedStarts(plan, fly_study(plan, tmp_path, fly_fitted("cautious", tmp_path, 1)))
    seconds = {(it["row"], it["seconds"]): it for it in findings.as_data()["fitted"]}
    assert list(seconds) == [("Cautious", 2400), ("Greedy", 2400), ("Greedy", 2326), ("No charging", 2400)]
    cautious, none = seconds[("Cautious", 2400)], seconds[("No charging", 2400)]
    for (column, tolerance), end in product(TOLERANCES.items(), ("p5", "p95")):
        assert cautious[column][end] == pytest.approx(cautious[column]["paper"], abs=tolerance), column
        assert none[column][end] == pytest.approx(none[column]["paper"], abs=0.05), column
    starts = read_starts(tmp_path / "starts-1.csv", load(SCENARIOS / "pool-12.yaml").area, range(1, 13))
    assert all(0 <= it.north_m <= 28 and 0 <= it.east_m <= 21 for it in starts)


def test_shipped_starts_give_the_bay_s_row_and_nearly_those_of_the_pool(tmp_path: Path) -> None:
    plan = fitted_study("shipped")
    findings = FittedStarts(plan, fly_study(plan, tmp_path, 2))
    found = {(it["row"], it["seconds"]): it for it in findings.as_data()["fitted"]}
    assert list(found) == [
        ("Cautious", 2400),
        ("Greedy", 2400),
        ("Greedy", 2326),
        ("Greedy (bay)", 2553),
        ("Greedy (bay)", 2400),
        ("No charging", 2400),
    ]
    for row, part in (("Cautious", 2400), ("Greedy", 2326), ("Greedy (bay)", 2553), ("No charging", 2400)):
        nearly = 1.0 if "bay" in row or row == "No charging" else 2.1
        for column, tolerance in TOLERANCES.items():
            its = found[row, part][column]
            assert its["median"] == pytest.approx(its["paper"], abs=nearly * tolerance), (row, column)


def test_searches_for_other_rows_share_no_directory(tmp_path: Path) -> None:
    """Their scenarios and settings are equal, and their starts are not."""
    fly_study(fitted_study("cautious", 1), tmp_path, lambda plan, blocks: iter([(it, []) for it in blocks]))
    with pytest.raises(UserError, match="another study"):
        fly_study(fitted_study("greedy", 1), tmp_path, 1)


def test_a_flight_recorded_in_part_has_uptimes_of_the_whole_mission(tmp_path: Path) -> None:
    """Without charging all are empty by minute 32: a flight of 38.8 minutes has the uptime of 40, and a greater Active."""
    plan = fitted_study("greedy", 1)
    idle = load(SCENARIOS / "no-charging.yaml")
    flown = [
        asdict(fly(with_values(idle, {"duration_s": it}, ""), Model.EVENT_DRIVEN)) for it in (2400, 2326)
    ]
    rows = [
        {"setting": setting, "strategy": strategy, "seed": 1, **figures}
        for setting, figures in enumerate(flown)
        for strategy in plan.strategies
    ]
    whole, part = (it for it in FittedStarts(plan, rows).as_data()["fitted"] if it["row"] == "Greedy")
    found = [part[it]["median"] for it in ("mean", "active_mean")]
    expected = [whole["mean"]["median"], whole["active_mean"]["median"] * 2400 / 2326]
    assert found == pytest.approx(expected, abs=0.01)


def test_at_theta_1_nothing_is_compared_with_the_paper(tmp_path: Path) -> None:
    plan = table_two_study(1, theta=1)
    assert plan.study.name != table_two_study(1).study.name  # their directories
    assert {setting.theta for setting in plan.settings} == {1}
    assert plan.scenario(0, 0, 1).duration_s == 30 * 2400  # 20 hours of the aMussels, as at theta 30
    ones = dict.fromkeys((*FIGURES.values(), *BESIDE), 1.0)
    places = product(range(len(plan.settings)), plan.strategies)
    rows = [{"setting": index, "strategy": strategy, "seed": 1, **ones} for index, strategy in places]
    assert {it["percentile"] for it in table_two(plan, rows)} == {None}


def test_a_percentile_is_the_share_at_or_below() -> None:
    assert [percentile_of(value, [3.0, 1.0, 2.0, 4.0]) for value in (0.0, 2.0, 2.5, 9.0)] == [0, 50, 50, 100]


def test_the_shipped_pool_loses_no_mussel_and_drives_what_it_planned() -> None:
    scenario = load(SCENARIOS / "pool-12.yaml")
    figures, recorder = fly_in_memory(scenario)
    assert (figures["amussels_lost"], figures["emptied"]) == (0, 0)
    left_full = [data["agent"] for _, kind, data in facts_of(recorder) if kind == "released" and data["full"]]
    assert figures["services"] == len(left_full) and set(left_full) == set(scenario.fleet.ids)
    legs = [data["metres"] for _, kind, data in facts_of(recorder) if kind == "leg"]
    assert figures["planned_m"] == pytest.approx(sum(legs), abs=1e-4 * len(legs))
    # Each leg ends within the victory radius of its goal, and mission time cuts the last one off.
    least_m = sum(legs[:-1]) - scenario.mission.victory_radius_m * len(legs)
    assert least_m < figures["cost_m"] < figures["planned_m"]
