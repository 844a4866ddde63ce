"""A finding's line, and checks that break."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from apad_bridge.doctor.finding import Finding, Status, cannot_tell, fail, ok, run_check


def test_a_line_holds_status_what_was_found_and_the_mend() -> None:
    assert fail("disk", "full\nup", "make room").line() == "FAIL disk: full up -> make room"
    assert ok("disk", "9 MB free").line() == "OK   disk: 9 MB free"
    assert cannot_tell("disk", "hidden", "look").line() == "CANNOT TELL disk: hidden -> look"


def test_trouble_without_a_mend_is_no_finding() -> None:
    with pytest.raises(ValueError, match="disk"):
        Finding("disk", Status.WARN, "full")
    with pytest.raises(ValueError, match="disk"):
        Finding("disk", Status.OK, "empty", "fill it")


def test_a_check_that_breaks_keeps_what_it_had_found() -> None:
    def breaks() -> Iterator[Finding]:
        yield ok("first", "fine")
        raise KeyError("second")

    first, broken = run_check("both", breaks)
    assert first == ok("first", "fine")
    assert (broken.check, broken.status) == ("both", Status.FAIL)
    assert "KeyError: 'second'" in broken.found
