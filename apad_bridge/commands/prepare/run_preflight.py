"""The checks before a real aPad moves, for `musselbed preflight` and for each run with one; and what a preflight proved."""

from __future__ import annotations

import getpass
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from apad_bridge.assembly.division import members
from apad_bridge.commands.prepare.doctor import check_ros
from apad_bridge.doctor import graph_checks, machine
from apad_bridge.doctor.finding import Check, CheckStatus, Finding, key_among, red_keys, run_checks
from apad_bridge.doctor.preflight_checks import not_proven
from apad_bridge.records.run_directory import RUNS
from apad_bridge.ros.system.route import environment_for
from apad_bridge.ros_names.names import in_full, is_one_of_several, plain
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.run_options import BenchPart, RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts_table import Start
from apad_bridge.scenario.text.text_file import write_atomically

PROVEN_FOR = timedelta(hours=24)
"""A proof of a former preflight counts for so long."""
PROOFS = {"stop": "--prove-stop", "docks opened": "--prove-docks"}
"""Proofs that a preflight makes by orders, and the option that asks for each."""


@dataclass(frozen=True, slots=True)
class Report:
    """A preflight's findings, as a file holds them."""

    scenario: str
    master: str
    at: str
    """UTC, ISO 8601."""
    findings: tuple[Finding, ...]
    accepted: dict[str, str] = field(default_factory=dict)
    """The checks that cannot tell, by key, and the person who accepts each."""

    def save(self, path: Path) -> None:
        write_atomically(path, json.dumps(asdict(self), indent=1) + "\n")

    @classmethod
    def load(cls, path: Path) -> Report | None:
        """None for a file that is not there, or of another version."""
        try:
            data = json.loads(path.read_text())
            findings = [Finding(**{**it, "status": CheckStatus(it["status"])}) for it in data["findings"]]
            return cls(data["scenario"], data["master"], data["at"], tuple(findings), dict(data["accepted"]))
        except (OSError, ValueError, KeyError, TypeError):
            return None


def names_in_full(scenario: Scenario, namespace: str) -> list[str]:
    return [in_full(namespace, it) for it in scenario.apad_names]


def recording_commands(scenario: Scenario, namespace: str) -> list[str]:
    """For each aPad, what records its topics and the mission on the vehicle's own computer, by its own rosbag.

    It leaves the aMussels' topics, ten messages a second each, on this side of the Wi-Fi.
    """
    commands = []
    for name in scenario.apad_names:
        apad, bench = in_full(namespace, name), in_full(namespace, "musselbed")
        if is_one_of_several(scenario):
            bench = f"{bench}/{plain(name)}"
        topics = f"{apad}/.*|{bench}/(apad|beliefs|heartbeat|mission)"
        commands.append(f"rosbag record -O {plain(name)}.bag -e '{topics}'")
    return commands


def findings_of(scenario: Scenario, starts: Sequence[Start], options: RunOptions) -> Iterator[Finding]:
    """The doctor's checks as a mission sees them, then those of each aPad. They need no order, and give none."""
    agents = 0 if options.part is BenchPart.MISSION else scenario.fleet.count
    mapping = dict(_remapping(it, options.namespace) for it in options.remappings)
    with called_back_at(options.master_uri, options.namespace):
        yield from run_checks(machine.CHECKS, agents)
        for finding in check_ros(options.master_uri, scenario, mapping, members(scenario, starts)):
            if options.part is BenchPart.MISSION and finding.check == "aMussel ids":
                continue  # they are there already, as they should be
            yield finding


def every_check() -> tuple[Check[Any], ...]:
    """All checks that `findings_of` makes."""
    from apad_bridge.doctor import apad_checks, preflight_checks
    from apad_bridge.ros import doctor_checks

    before: tuple[Check[Any], ...] = (*machine.CHECKS, *doctor_checks.CHECKS, *graph_checks.CHECKS)
    of_apads: tuple[Check[Any], ...] = (*apad_checks.CHECKS, *preflight_checks.CHECKS)
    return (*before, *preflight_checks.CHECKS_OF_WAY, *of_apads)


def never_overridden() -> frozenset[str]:
    """The keys of checks whose red stops a run, whatever a person says."""
    return frozenset({"stop", *(it.key for it in every_check() if it.is_never_overridden)})


@contextmanager
def called_back_at(master_uri: str, namespace: str) -> Iterator[None]:
    """The shell's variables as a run's own node has them: its address on the way to the master."""
    before = dict(os.environ)
    os.environ.update(environment_for(master_uri, namespace))
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def report_path(scenario: Scenario) -> Path:
    return RUNS / f"preflight-{scenario.name}.json"


def proofs(scenario: Scenario, master_uri: str, apads: Sequence[str]) -> list[Finding]:
    """Proofs of the scenario's last preflight on this master; a line for each missing one."""
    report = Report.load(report_path(scenario))
    if report is not None and (report.master != master_uri or _age(report.at) > PROVEN_FOR):
        report = None
    known = {} if report is None else {it.check: it for it in report.findings}
    return [
        known.get(f"{apad} {what}") or not_proven(apad, what, option)
        for apad in apads
        for what, option in PROOFS.items()
    ]


def accepted_by(given: Iterable[str], findings: Iterable[Finding], apads: Sequence[str]) -> dict[str, str]:
    """Person by key, for each `given` CHECK or CHECK:PERSON that a finding needs; without a person the login's name."""
    doubted = {key_among(it.check, apads) for it in findings if it.status is CheckStatus.CANNOT_TELL}
    people = {key: person for key, _, person in (it.partition(":") for it in given)}
    return {key: person or getpass.getuser() for key, person in people.items() if key in doubted}


def refuse_red(report: Report, apads: Sequence[str], despite: Sequence[str]) -> list[str]:
    """The keys that are red and overridden. UserError for any other, with each finding's mend."""
    fixed = never_overridden()
    if never := sorted(fixed.intersection(despite)):
        raise UserError(f"--despite {never[0]}: this is never overridden: mend it")
    red = red_keys(report.findings, apads, report.accepted)
    failed = red_keys((it for it in report.findings if it.status is CheckStatus.FAIL), apads)
    refused = [
        it
        for key, its in red.items()
        for it in its
        if key not in despite or it.status is CheckStatus.CANNOT_TELL
    ]
    if refused:
        words = [f"--despite {key}" for key in failed if key not in despite and key not in fixed]
        words += [f"--accept {key}" for key in red if key not in failed or key in despite]
        mend = f"; a person may decide otherwise by {' '.join(words)}" if words else ""
        lines = "\n".join(it.line() for it in refused)
        raise UserError(f"a real aPad does not start on red, nor where a check cannot tell{mend}:\n{lines}")
    return sorted(set(failed).intersection(despite))


def now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _age(at: str) -> timedelta:
    try:
        return datetime.now(UTC) - datetime.fromisoformat(at)
    except (ValueError, TypeError):
        return timedelta.max


def _remapping(remapping: str, namespace: str) -> tuple[str, str]:
    old, new = remapping.split(":=")
    return in_full(namespace, old), in_full(namespace, new)
