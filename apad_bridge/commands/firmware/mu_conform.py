"""`musselbed mu conform ./board`: judges somebody's firmware by the motors, charges and bytes of its board."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from rich.progress import track
from rich.table import Table

from agents.mussel.firmware_failure import FirmwareFailed
from agents.mussel.port.agent_rig import STIMULI as WHOLE_STIMULI
from apad_bridge.commands.firmware.mu_program import (
    AT_THE_EDGE,
    BOARDS,
    WHOLE,
    WORST_CASE,
    command_of,
    our_rig,
    rig_of,
)
from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.rich_console import Console
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.text.text_file import text_of, write_atomically
from apad_bridge.scenario.text.yaml_text import yaml_of
from firmware_model.bench.conformance import (
    Case,
    CaseResult,
    RequirementSource,
    Verdict,
    Whole,
    captured,
    judged,
    random_cases,
    shrunk,
    side_by_side,
    traced,
    unknown_names,
)
from firmware_model.bench.conformance_cases import CASES
from firmware_model.bench.rigs import STIMULI, lasts_ms
from firmware_model.bench.whole_conformance_cases import WHOLE_CASES

_CASES = {WORST_CASE: CASES, WHOLE: WHOLE_CASES}

_AT_THETA_1_MS = 300_000
"""The longest case for a board whose time is the wall's."""


def add_conform(parts: Any) -> None:
    conform = parts.add_parser(
        "conform",
        help="judge firmware of your own by the outside of its board",
        description="Runs PROGRAM and our own firmware through the same cases, and compares when motors run, when "
        "batteries charge, which bytes are sent, and the charge at the end. A case that cites our own choice differs; the "
        "others fail (exit code 3). Passing is a least filter: it does not show that firmware is right.",
        epilog=ending(
            "musselbed mu conform ./board",
            "musselbed mu conform ./board --case bounces --random 50",
            'musselbed mu conform ./board --script "3s permission 70s rises_unseen 1h"',
            note=f"a script's words: waits as 50ms, 2s, 5min, 1h; {'; '.join(STIMULI)}\nwith --profile mu also: "
            f"{'; '.join(WHOLE_STIMULI)}",
        ),
    )
    conform.add_argument("program", type=Path, metavar="PROGRAM", help="firmware: see docs/firmware-port.md")
    conform.add_argument(
        "--profile",
        choices=tuple(BOARDS),
        default=WORST_CASE,
        help="the board that PROGRAM is for: the paper's worst case, or a whole one (default: worst-case)",
    )
    conform.add_argument(
        "--case", action="append", default=[], metavar="NAME", help="this case alone; can be repeated"
    )
    conform.add_argument(
        "--random",
        type=int,
        default=0,
        metavar="N",
        help="also N random scripts, shortened where they differ",
    )
    conform.add_argument(
        "--seed", type=int, default=1, metavar="N", help="of the random scripts and of --cost (default: 1)"
    )
    conform.add_argument(
        "--cost",
        type=int,
        default=0,
        choices=range(0, 6),
        metavar="MS",
        help="each turn of PROGRAM takes 0 to MS ms, at most 5, of its board's time: races show (default: 0)",
    )
    conform.add_argument(
        "--serial",
        action="store_true",
        help="only the cases that take less than 5 minutes of the board's time",
    )
    conform.add_argument(
        "--captured", type=Path, metavar="TRACE", help="judge PROGRAM by this trace of a real board alone"
    )
    conform.add_argument(
        "--capture",
        type=Path,
        metavar="TRACE",
        help="write the trace of PROGRAM in --script or in one --case",
    )
    conform.add_argument(
        "--script",
        metavar="WORDS",
        help="this script alone, as a failed case prints it, on the board of --case (else the usual one)",
    )
    conform.add_argument(
        "--waive", type=Path, metavar="FILE.yaml", help="cases that need not pass, each with its reason"
    )
    conform.add_argument("--junit", type=Path, metavar="FILE.xml", help="write the results as JUnit XML")
    conform.add_argument("--json", action="store_true", help="print the results as JSON on stdout")
    conform.set_defaults(run=run_conform)


def run_conform(arguments: argparse.Namespace) -> int:
    program: Path = arguments.program
    command_of(program)  # a file that is none is told before anything starts
    waivers = {} if arguments.waive is None else _waivers(arguments.waive, arguments.profile)
    console = Console(stderr=arguments.json)
    cost = arguments.cost, arguments.seed
    results = []
    for case in track(_cases(arguments), "cases", console=console, transient=True, disable=arguments.json):
        try:
            result = _judged(program, case, waivers, *cost)
        except ValueError as error:
            raise UserError(f"--script: {error}") from None
        # For firmware that takes time the pauses between the words matter: such a script stays whole.
        is_random = case.name.startswith("random-") and not arguments.cost
        if result.verdict is not Verdict.PASSED and is_random:
            short = shrunk(case, lambda it: _judged(program, it, {}, *cost).verdict is not Verdict.PASSED)
            result = _judged(program, short, waivers, *cost)
        results.append(result)
    if arguments.captured is not None:
        results.append(_judged_by_trace(program, arguments.captured, arguments.profile, *cost))
    if arguments.capture is not None:
        if len(results) != 1:
            raise UserError("--capture: name one --case, or a --script")
        write_atomically(arguments.capture, "\n".join(traced(results[0].case, results[0].theirs)) + "\n")
    if arguments.junit is not None:
        write_atomically(arguments.junit, _junit(program, results))
    if arguments.json:
        print(json.dumps([_as_data(it) for it in results], indent=1))
    else:
        _show(results, console)
    return Exit.PEER_FAILED if any(it.verdict is Verdict.FAILED for it in results) else Exit.DONE


