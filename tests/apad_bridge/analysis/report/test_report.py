"""The report of a run: its figures' data against the run's records, and its two files."""

from __future__ import annotations

import json
import re

import pytest

from apad_bridge.analysis.report import figures
from apad_bridge.analysis.report.contents import contents_of, troubles_in
from apad_bridge.commands.main import main


@pytest.fixture(scope="module")
def report(pool_run):
    return contents_of(pool_run)


def test_the_figures_show_the_run_s_data(report, pool_run):
    (line,) = figures.activity([report]).axes[0].lines
    summary = json.loads(pool_run.summary.read_text())
    # A sample every second tick; the summary's mean is over all.
    assert line.get_ydata()[1:].mean() == pytest.approx(summary["active_mean"], abs=0.05)
    texts = {it.get_text() for it in figures.places(report).axes[0].texts}
    assert texts == {str(n) for n in range(1, 13)}
    drawn = figures.energy(report).axes[0].patches
    assert sum(it.get_height() for it in drawn) == pytest.approx(
        100 * sum(sum(it.by_module.values()) for it in report.energy)
    )


def test_batteries_of_the_paper_s_worst_case_lie_on_the_model(report):
    """As they must: the run computes with it. Points of a sample every second, a line of one every minute."""
    discharging, charging = figures.batteries(report).axes
    for axes, slope in ((discharging, 1 / 959), (charging, 0.003)):
        model, *courses = axes.lines
        assert courses
        at, curve = model.get_xdata(), model.get_ydata()
        for course in courses:
            for minute, charge in zip(course.get_xdata(), course.get_ydata(), strict=True):
                below = min(int(minute), len(at) - 1)
                assert charge == pytest.approx(curve[below], abs=2 * slope)


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
    fault, given_up, left, silent = troubles_in(lines)
    assert fault.fault.text == "fault of aMussel 3: brown_out"
    assert [it.at_ms for it in fault.followed] == [3000]  # not 4's, and not later than ten minutes
    assert given_up.followed == () and left.followed == ()
    assert [it.text for it in silent.followed] == ["the mission ended: mission time"]


def test_the_page_and_the_pdf_have_all_parts(pool_run, whole_run, tmp_path, capsys):
    # Two runs of one name would share a folder.
    assert main(["report", str(pool_run.path), str(whole_run.path), "--out", str(tmp_path / "no")]) == 2
    assert "two runs are called run" in capsys.readouterr().err
    words = ["report", str(whole_run.path), "--out", str(tmp_path / "out"), "--data", "parquet", "--json"]
    assert main(words) == 0
    paths = json.loads(capsys.readouterr().out)
    page = (tmp_path / "out" / "report.html").read_text()
    assert re.findall(r"<h2>([^<]*)</h2>", page) == [
        "Runs",
        "run: energy by module",
        "run: energy by state",
        "run: charges believed, less true ones",
        "run: faults and what followed",
    ]
    assert page.count("data:image/png") == 5 and "http" not in page
    uptime = json.loads(whole_run.summary.read_text())["uptime_paper"]
    assert f"<td>{uptime['mean']:.2f}</td><td>{uptime['max']:.2f}</td><td>{uptime['min']:.2f}</td>" in page
    pdf = (tmp_path / "out" / "report.pdf").read_bytes()
    assert pdf.startswith(b"%PDF") and pdf.count(b"/Type /Page ") == 10
    assert (tmp_path / "out" / "run" / "truth.parquet").is_file() and paths["data"]
    assert main(["report", str(tmp_path), "--data", "none"]) == 2
    assert "no run: it has no journal.jsonl" in capsys.readouterr().err
