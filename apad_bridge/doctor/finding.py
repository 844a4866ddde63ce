"""The result of a check: one line for a person, with the mend in the same line."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum


class Status(StrEnum):
    OK = "OK"
    WARN = "WARN"
    FAIL = "FAIL"
    CANNOT_TELL = "CANNOT TELL"
    """Nothing told what the check needs. It is no OK: for a mission it is red, like FAIL."""


@dataclass(frozen=True, slots=True)
class Finding:
    """`check` names the subject of the check. Raises ValueError for trouble without a mend."""

    check: str
    status: Status
    found: str
    mend: str | None = None

    def __post_init__(self) -> None:
        if (self.mend is None) != (self.status is Status.OK):
            raise ValueError(f"{self.check}: trouble has a mend, and what is OK has none")

    def line(self) -> str:
        mend = "" if self.mend is None else f" -> {self.mend}"
        return " ".join(f"{self.status:<4} {self.check}: {self.found}{mend}".split("\n"))


def ok(check: str, found: str) -> Finding:
    return Finding(check, Status.OK, found)


def warn(check: str, found: str, mend: str) -> Finding:
    return Finding(check, Status.WARN, found, mend)


def fail(check: str, found: str, mend: str) -> Finding:
    return Finding(check, Status.FAIL, found, mend)


def cannot_tell(check: str, found: str, mend: str) -> Finding:
    return Finding(check, Status.CANNOT_TELL, found, mend)


def run_check(check: str, examine: Callable[[], Iterable[Finding]]) -> list[Finding]:
    """Returns the findings of `examine`. A check that breaks becomes a FAIL and does not stop other checks."""
    findings: list[Finding] = []
    try:
        findings += examine()
    except Exception as error:
        reason = f"this check broke: {type(error).__name__}: {error}"
        findings.append(
            fail(check, reason, "report this line to musselbed's authors; the other checks stand")
        )
    return findings
