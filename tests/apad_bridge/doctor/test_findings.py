"""A finding's line, and checks that break."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from apad_bridge.doctor.finding import (
    Check,
    CheckStatus,
    Finding,
    cannot_tell,
    fail,
    ok,
    red_keys,
    run_check,
    run_checks,
    warn,
)


@pytest.mark.parametrize(
    ("finding", "line"),
    [
        (fail("full\nup", "make room", check="disk"), "FAIL disk: full up -> make room"),
        (ok("9 MB free", check="disk"), "OK   disk: 9 MB free"),
        (cannot_tell("hidden", "look", check="disk"), "CANNOT TELL disk: hidden -> look"),
    ],
)
def test_a_line_holds_status_what_was_found_and_the_mend(finding: Finding, line: str) -> None:
    assert finding.line() == line


@pytest.mark.parametrize("finding", [(CheckStatus.WARN, "full"), (CheckStatus.OK, "empty", "fill it")])
def test_trouble_without_a_mend_is_no_finding_nor_a_mend_without_trouble(finding: tuple[Any, ...]) -> None:
    with pytest.raises(ValueError, match="disk"):
        Finding("disk", *finding)


def test_a_check_that_breaks_keeps_what_it_had_found() -> None:
    def breaks() -> Iterator[Finding]:
        yield ok("fine", check="first")
        raise KeyError("second")

    first, broken = run_check("both", breaks)
    assert first == ok("fine", check="first")
    assert (broken.check, broken.status) == ("both", CheckStatus.FAIL)
    assert "KeyError: 'second'" in broken.found


def test_a_table_is_checked_in_its_order_and_a_broken_entry_stops_no_other() -> None:
    table = (
        Check("ports", lambda ports: fail(f"{1 // ports}", "more")),
        Check("disk", lambda _: [ok("room"), ok("writable", check="rights")]),
    )
    findings = list(run_checks(table, 0, "/apad1"))
    assert [(it.check, it.status) for it in findings] == [
        ("/apad1 ports", CheckStatus.FAIL),
        ("/apad1 disk", CheckStatus.OK),
        ("/apad1 rights", CheckStatus.OK),
    ]
    assert "ZeroDivisionError" in findings[0].found


@pytest.mark.parametrize(
    ("is_red_at_warning", "before_mission", "wanted"),
    [(True, True, CheckStatus.FAIL), (True, False, CheckStatus.WARN), (False, True, CheckStatus.WARN)],
)
def test_a_warning_is_red_before_a_mission_where_its_entry_says_so(
    is_red_at_warning: bool, before_mission: bool, wanted: CheckStatus
) -> None:
    table = (
        Check(
            "docks",
            lambda it: [ok(it), warn(it, "empty them")],
            is_red_at_warning=is_red_at_warning,
        ),
    )
    fine, doubt = run_checks(table, "held", before_mission=before_mission)
    assert (fine.status, doubt.status, doubt.mend) == (CheckStatus.OK, wanted, "empty them")


def test_red_findings_are_named_without_their_apad() -> None:
    found = [
        fail("found", "mend", check=it)
        for it in ("/apad1 action server", "/apad1", "own address", "/apad2 fence")
    ]
    assert list(red_keys([*found, ok("room", check="disk")], ["/apad1", "/apad2"])) == [
        "action-server",
        "versions",
        "own-address",
        "fence",
    ]
