"""A number that an estimator believes, and no packet states, is a row of one table: all products of a run have it then."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from journals import lines_in
from scenario_files import POOL_FILE

from apad_bridge.analysis.export.tables import tables_of
from apad_bridge.analysis.replay.series import whole_view
from apad_bridge.beliefs.belief import NUMBERS, BelievedNumber
from apad_bridge.commands.main import main
from apad_bridge.records.journal import read_journal
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import load, write_with_files
from firmware_model.packets import ShownQuantity


def test_a_row_of_the_table_reaches_bag_journal_and_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mission second of the newest packet, which bag and journal have by other ways too; aMussel 1 leaves it out."""
    of = BelievedNumber(
        ShownQuantity("newest packet", "s", 10.0), lambda it: None if it.agent_id == 1 else it.heard_ms / 1000
    )
    monkeypatch.setitem(NUMBERS, "heard_s", of)
    pool = load(POOL_FILE)
    short = replace(pool, duration_s=60.0, fleet=replace(pool.fleet, hosting=Hosting.ONE_PROCESS))
    write_with_files(tmp_path / "short.yaml", short)
    assert main(["run", str(tmp_path / "short.yaml"), "--time", "asap", "--out", str(tmp_path / "run")]) == 0
    run = RunDirectory(tmp_path / "run")

    rows = next(it.columns for it in tables_of(run) if it.name == "beliefs")
    told = zip(rows["id"], rows["heard_s"], rows["mission_time_ms"], rows["age_s"], strict=True)
    by_age = [(agent_id, heard_s, now_ms / 1000 - age_s) for agent_id, heard_s, now_ms, age_s in told]
    assert len(by_age) > 500 and all(
        heard_s != heard_s if agent_id == 1 else heard_s == pytest.approx(expected_s, abs=1e-3)
        for agent_id, heard_s, expected_s in by_age
    )

    lines = [it for it in lines_in(run.journal) if it["kind"] == "belief"]
    assert {it["id"] for it in lines} == set(range(1, 13))
    for it in lines:
        assert it["reported"].get("heard_s") == (None if it["id"] == 1 else it["heard"] / 1000)
    times_s = [it["heard"] // 1000 for it in lines if it["id"] == 2]
    assert times_s[1] - times_s[0] == 10, "a line once it changed by its step"

    data = whole_view(load(run.scenario), read_journal(run.journal)).data(None)
    n = data["quantities"].index(["heard_s", "newest packet", "s"])
    first, second = (data["agents"][k]["reported"][-1][n] for k in (0, 1))
    assert first is None and second == times_s[-1]
