"""`musselbed script`: flies a mission that is a Python script with the aPad's API."""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from apad_bridge.commands import run as run_command
from apad_bridge.commands.outcome import end_reasons, report
from apad_bridge.mission.ending import EndReason
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.runs import parent
from apad_bridge.runs.exits import EXITS, UserError
from apad_bridge.runs.flying import fly_in_process
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.scenario.run_options import APadKind, OnDeath, Part, TimeSource
from apad_bridge.scripting.program import ScriptError, ScriptSource, as_program

_SCENARIO = re.compile(r"^# scenario:\s*(\S+)\s*$", re.MULTILINE)


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "script",
        help="fly a mission that is a Python script with the aPad's API",
        description="Flies FILE.py instead of the paper's mission. `api`, `id_self` and `time` are given to it; time.sleep "
        "follows mission time. The flight ends with the script, when what it ordered last is done.",
        epilog=f"See docs/scripting.md. exit codes: {EXITS}",
    )
    parser.add_argument("file", type=Path, metavar="FILE.py")
    parser.add_argument(
        "--scenario",
        type=Path,
        metavar="SCENARIO.yaml",
        help="the world to fly in (default: what a line `# scenario: NAME` of the script says, relative to the script)",
    )
    run_command.add_flight_arguments(parser)
    run_command.add_apad_argument(parser)
    parser.add_argument(
        "--no-fleet",
        dest="part",
        action="store_const",
        const=Part.MISSION,
        default=Part.WHOLE,
        help="with --apad ros: for aMussels that are real, or another's, as `musselbed mission` hears them",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    file: Path = arguments.file
    try:
        program = as_program(file)
    except ScriptError as error:
        raise UserError(str(error)) from None
    if arguments.scenario is None:
        arguments.scenario = _scenario_of(file)
    if arguments.part is Part.MISSION and arguments.apad != APadKind.ROS:
        raise UserError("--no-fleet is for the aMussels on somebody's master: it needs --apad ros")
    options = replace(run_command.options_of(arguments), script=str(file.absolute()), on_death=OnDeath.WAIT)
    scenario, starts = run_command.read_scenario(arguments)
    if scenario.apads:
        raise UserError("a script flies one aPad, and the scenario names several: leave `apads` out")
    run_command.check_master(options)
    try:
        directory = RunDirectory.create(f"{file.stem}-{scenario.name}", datetime.now(UTC), arguments.out)
    except RunDirectoryError as error:
        raise UserError(str(error)) from error
    directory.write_inputs(scenario, starts)
    (directory.path / "script.py").write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    options.save(directory.path)
    duration_ms = round(scenario.duration_s * 1000)
    quiet = arguments.json
    with run_command.peers_may_fail(), FlightProgress(file.name, duration_ms, quiet=quiet) as progress:
        if options.time is TimeSource.ASAP:
            command_source = ScriptSource(scenario, program, file.name, progress.print_message)
            summary = fly_in_process(scenario, starts, directory, progress, (command_source,))
            command_source.join()
            command_source.print_error()
        else:
            summary = parent.fly(scenario, starts, options, directory, progress)
    code = report(scenario.name, file.name, directory, summary, arguments.json, progress.messages)
    if EndReason.SCRIPT_FAILED in end_reasons(summary):
        print(f"musselbed script: {summary['ended_by']}", file=sys.stderr)
    return code


def _scenario_of(file: Path) -> Path:
    found = _SCENARIO.search(file.read_text(encoding="utf-8"))
    if found is None:
        raise UserError(
            f"{file}: in which scenario? Give --scenario SCENARIO.yaml, or write a line `# scenario: NAME` into the script"
        )
    return file.parent / found[1]