def _cases(arguments: argparse.Namespace) -> list[Case]:
    if arguments.captured is not None:
        return []
    known, is_whole = _CASES[arguments.profile], arguments.profile == WHOLE
    if unknown := unknown_names(arguments.case, known):
        raise UserError(f"--case {unknown[0]}: there are {', '.join(case.name for case in known)}")
    chosen = [case for case in known if not arguments.case or case.name in arguments.case]
    if arguments.script is not None:
        return [_of_script(arguments.script, chosen if arguments.case else [], is_whole)]
    chosen = [case for case in chosen if not (arguments.cost and case.is_near_tie)]
    chosen += random_cases(arguments.random, arguments.seed, arguments.cost > 0, is_whole)
    return [case for case in chosen if not arguments.serial or lasts_ms(case.script) < _AT_THETA_1_MS]


def _of_script(script: str, boards: list[Case], is_whole: bool) -> Case:
    """The script on the board of the one case in `boards`, or on the usual one; UserError for more."""
    if len(boards) > 1:
        raise UserError("--script: name one --case, whose board it is to have")
    usual = Case("", RequirementSource.SCRIPT, "", "", whole=Whole() if is_whole else None)
    return replace(
        (boards or [usual])[0],
        name="script",
        source=RequirementSource.SCRIPT,
        requirement="the same as ours",
        script=script,
        paper=None,
        shows=None,
    )


def _judged(program: Path, case: Case, waivers: dict[str, str], cost_ms: int, seed: int) -> CaseResult:
    return judged(
        case=case,
        ours=our_rig,
        theirs=lambda it: rig_of(program, it, cost_ms, seed),
        failures=FirmwareFailed,
        waivers=waivers,
        late_ms=2 * cost_ms,
        readings=(AT_THE_EDGE,),
    )


def _judged_by_trace(program: Path, trace: Path, profile: str, cost_ms: int, seed: int) -> CaseResult:
    """Plays a captured trace again, and compares; UserError for a file that is none."""
    text = text_of(trace)
    try:
        case, found = captured(text, trace.stem)
    except ValueError as error:
        raise UserError(f"{trace}: {error}") from None
    case = replace(case, whole=Whole() if profile == WHOLE else None)
    return judged(case, found, lambda it: rig_of(program, it, cost_ms, seed), FirmwareFailed, {}, 2 * cost_ms)


def _waivers(path: Path, profile: str) -> dict[str, str]:
    """Reads names of cases and reasons; UserError for another file, or a case that there is not."""
    data = yaml_of(path)
    if not isinstance(data, dict) or not all(
        isinstance(it, str) and it for pair in data.items() for it in pair
    ):
        raise UserError(f"{path}: a mapping of names of cases to reasons is needed")
    if unknown := unknown_names(data, _CASES[profile]):
        raise UserError(f"{path}: no case is called {unknown[0]}")
    return data


def _show(results: list[CaseResult], console: Console) -> None:
    others = [it for it in results if it.verdict is not Verdict.PASSED]
    if others:
        table = Table()
        for heading in ("case", "verdict", "requirement of", "requirement", "what happened"):
            table.add_column(heading, overflow="fold")
        for it in others:
            table.add_row(it.case.name, it.verdict, it.case.source, it.case.requirement, it.reason)
        console.print(table)
    for result in others:
        if result.verdict in (Verdict.FAILED, Verdict.DIFFERS):
            console.print(f"{result.case.name}: {result.case.script}", soft_wrap=True, markup=False)
            for line in side_by_side(result):
                console.print(line, soft_wrap=True, markup=False, highlight=False)
    counts = Counter(it.verdict for it in results)
    found = ", ".join(f"{counts[it]} {it.lower()}" for it in Verdict if counts[it])
    console.print(
        f"{len(results)} cases: {found}. Passing is a least filter: it does not show that firmware is right.",
        soft_wrap=True,
    )


def _as_data(result: CaseResult) -> dict[str, Any]:
    return {
        "case": result.case.name,
        "verdict": result.verdict.lower(),
        "source": result.case.source,
        "requirement": result.case.requirement,
        "script": result.case.script,
        "reason": result.reason,
        "expected": asdict(result.ours),
        "found": asdict(result.theirs),
    }


def _junit(program: Path, results: Iterable[CaseResult]) -> str:
    """JUnit's XML: what differs or is waived counts as skipped, with its reason."""
    suite = ElementTree.Element("testsuite", name=f"musselbed mu conform {program.name}")
    for result in results:
        case = ElementTree.SubElement(
            suite, "testcase", classname=result.case.source.replace(".", "-"), name=result.case.name
        )
        if result.verdict is Verdict.FAILED:
            failure = ElementTree.SubElement(case, "failure", message=result.reason)
            failure.text = "\n".join([result.case.requirement, result.case.script, *side_by_side(result)])
        elif result.verdict is not Verdict.PASSED:
            ElementTree.SubElement(case, "skipped", message=f"{result.verdict}: {result.reason}")
    return ElementTree.tostring(suite, encoding="unicode")
