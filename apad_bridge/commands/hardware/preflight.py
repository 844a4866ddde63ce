"""`musselbed preflight`: whether a real aPad may fly this scenario now, on one page: green, or the mend."""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from agents.hosting.started import PYTHON
from apad_bridge.commands.fly import run as run_command
from apad_bridge.commands.fly.flight import read_scenario
from apad_bridge.commands.help_text import ending
from apad_bridge.commands.prepare.run_preflight import (
    PROOFS,
    Report,
    accepted_by,
    called_back_at,
    every_check,
    findings_of,
    names_in_full,
    never_overridden,
    now,
    proofs,
    recording_commands,
    report_path,
)
from apad_bridge.commands.trust import add_trust_argument, trust_of_looked_at
from apad_bridge.doctor.finding import CheckStatus, Finding, fail, key_among, ok, red_keys, run_check
from apad_bridge.doctor.preflight_checks import check_lookout, check_stop
from apad_bridge.events.person_events import ScriptReported
from apad_bridge.records.journal import read_journal
from apad_bridge.records.run_directory import PRIVATE, RunDirectory
from apad_bridge.ros.system.route import somebodys_master
from apad_bridge.runs.exits import Exit, require_yes
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import Console
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.flight_readiness import problems_with_real_vehicle
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting import PROVE_STOP, STOP_PROVEN

_PROOF_S = 300
_STYLES = {
    CheckStatus.OK: "green",
    CheckStatus.WARN: "yellow",
    CheckStatus.FAIL: "bold red",
    CheckStatus.CANNOT_TELL: "bold magenta",
}


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "preflight",
        description="Checks the network both ways, the aPad on the master at ROS_MASTER_URI, and the scenario for it "
        "to fly, and prints one page: green, or what to do. Nothing moves unless --prove-stop or --prove-docks asks for "
        "it. `musselbed run` makes the same checks before a real aPad moves, and refuses to start on red.",
        epilog=ending(
            "musselbed preflight launch_scripts/scenarios/real-apad.yaml --lookout Ana",
            "musselbed preflight launch_scripts/scenarios/real-apad.yaml --lookout Ana --prove-stop --prove-docks",
            note="The exit code is 3 when a check is red, or cannot tell.",
        ),
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO.yaml")
    parser.add_argument(
        "--no-fleet",
        dest="part",
        action="store_const",
        const=BenchPart.MISSION,
        default=BenchPart.WHOLE,
        help="for `musselbed mission`: the aMussels are real, or another's",
    )
    parser.add_argument(
        "--lookout",
        metavar="NAME",
        default="",
        help="the person who looks out, with the vehicle's own switch at hand",
    )
    parser.add_argument(
        "--prove-stop",
        action="store_true",
        help="order a go-to of 6 m, stop it after 1 m, and see the aPad at rest",
    )
    parser.add_argument(
        "--prove-docks",
        action="store_true",
        help="open and close each dock once; asks first whether hands are clear",
    )
    parser.add_argument(
        "--hands-clear", action="store_true", help="a person says that hands are clear of the docks"
    )
    parser.add_argument(
        "--modem", type=Path, metavar="PORT", help="ask the physical modem on this port for its status"
    )
    parser.add_argument(
        "--echo", type=int, metavar="ID", help="with --modem: have the modem of this address answer a ping"
    )
    parser.add_argument(
        "--remap",
        metavar="FROM:=TO",
        action="append",
        default=[],
        help="another name for a topic, as of `run`",
    )
    run_command.add_accept(parser)
    add_trust_argument(parser)
    parser.add_argument(
        "--json", action="store_true", help="print the report as JSON on stdout, nothing else"
    )


