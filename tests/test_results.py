"""The page of results: what an archive keeps of a study, and what is said of the goal."""

from __future__ import annotations

import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from scenario_files import POOL_FILE

from apad_bridge.studies.runner import fly_study
from apad_bridge.studies.specification import plan_of

MAKE = Path(__file__).parents[1] / "docs/results/make"


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The command as a module."""
    loader = SourceFileLoader("make_results", str(MAKE))
    spec = spec_from_loader(loader.name, loader)
    assert spec is not None
    module = module_from_spec(spec)
    monkeypatch.setitem(sys.modules, loader.name, module)
    monkeypatch.setattr(sys, "path", list(sys.path))
    loader.exec_module(module)
    return module


def test_an_archive_has_the_figures_of_each_mission(
    make: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of(
        {
            "name": "short",
            "scenarios": [str(POOL_FILE)],
            "strategies": ["greedy", "cautious"],
            "seeds": 2,
            "parameters": {"duration_s": [300.0]},
            "cells": {"few": {"fleet.count": 3}, "all": {}},
        },
        "test",
        Path("/"),
    )
    rows = fly_study(plan, tmp_path / "short", 1)
    monkeypatch.setattr(make, "HERE", tmp_path)
    monkeypatch.setattr(make, "plan_named", lambda name: plan)
    make.archive(tmp_path / "short")
    found = make.archived("short")
    assert [(it["setting"], it["strategy"], it["seed"]) for it in found] == [
        (f"{cell}, 2 h", strategy, seed)
        for cell in ("few", "all")
        for strategy in ("greedy", "cautious")
        for seed in (1, 2)
    ]
    flown = {(row["setting"], row["strategy"], row["seed"]): row for row in rows}
    for row in found:
        mission = flown[int(row["setting"].startswith("all")), row["strategy"], row["seed"]]
        assert row["uptime_paper_mean"] == pytest.approx(mission["uptime_paper_mean"], abs=0.0005)
        assert row["metres"] == pytest.approx(mission["metres"], abs=0.05)


def test_an_archive_grows_by_a_directory_with_other_seeds_and_fewer_cells(
    make: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One seed of the second cell is flown in both directories, and stands once."""
    cells = {"few": {"fleet.count": 3}, "all": {}}
    study = {
        "name": "grown",
        "scenarios": [str(POOL_FILE)],
        "strategies": ["greedy", "cautious"],
        "parameters": {"duration_s": [300.0]},
    }
    whole = plan_of({**study, "cells": cells, "seeds": [1, 2, 3]}, "test", Path("/"))
    monkeypatch.setattr(make, "HERE", tmp_path)
    monkeypatch.setattr(make, "plan_named", lambda name: whole)
    kept = []
    for seeds, names in (([2, 3], ["few", "all"]), ([1, 2], ["all"])):
        directory, flown = tmp_path / f"from-{seeds[0]}", {name: cells[name] for name in names}
        fly_study(plan_of({**study, "cells": flown, "seeds": seeds}, "test", Path("/")), directory, 1)
        make.archive(directory)
        kept.append(make.archived("grown"))
    first, grown = kept
    assert [(it["setting"], it["strategy"], it["seed"]) for it in grown] == [
        (f"{name}, 2 h", strategy, seed)
        for name, seeds in (("few", (2, 3)), ("all", (1, 2, 3)))
        for strategy in ("greedy", "cautious")
        for seed in seeds
    ]
    assert [it for it in grown if it["seed"] != 1] == first


def judged(make: ModuleType, rule: dict[str, float], hours: int = 80) -> Any:
    """A cell on which Greedy has 50 % of uptime with a known end and 45 % without; the rule has so much more than 50."""
    figures = {make.UPTIME: 50.0, make.EQUAL_CHARGE: 30.0, make.LEAST: 20.0, make.METRES: 600.0}
    more = {"greedy, known end": {}, "greedy": {make.UPTIME: -5.0}, "from 0.3": rule}
    rows = {
        name: {
            seed: {
                key: value + more.get(name, {make.UPTIME: -9.0}).get(key, 0.0)
                for key, value in figures.items()
            }
        }
        for name in (*make.FIXED, "from 0.3")
        for seed in (3001,)
    }
    return make.Flown("fair", "a cell", hours, rows, None, 0, "from 0.3")


@pytest.mark.parametrize(
    ("uptime", "equal", "least", "metres", "hours", "missed"),
    [
        (5.0, 5.0, 0.0, 0.0, 80, []),
        (4.9, 5.0, 0.0, 0.0, 80, ["uptime"]),
        (4.9, 4.0, 0.0, 0.0, 240, []),
        (9.0, 3.9, 0.0, 0.0, 240, ["equal charge"]),
        (9.0, 9.0, -0.1, 0.1, 80, ["least", "metres"]),
    ],
)
def test_the_goal_is_judged_on_the_better_one_that_knows_the_end(
    make: ModuleType, uptime: float, equal: float, least: float, metres: float, hours: int, missed: list[str]
) -> None:
    more = {make.UPTIME: uptime, make.EQUAL_CHARGE: equal, make.LEAST: least, make.METRES: metres}
    cell = judged(make, more, hours)
    assert cell.better == "greedy, known end"
    assert make.misses(cell) == missed


def test_a_missed_cell_counts_where_its_bound_or_a_search_leaves_less_than_two_points(
    make: ModuleType,
) -> None:
    def found(*gains: float) -> dict[str, Any]:
        return {str(it): make.estimate_of([it], 0.95) for it in gains}

    assert make.verdict(9.0, [], {}) == "met"
    assert make.verdict(2.0, ["uptime"], {}) == "missed: uptime"
    assert make.verdict(1.9, ["uptime", "metres"], {}).startswith("met: the bound")
    assert make.verdict(2.5, ["uptime"], found(-3.0, 1.9)).startswith("met: a search of 2 rules")
    assert make.verdict(2.5, ["uptime"], found(1.9, 2.0)) == "missed: uptime"


def test_a_search_is_measured_from_the_chosen_rule_on_the_same_configurations(
    make: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown = {
        ("from 0.3", 1): 50.0,
        ("from 0.3", 2): 60.0,
        ("more", 1): 51.0,
        ("more", 2): 63.0,
        ("once", 2): 59.0,
        # Its trial chose it, so the judged configuration counts alone.
        ("kept", 1): 59.0,
        ("kept", 3001): 64.0,
        ("from 0.3", 3001): 60.0,
    }
    rows = [
        {"setting": "a cell, 80 h", "strategy": name, "seed": seed, make.UPTIME: uptime}
        for (name, seed), uptime in flown.items()
    ]
    monkeypatch.setattr(make, "archived", lambda name: rows if name == make.SEARCH else [])
    cell = judged(make, {})
    assert {name: it.mean for name, it in make.searched(cell).items()} == {
        "more": 2.0,
        "once": -1.0,
        "kept": 4.0,
    }
    assert make.searched(judged(make, {}, 240)) == {}
