"""A run with a real aPad on a preflight that is red, and what the preflight before it had proven."""

from __future__ import annotations

import getpass
import re
from dataclasses import replace
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from apad_bridge.commands.hardware.preflight import verdict
from apad_bridge.commands.prepare import run_preflight
from apad_bridge.commands.prepare.run_preflight import (
    Report,
    accepted_by,
    every_check,
    never_overridden,
    now,
    proofs,
    refuse_red,
    report_path,
)
from apad_bridge.doctor.finding import CheckStatus, Finding, cannot_tell, fail, ok, red_keys
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.loader import load

MASTER = "http://boat:11311"
GREEN = Report("pool", MASTER, "2026-06-01T08:00:00+00:00", (ok("inside", check="/apad1 fence"),))


NOTHING_TOLD = cannot_tell("nobody says", "compare by hand", check="/apad1 origin")


def red(check: str) -> Report:
    return replace(GREEN, findings=(fail("it is not", "see to it", check=check),))


def test_green_starts_and_red_says_its_mend_and_how_a_person_decides_otherwise() -> None:
    assert refuse_red(GREEN, ["/apad1"], []) == []
    for accepted in ({}, {"watchdog": "Ana"}):  # a failure is not accepted
        with pytest.raises(
            UserError, match=r"--despite watchdog:\nFAIL /apad1 watchdog: it is not -> see to it"
        ):
            refuse_red(replace(red("/apad1 watchdog"), accepted=accepted), ["/apad1"], [])
    assert refuse_red(red("/apad1 watchdog"), ["/apad1"], ["watchdog", "delay"]) == ["watchdog"]


def test_the_table_names_each_key_that_no_person_overrides_or_that_a_trial_passes_over() -> None:
    assert never_overridden() == {"bench", "fence", "position", "pilot", "stop"}
    passed_over = {it.key for it in every_check() if it.may_be_red_in_trial}
    assert not passed_over & never_overridden()
    assert not passed_over & {"off", "origin", "reaction", "call-back", "messages", "action-server"}
    assert [it.key for it in every_check() if it.is_red_at_warning] == ["docks"]


@pytest.mark.parametrize("key", ["bench", "fence", "position", "pilot", "stop"])
def test_bench_fence_position_pilot_and_stop_are_never_overridden(key: str) -> None:
    with pytest.raises(UserError, match="never overridden"):
        refuse_red(GREEN, ["/apad1"], [key])
    with pytest.raises(UserError) as refused:
        refuse_red(red(f"/apad1 {key}"), ["/apad1"], ["delay"])
    assert "--despite" not in str(refused.value)


def test_a_check_that_cannot_tell_is_red_until_a_person_accepts_it_by_name() -> None:
    doubtful = replace(GREEN, findings=(NOTHING_TOLD,))
    for despite in ([], ["origin"]):
        with pytest.raises(UserError, match=r"--accept origin:\nCANNOT TELL /apad1 origin: nobody says"):
            refuse_red(doubtful, ["/apad1"], despite)
    accepted = accepted_by(["origin:Ana", "watchdog:Ivo"], doubtful.findings, ["/apad1"])
    assert accepted == {"origin": "Ana"}
    assert refuse_red(replace(doubtful, accepted=accepted), ["/apad1"], []) == []
    assert accepted_by(["origin"], doubtful.findings, ["/apad1"])["origin"] == getpass.getuser()


@pytest.mark.parametrize(
    ("findings", "lines"),
    [
        ([NOTHING_TOLD], [r"CANNOT TELL: origin: (?!.*RED).*--accept.*"]),
        (
            [NOTHING_TOLD, fail("it is not", "see to it", check="/apad1 watchdog")],
            ["RED: watchdog", "CANNOT TELL: origin: .*"],
        ),
        ([ok("inside", check="/apad1 fence")], ["GREEN"]),
    ],
)
def test_what_nothing_told_is_not_called_red_and_says_how_a_person_accepts_it(
    findings: list[Finding], lines: list[str]
) -> None:
    told = verdict(replace(GREEN, findings=findings), red_keys(findings, ["/apad1"]))
    shown = [re.sub(r"\[.*?\]", "", it) for it in told]
    assert len(shown) == len(lines) and all(map(re.fullmatch, lines, shown)), shown


@pytest.mark.parametrize("text", ["", "{}", '{"findings": 3}', "[1]"])
def test_a_report_that_cannot_be_read_is_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "report.json").write_text(text)
    assert Report.load(tmp_path / "report.json") is None
    known = replace(GREEN, accepted={"origin": "Ana"})
    known.save(tmp_path / "report.json")
    assert Report.load(tmp_path / "report.json") == known


@pytest.mark.parametrize(
    ("change", "counts"),
    [({}, True), ({"master": "http://other:11311"}, False), ({"at": "2020-01-01T00:00:00+00:00"}, False)],
)
def test_a_proof_counts_for_a_day_on_its_master(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, str], counts: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    pool = load(POOL_FILE)
    failed = Finding("/apad1 stop", CheckStatus.FAIL, "it went on", "see to it")
    report = replace(GREEN, at=now(), findings=(failed,))
    path = report_path(pool)
    path.parent.mkdir()
    replace(report, **change).save(path)
    stop, docks = proofs(pool, MASTER, ["/apad1"])
    assert (stop == failed) is counts
    assert docks.status is CheckStatus.WARN and "--prove-docks" in str(docks.mend)
    assert run_preflight.PROOFS.keys() == {"stop", "docks opened"}