def run(arguments: argparse.Namespace) -> int:
    options, scenario, starts = _read(arguments)
    if arguments.prove_docks and not arguments.hands_clear:
        require_yes(
            "The docks will open and close. Hands clear?",
            "docks open and close: a person must confirm by --hands-clear",
            "hands are not clear: nothing was ordered",
        )
    apads = names_in_full(scenario, options.namespace)
    findings: list[Finding] = []
    with WorkProgress(arguments.json) as progress:
        for finding in _all(arguments, options, scenario, starts, apads):
            findings.append(finding)
            progress.step(f"checks: {finding.check} is done")
    accepted = accepted_by(arguments.accept, findings, apads)
    report = Report(scenario.name, options.master_uri, now(), tuple(findings), accepted)
    path = report_path(scenario)
    path.parent.mkdir(mode=PRIVATE, exist_ok=True)
    report.save(path)
    red = red_keys(findings, apads, accepted)
    if arguments.json:
        print(path.read_text(), end="")
    else:
        _show(report, red, path, apads)
        for command in recording_commands(scenario, options.namespace):
            print(f"on the vehicle's computer: {command}")
    return Exit.PEER_FAILED if red else Exit.DONE


def _read(arguments: argparse.Namespace) -> tuple[RunOptions, Scenario, Sequence[Any]]:
    options = RunOptions(
        arguments.part,
        APadKind.ROS,
        TimeSource.WALL,
        speed=1.0,
        on_death=OnDeath.WAIT,
        namespace=run_command.namespace_of_shell(),
        remappings=run_command.remappings_of(arguments),
    )
    scenario, starts = read_scenario(arguments, trust_of_looked_at(arguments))
    if problems := problems_with_real_vehicle(scenario):
        raise UserError("\n".join(problems))
    if arguments.echo is not None and arguments.modem is None:
        raise UserError("--echo needs --modem PORT, the modem that pings")
    return options.on_master(somebodys_master()), scenario, starts


def _all(
    arguments: argparse.Namespace,
    options: RunOptions,
    scenario: Scenario,
    starts: Sequence[Any],
    apads: Sequence[str],
) -> Iterator[Finding]:
    """Orders are given last, and only if nothing is red that they depend on."""
    passive = []
    for finding in findings_of(scenario, starts, options):
        passive.append(finding)
        yield finding
    yield check_lookout(arguments.lookout)
    if arguments.modem is not None:
        from apad_bridge.doctor.modem import check_modem

        yield from run_check("modem", lambda: check_modem(arguments.modem, arguments.echo))
    former = {it.check: it for it in proofs(scenario, options.master_uri, apads)}
    accepted = accepted_by(arguments.accept, passive, apads)
    may_move = not never_overridden().intersection(red_keys(passive, apads, accepted))
    for apad, name in zip(apads, scenario.apad_names, strict=True):
        for what, asked in zip(PROOFS, (arguments.prove_stop, arguments.prove_docks), strict=True):
            check = f"{apad} {what}"
            if not asked:
                yield former[check]
            elif not may_move:
                yield fail("not tried: something above is red", "mend that, and prove it then", check=check)
            elif what == "stop":
                yield from run_check(check, partial(_prove_stop, scenario, options, name, arguments.accept))
            else:
                yield from run_check(check, partial(_prove_docks, scenario, options, apad))


def _prove_stop(scenario: Scenario, options: RunOptions, name: str, accept: Sequence[str]) -> Finding:
    """Flies the script by a process of its own, as any script is flown."""
    from apad_bridge.assembly.division import with_apad
    from apad_bridge.scenario.loader import write_resolved

    with tempfile.TemporaryDirectory(prefix="musselbed-stop-") as folder:
        scenario_file = Path(folder) / "scenario.yaml"
        write_resolved(scenario_file, with_apad(scenario, name))
        command = [*PYTHON, "-m", "apad_bridge.commands.main", "script", str(PROVE_STOP), "--json"]
        command += ["--scenario", str(scenario_file), "--apad", "ros", "--no-fleet", "--out", f"{folder}/run"]
        command += [word for it in options.remappings for word in ("--remap", it)]
        # Each was told before, and endangers no trial of a few metres.
        passed_over = [it.key for it in every_check() if it.may_be_red_in_trial]
        command += [word for it in passed_over for word in ("--despite", it, "--accept", it)]
        command += [word for it in accept for word in ("--accept", it)]
        try:
            flown = subprocess.run(command, capture_output=True, text=True, timeout=_PROOF_S, check=False)
        except subprocess.TimeoutExpired:
            return check_stop(f"the trial did not end within {_PROOF_S} s")
        if flown.returncode != Exit.DONE:
            lines = (flown.stderr.strip() or flown.stdout.strip()).splitlines()
            return check_stop(lines[-1] if lines else f"the trial ended with exit code {flown.returncode}")
        journal = read_journal(RunDirectory(Path(folder) / "run").journal)
    logged = [event for _, event in journal.events(ScriptReported)]
    if not any(it.what == STOP_PROVEN for it in logged):
        return check_stop("the trial ended before it had proven the stop")
    return check_stop(None, next((it.said for it in reversed(logged) if it.said), ""))


