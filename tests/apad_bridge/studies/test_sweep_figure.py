"""A study over one parameter: differences by hand, the figure's size, the tables, and what is refused before a flight."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Any

import pytest
from scenario_files import POOL_FILE

from apad_bridge.commands.main import main
from apad_bridge.studies.findings import Findings
from apad_bridge.studies.mission_figures import COLUMNS
from apad_bridge.studies.specification import StudyPlan, plan_of
from apad_bridge.studies.sweep_figure import Sweep, as_table, sweep_of, write_figure

STUDY: dict[str, Any] = {
    "name": "swept",
    "scenarios": [str(POOL_FILE)],
    "strategies": ["cautious"],
    "seeds": 3,
    "primary": "uptime_paper_mean",
    "parameters": {"mission.pool_threshold": [0.5, 0.65, 0.8], "duration_s": [300.0]},
}
UPTIMES = {0.5: (70.0, 72.0, 74.0), 0.65: (71.0, 74.0, 77.0), 0.8: (70.0, 72.0, 74.5)}


def plan(**changes: Any) -> StudyPlan:
    return plan_of({**STUDY, **changes}, "test", Path("/"))


def rows_of(plan: StudyPlan) -> list[dict[str, Any]]:
    figures = dict.fromkeys(COLUMNS, 1.0)
    return [
        {"setting": setting, "strategy": name, "seed": seed, **figures, "uptime_paper_mean": uptime}
        for setting, it in enumerate(plan.settings)
        for seed, uptime in enumerate(UPTIMES[dict(it.parameters)["mission.pool_threshold"]], start=1)
        for name in plan.strategies
    ]


def swept(**changes: Any) -> Sweep:
    its = plan(**changes)
    found = sweep_of(its, rows_of(its))
    assert found is not None
    return found


def test_differences_are_paired_with_the_first_value_and_adjusted_over_the_values() -> None:
    """0.65: +1, +2, +3, so 2 with t = 2 sqrt(3) = 3.464 and p 0.0742. 0.8: 0, 0, 0.5, so t = 1 and p 0.4226. Holm: 2 p."""
    first, second, third = swept().points
    assert first.difference is None and second.difference is not None and third.difference is not None
    assert second.difference.estimate.mean == pytest.approx(2.0)
    half = 4.3027 / 3**0.5  # Student's t for 95 % and two degrees of freedom
    assert (second.difference.estimate.low, second.difference.estimate.high) == pytest.approx(
        (2 - half, 2 + half), abs=1e-3
    )
    assert second.difference.p == pytest.approx(2 * 0.0742, abs=1e-3)
    assert third.difference.p == pytest.approx(0.4226, abs=1e-3)


@pytest.mark.parametrize(
    "changes",
    [
        {"parameters": {"mission.pool_threshold": [0.5]}},
        {"parameters": {"mission.pool_threshold": [0.5, 0.8], "mission.batch": [1, 4]}},
        {"parameters": {"theta": [10, 30]}},
    ],
)
def test_a_study_that_varies_no_one_key_has_none(changes: dict[str, Any]) -> None:
    assert sweep_of(plan(**changes), []) is None


def test_a_figure_has_its_width_and_one_axis(tmp_path: Path) -> None:
    for name, width in (("a.svg", rb'width="([\d.]+)pt"'), ("a.pdf", rb"/MediaBox \[ ?0 0 ([\d.]+) ")):
        write_figure(swept(), tmp_path / name, 84.0)
        found = re.search(width, (tmp_path / name).read_bytes())
        assert found and float(found[1]) == pytest.approx(84 / 25.4 * 72, abs=0.01)
    assert len(re.findall(r'id="axes_\d+"', (tmp_path / "a.svg").read_text())) == 1


def test_the_tables_are_whole() -> None:
    latex = as_table(swept(), "latex").splitlines()
    assert latex[0] == r"\begin{tabular}{lrr}" and latex[-1] == r"\end{tabular}"
    assert latex[2] == r"mission.pool\_threshold & uptime \% & minus 0.5 \\"
    assert latex[5].startswith(r"0.65 & 74.00 $\pm$ 7.45 & +2.00 $\pm$ 2.48 (p 0.14")
    found = list(csv.DictReader(io.StringIO(as_table(swept(strategies=["cautious", "greedy"]), "csv"))))
    assert [(it["strategy"], it["mission.pool_threshold"], it["mean"]) for it in found[:2]] == [
        ("cautious", "0.5", "72.0"),
        ("cautious", "0.65", "74.0"),
    ]
    assert len(found) == 6 and found[3]["difference_mean"] == ""


def test_the_page_begins_with_the_figure(tmp_path: Path) -> None:
    its = plan()
    Findings(its, rows_of(its)).write_figures(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert 0 < page.index("class=sweep") < page.index("<h2>")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--figure", "a.png"], "--figure a.png: must end in .pdf or .svg"),
        (["--figure", "none/a.pdf"], "--figure none/a.pdf: there is no such directory"),
        (["--width-mm", "84"], "--width-mm is of a figure: name its file by --figure"),
        (["--figure", "a.pdf", "--width-mm", "8"], "--width-mm 8: must be from 30 to 400"),
        (["--table", "csv", "--json"], "--table and --json both print on stdout: leave one out"),
        (["--table", "csv"], "--figure and --table show a study over one parameter"),
    ],
)
def test_an_output_that_cannot_be_is_refused_before_the_flight(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = tmp_path / "s.yaml"
    study.write_text(f"name: s\nscenarios: [{POOL_FILE}]\nstrategies: [cautious]\nseeds: 2\n")
    assert main(["study", str(study), "--out", str(tmp_path / "out"), *words]) == 2
    assert message in capsys.readouterr().err and not (tmp_path / "out").exists()
