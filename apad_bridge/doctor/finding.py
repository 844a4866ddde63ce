"""A check, and its result: one line for a person, with the mend in the same line."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from typing import Generic, TypeVar

from firmware_model.entry_points import in_one_line

Subject = TypeVar("Subject")


class CheckStatus(StrEnum):
    OK = "OK"
    WARN = "WARN"
    FAIL = "FAIL"
    CANNOT_TELL = "CANNOT TELL"
    """Nothing told what the check needs. It is no OK: a mission does not start on it, as on a FAIL."""


@dataclass(frozen=True, slots=True)
class Finding:
    """`check` names the subject of the check; `run_check` names what has no name. ValueError for trouble without a mend."""

    check: str
    status: CheckStatus
    found: str
    mend: str | None = None

    def __post_init__(self) -> None:
        if (self.mend is None) != (self.status is CheckStatus.OK):
            raise ValueError(f"{self.check}: trouble has a mend, and what is OK has none")

    def line(self) -> str:
        mend = "" if self.mend is None else f" -> {self.mend}"
        return " ".join(f"{self.status:<4} {self.check}: {self.found}{mend}".split("\n"))


def ok(found: str, *, check: str = "") -> Finding:
    return Finding(check, CheckStatus.OK, found)


def warn(found: str, mend: str, *, check: str = "") -> Finding:
    return Finding(check, CheckStatus.WARN, found, mend)


def fail(found: str, mend: str, *, check: str = "") -> Finding:
    return Finding(check, CheckStatus.FAIL, found, mend)


def cannot_tell(found: str, mend: str, *, check: str = "") -> Finding:
    return Finding(check, CheckStatus.CANNOT_TELL, found, mend)


@dataclass(frozen=True, slots=True)
class Check(Generic[Subject]):
    """One check of a table `CHECKS`: the function that examines its subject, and its weight before a real aPad moves.

    A module has the table of its checks, so that a new check is one entry beside its function. A finding has the check's
    name, or one of its own, after the aPad's for a check of one aPad.
    """

    name: str
    examine: Callable[[Subject], Finding | Iterable[Finding]]
    is_never_overridden: bool = False
    """A FAIL stops a run whatever a person says by `--despite`."""
    is_red_at_warning: bool = False
    """A WARN of the doctor is a FAIL before a mission."""
    may_be_red_in_trial: bool = False
    """The trial of a stop flies despite it: a few metres, with a person who watches."""

    @property
    def key(self) -> str:
        return key_of(self.name)


def key_of(check: str, apad: str = "") -> str:
    """The key of a check, for `--despite KEY` and `--accept KEY`: its name without the aPad's, in small letters.

    It is `versions` for the aPad's own line.
    """
    name = check.removeprefix(apad).strip() if apad else check
    return name.lower().replace(" ", "-") if name else "versions"


def red_keys(
    findings: Iterable[Finding], apads: Sequence[str], accepted: Container[str] = ()
) -> dict[str, list[Finding]]:
    """The findings that are red, by key: each FAIL, and each CANNOT TELL whose key no person `accepted`."""
    red: dict[str, list[Finding]] = {}
    for it in findings:
        key = key_among(it.check, apads)
        if it.status is CheckStatus.FAIL or (it.status is CheckStatus.CANNOT_TELL and key not in accepted):
            red.setdefault(key, []).append(it)
    return red


def key_among(check: str, apads: Sequence[str]) -> str:
    """The key of a check of any of these aPads, or of none."""
    apad = next((name for name in apads if check == name or check.startswith(f"{name} ")), "")
    return key_of(check, apad)


def run_checks(
    checks: Iterable[Check[Subject]], subject: Subject, apad: str = "", *, before_mission: bool = False
) -> Iterator[Finding]:
    """The findings of a table's checks, in its order; `apad` names the subject of checks of one aPad."""
    for check in checks:
        for finding in run_check(check.name, partial(check.examine, subject), apad):
            is_red = before_mission and check.is_red_at_warning and finding.status is CheckStatus.WARN
            yield replace(finding, status=CheckStatus.FAIL) if is_red else finding


def run_check(
    check: str, examine: Callable[[], Finding | Iterable[Finding]], apad: str = ""
) -> list[Finding]:
    """Returns the findings of `examine`, named. A check that breaks becomes a FAIL and does not stop other checks."""
    findings: list[Finding] = []
    try:
        found = examine()
        findings += [found] if isinstance(found, Finding) else found
    except Exception as error:
        reason = f"this check broke: {in_one_line(error)}"
        findings.append(fail(reason, "report this line to musselbed's authors; the other checks stand"))
    return [replace(it, check=f"{apad} {it.check or check}".strip()) for it in findings]