def _prove_docks(scenario: Scenario, options: RunOptions, apad: str) -> Finding:
    """Each dock opens and closes once, by a node of its own."""
    command = [*PYTHON, "-m", "apad_bridge.ros.prove_docks", apad, str(scenario.apad.docks)]
    with called_back_at(options.master_uri, options.namespace):
        flown = subprocess.run(command, capture_output=True, text=True, timeout=_PROOF_S, check=False)
    lines = (flown.stdout if flown.returncode == Exit.DONE else flown.stderr).strip().splitlines() or [
        "no word"
    ]
    if flown.returncode != Exit.DONE:
        return fail(lines[-1], "see the docks' node on the vehicle, or lower apad.docks")
    return ok(f"{lines[-1]}: a person must have watched it")


def _show(report: Report, red: dict[str, list[Finding]], path: Path, apads: Sequence[str]) -> None:
    table = Table(box=box.SIMPLE_HEAD, title=f"Preflight of {report.scenario}, {report.master}, {report.at}")
    for column in ("", "check", "found", "mend"):
        table.add_column(column, overflow="fold")
    for it in report.findings:
        table.add_row(
            f"[{_STYLES[it.status]}]{it.status.value}[/]",
            it.check,
            _plain(it.found),
            _plain(_mend(it, apads)),
        )
    console = Console()
    console.print(table)
    for line in verdict(report, red):
        console.print(line, highlight=False)
    for key, person in report.accepted.items():
        console.print(f"{key} cannot be told, and {person} accepts that", highlight=False, markup=False)
    console.print(f"kept in {path}", highlight=False)


def _mend(finding: Finding, apads: Sequence[str]) -> str:
    if finding.status is not CheckStatus.CANNOT_TELL:
        return finding.mend or ""
    key = key_among(finding.check, apads)
    return f"{finding.mend}; or check it by hand, and give --accept {key}:YOUR-NAME"


def verdict(report: Report, red: dict[str, list[Finding]]) -> Iterator[str]:
    """The last lines, with rich's marks: RED for failed checks, CANNOT TELL for unaccepted ones, or GREEN."""
    failed = [key for key, its in red.items() if any(it.status is CheckStatus.FAIL for it in its)]
    unaccepted = [key for key in red if key not in failed]
    if failed:
        never = sorted(never_overridden().intersection(failed))
        told = f", of which {', '.join(never)} cannot be overridden" if never else ""
        yield f"[{_STYLES[CheckStatus.FAIL]}]RED[/]: {', '.join(failed)}{told}"
    if unaccepted:
        yield (
            f"[{_STYLES[CheckStatus.CANNOT_TELL]}]CANNOT TELL[/]: {', '.join(unaccepted)}: no run starts before it is "
            "mended, or a person accepts it by --accept"
        )
    if not red:
        doubts = sum(it.status is CheckStatus.WARN for it in report.findings)
        yield f"[green]GREEN[/]{f', with {doubts} warnings' if doubts else ''}"


def _plain(text: str) -> str:
    return text.replace("[", r"\[")
