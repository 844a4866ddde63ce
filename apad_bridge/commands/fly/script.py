"""`musselbed script`: flies a mission that is a Python script with the aPad's API."""

from __future__ import annotations

import argparse
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from apad_bridge.commands.fly import run as run_command
from apad_bridge.commands.help_text import ending
from apad_bridge.commands.trust import trust_of_typed
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath

_SCENARIO = re.compile(r"^# scenario:\s*(\S+)\s*$", re.MULTILINE)


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "script",
        description="Flies FILE.py instead of the paper's mission. The script gets `api`, `id_self` and `time`; time.sleep "
        "follows mission time. The flight ends with the script, when its last order is done.",
        epilog=ending(
            "musselbed script launch_scripts/examples/listing_1.py --time asap",
            "musselbed script launch_scripts/examples/energy_exchange.py --speed 10",
            note="See docs/scripting.md.",
        ),
    )
    parser.add_argument("file", type=Path, metavar="FILE.py")
    parser.add_argument(
        "--scenario",
        type=Path,
        metavar="SCENARIO.yaml",
        help="the scenario (default: the one in the script's line `# scenario: NAME`, relative to the script)",
    )
    run_command.add_flight_arguments(parser)
    run_command.add_apad_argument(parser)
    parser.add_argument(
        "--no-fleet",
        dest="part",
        action="store_const",
        const=BenchPart.MISSION,
        default=BenchPart.WHOLE,
        help="with --apad ros: simulate none, for real aMussels or another fleet, as `musselbed mission`",
    )


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.commands.fly.flight import Script, fly, read_scenario
    from apad_bridge.scripting.program import as_program

    file: Path = arguments.file
    trust = trust_of_typed()
    program = as_program(file, trust)
    if arguments.scenario is None:
        arguments.scenario = _scenario_of(file)
    if arguments.part is BenchPart.MISSION and arguments.apad != APadKind.ROS:
        raise UserError("--no-fleet is for the aMussels on another master: it needs --apad ros")
    options = replace(run_command.options_of(arguments), script=str(file.absolute()), on_death=OnDeath.WAIT)
    scenario, starts = read_scenario(arguments, trust)
    return fly(options, scenario, starts, arguments.out, arguments.json, trust, script=Script(file, program))


def _scenario_of(file: Path) -> Path:
    if (found := _SCENARIO.search(file.read_text(encoding="utf-8"))) is None:
        raise UserError(
            f"{file}: in which scenario? Give --scenario SCENARIO.yaml, or write a line `# scenario: NAME` into the script"
        )
    return file.parent / found[1]
