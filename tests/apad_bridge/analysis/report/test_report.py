"""The report of a run: its figures' data against the run's records, and its two files."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import pytest
from journals import journal_of, lines_in
from matplotlib.backends.backend_agg import FigureCanvasAgg

from apad_bridge.analysis.report import document, report_figures
from apad_bridge.analysis.report.contents import contents_of, troubles_in
from apad_bridge.commands.main import main
from apad_bridge.records.run_directory import RunDirectory


@pytest.fixture(scope="module")
def report(pool_run):
    return contents_of(pool_run)


def test_the_figures_show_the_run_s_data(report, pool_run):
    (line,) = report_figures.activity([report]).axes[0].lines
    summary = json.loads(pool_run.summary.read_text())
    # A sample every second tick; the summary's mean is over all.
    assert line.get_ydata()[1:].mean() == pytest.approx(summary["active_mean"], abs=0.05)
    texts = {it.get_text() for it in report_figures.places(report).axes[0].texts}
    assert texts == {str(n) for n in range(1, 13)}
    drawn = report_figures.energy(report).axes[0].patches
    assert sum(it.get_height() for it in drawn) == pytest.approx(
        100 * sum(sum(it.by_module.values()) for it in report.energy)
    )


def test_the_times_in_which_the_aPad_was_stopped_are_shaded(pool_run, tmp_path):
    """A person stops it after a minute, takes it over meanwhile, and gives it back two minutes later."""
    stopped = [
        {"t": 60_000, "kind": "operator", "order": "stop", "by": "Anna"},
        {"t": 90_000, "kind": "override", "taken": True, "by": "person"},
        {"t": 180_000, "kind": "override", "taken": False, "by": "person"},
    ]
    run = with_lines(pool_run, tmp_path / "stopped", stopped)
    (shade,) = report_figures.activity([contents_of(run)]).axes[0].patches
    assert (shade.get_x(), shade.get_width()) == (1, 2)  # minutes
    assert shade.get_window_extent().height == pytest.approx(shade.axes.bbox.height)
    assert list(report_figures.activity([contents_of(pool_run)]).axes[0].patches) == []


def with_lines(run, path, lines):
    """A copy of the run whose journal has these lines, too, each at its time."""
    shutil.copytree(run.path, path)
    told = sorted([*lines_in(run.journal), *lines], key=lambda line: line["t"])
    (path / "journal.jsonl").write_text("".join(json.dumps(it) + "\n" for it in told))
    return RunDirectory(path)


@pytest.mark.parametrize("count", [14, 1], ids=["all of them", "the one load of the paper's worst case"])
def test_the_legend_of_all_modules_is_whole_with_a_colour_for_each(report, count):
    names = [f"module {n}" for n in range(count)]
    drawn = [replace(it, by_module=dict.fromkeys(names, 0.01)) for it in report.energy]
    figure = report_figures.energy(replace(report, energy=drawn))
    FigureCanvasAgg(figure).draw()
    part = figure.subfigs[0]
    (legend,) = part.legends
    box, page = legend.get_window_extent(), part.bbox
    assert page.y0 <= box.y0 and page.x0 <= box.x0 and box.x1 <= page.x1
    assert box.y1 <= part.axes[0].get_tightbbox().y0
    assert [it.get_text() for it in legend.get_texts()] == names
    assert len({it.get_facecolor() for it in legend.get_patches()}) == count


def test_of_two_lines_at_the_same_height_the_lower_one_shows_below_the_upper(report):
    below, above = report_figures.activity([report, replace(report, name="again")]).axes[0].lines
    assert below.get_zorder() <= above.get_zorder()  # in the order in which they were drawn
    assert below.get_linewidth() >= above.get_linewidth() + 0.5


def test_a_bias_that_rounds_to_zero_has_no_minus(report, tmp_path):
    nearly = replace(
        report, scores=replace(report.scores, overall=replace(report.scores.overall, bias=-1e-5))
    )
    page = document.write_report([nearly], tmp_path).read_text()
    assert "<td>+0.0000</td>" in page and "-0.0000" not in page


def test_batteries_of_the_paper_s_worst_case_lie_on_the_model(report):
    """As they must: the run computes with it. Points of a sample every second, a line of one every minute."""
    discharging, charging = report_figures.batteries(report).axes
    for axes, slope in ((discharging, 1 / 959), (charging, 0.003)):
        model, *courses = axes.lines
        assert courses
        at, curve = model.get_xdata(), model.get_ydata()
        for course in courses:
            for minute, charge in zip(course.get_xdata(), course.get_ydata(), strict=True):
                assert charge == pytest.approx(curve[min(int(minute), len(at) - 1)], abs=2 * slope)


def test_a_fault_is_told_with_what_followed_for_its_amussel():
    lines = [
        {"t": 1000, "kind": "fault", "id": 3, "fault": "brown_out"},
        {"t": 2000, "kind": "dock", "agent": 4, "dock": 0, "closed": True},
        {"t": 3000, "kind": "given_up", "agent": 3, "what": "collect", "reason": "silent"},
        {"t": 4000, "kind": "primitive", "name": "go to point", "phase": "failed", "reason": "pre-empted"},
        {"t": 700_000, "kind": "left_alone", "agent": 3, "tries": 3, "reason": "silent"},
        {"t": 701_000, "kind": "vehicle_silent", "name": "apad1", "since_ms": 700_000},
        {"t": 702_000, "kind": "end", "reason": "mission time"},
    ]
    fault, given_up, left, silent = troubles_in(journal_of(lines).entries)
    assert fault.fault.text == "fault of aMussel 3: brown_out"
    assert [it.at_ms for it in fault.followed] == [3000]  # not 4's, and not later than ten minutes
    assert given_up.followed == () and left.followed == ()
    assert [it.text for it in silent.followed] == ["the mission ended: mission time"]


def test_the_page_has_all_parts_the_table_first(pool_run, whole_run, tmp_path, capsys):
    # Two runs of one name would share a folder.
    assert main(["report", str(pool_run.path), str(whole_run.path), "--out", str(tmp_path / "no")]) == 2
    assert "two runs are called run" in capsys.readouterr().err
    words = ["report", str(whole_run.path), "--out", str(tmp_path / "out"), "--data", "parquet", "--json"]
    assert main(words) == 0
    paths = json.loads(capsys.readouterr().out)
    page = (tmp_path / "out" / "report.html").read_text()
    assert re.findall(r"<h[23]>([^<]*)</h[23]>", page) == [
        "The runs",
        "Figures",
        "run",
        "Energy by module",
        "Energy by state",
        "Believed charge minus true charge",
        "Faults and what followed",
    ]
    assert page.index("<table") < page.index("<img") and "http" not in page
    captions = re.findall(r"<figcaption>Figure (\d+)\. ", page)
    # Of beliefs that are perfect there is no figure.
    assert captions == [str(n + 1) for n in range(page.count("data:image/svg+xml"))] and len(captions) == 4
    # The scenario, the day, and the software that flew.
    versions = json.loads(whole_run.versions.read_text())
    assert f"musselbed {versions['musselbed']}" in page and "flown on 20" in page
    assert versions["commit"] is None or f"commit {versions['commit']}" in page
    uptime = json.loads(whole_run.summary.read_text())["uptime_paper"]
    for name, key in (("average", "mean"), ("greatest", "max"), ("least", "min")):
        assert f"<td>uptime, {name} %</td><td>{uptime[key]:.2f}</td>" in page
    assert (tmp_path / "out" / "run" / "truth.parquet").is_file() and paths["data"]


def test_no_figure_is_empty(report):
    """A run that ended at once has no course of a battery; one of a worst case has no error of its beliefs to draw."""
    data = report.data | {
        "agents": [it | {"charge": [None] * len(it["charge"])} for it in report.data["agents"]]
    }
    assert report_figures.batteries(replace(report, data=data)) is None
    falling = [it | {"charge": [1 - 0.001 * n for n in range(len(it["charge"]))]} for it in data["agents"]]
    (axes,) = report_figures.batteries(replace(report, data=data | {"agents": falling})).axes
    assert axes.get_title() == "discharging"
