"""A campaign's tries are kept as they come, and the campaign goes on where it was ended."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from rich.console import Console
from tries import RESULTS, Job, Kept, NoFlight, Result, fly_all, in_cells, in_turns, show

CHOSEN = in_turns([("nan", "a", 2), ("nan", "b", 1), ("pilot", "b", 2)])


def told(result: Result) -> str:
    return f"stop {result['stop_s']:g} s"


def test_the_first_tries_of_all_rows_come_first() -> None:
    assert [it.name for it in CHOSEN] == ["nan-a-0", "nan-b-0", "pilot-b-0", "nan-a-1", "pilot-b-1"]


def test_a_campaign_flies_each_try_once_and_goes_on(tmp_path: Path) -> None:
    flown: list[str] = []

    def fly(job: Job, attempt: int) -> dict[str, Any]:
        flown.append(job.name)
        if job.row == "pilot" and attempt < 2:
            raise NoFlight("not yet")
        return {"failures": [], "stop_s": 1.0}

    fly_all(CHOSEN[:3], Kept(tmp_path), 2, fly, told)
    assert len(flown) == 5  # the pilot's flight began at the third attempt
    with (tmp_path / RESULTS).open("a") as out:
        out.write('{"row": "nan", "gener')  # killed within a line
    flown.clear()
    kept = Kept(tmp_path)
    fly_all(CHOSEN, kept, 2, fly, told)
    assert set(flown) == {"nan-a-1", "pilot-b-1"} and len(kept.results) == 5
    assert len(Kept(tmp_path).results) == 5
    cells = in_cells(CHOSEN[1:], kept)
    assert {cell: [it["try"] for it in results] for cell, results in cells.items()} == {
        ("nan", "b"): [0],
        ("pilot", "b"): [0, 1],
        ("nan", "a"): [1],
    }


def test_a_flight_that_never_begins_is_an_error_and_is_flown_again(tmp_path: Path) -> None:
    def fly(job: Job, attempt: int) -> dict[str, Any]:
        raise NoFlight("no vehicle")

    fly_all(CHOSEN[:1], Kept(tmp_path), 1, fly, told)
    assert "no vehicle" in (tmp_path / RESULTS).read_text()
    assert not Kept(tmp_path).is_there(CHOSEN[0])


def test_a_table_has_a_line_for_each_row_and_its_lists_stand_below() -> None:
    out = io.StringIO()
    cell = {"row": "nan", "generation": "a", "good": 1, "stop_s": None, "failures": ["it went on", "late"]}
    show({"rows": [cell], "not_tried": {"pilot": "no channel"}}, Console(file=out, width=80))
    said = out.getvalue()
    assert [it.split() for it in said.splitlines() if "nan" in it] == [
        ["│", "nan", "│", "a", "│", "1", "│", "-", "│"],
        ["nan,", "a:", "failures:", "it", "went", "on"],
        ["nan,", "a:", "failures:", "late"],
    ]
    assert "not tried: pilot: no channel" in said


def test_a_table_has_the_columns_of_all_its_rows() -> None:
    out = io.StringIO()
    show(
        {"suspects": [{"case": "untold", "suspects": 2}, {"case": "liar", "covered": 0.5}]},
        Console(file=out, width=80),
    )
    lines = [
        it.replace("│", " ").split() for it in out.getvalue().splitlines() if "untold" in it or "liar" in it
    ]
    assert lines == [["untold", "2", "-"], ["liar", "-", "0.5"]]
