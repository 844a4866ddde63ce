"""`musselbed run`: flies a scenario."""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import STRATEGY, ending
from apad_bridge.commands.look import console
from apad_bridge.commands.trust import trust_of_typed
from apad_bridge.runs.exits import refuse
from apad_bridge.scenario.choices import Generation, Hosting
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from firmware_model.entry_points import entry_points

SLOWEST, FASTEST = 0.01, 10_000.0
_TIMES = """asap: virtual time, as fast as the machine goes, the simulated aPad in the same process, no ROS;
wall: real time (times --speed with the simulated aPad); ros: the /clock of another master (default: wall)"""
_NAMESPACE = re.compile(r"/?|/?[A-Za-z]\w*(/[A-Za-z]\w*)*/?", re.ASCII)
_REMAPPING = re.compile(r"[/~]?[A-Za-z][\w/]*:=[/~]?[A-Za-z][\w/]*")


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "run",
        description="Flies a scenario to its end and prints its row of the paper's Table II. A new run directory keeps "
        "the records: journal.jsonl, run.bag, summary.json, the resolved scenario, and starts and ends from which another "
        "run can begin.",
        epilog=ending(
            "musselbed run pool-12 --time asap",
            "musselbed run pool-12 --speed 10 --console",
            "musselbed run real-apad --apad ros --dry-run",
        ),
    )
    add_scenario_arguments(parser)
    add_apad_argument(parser)
    parser.add_argument("--strategy", metavar=STRATEGY, help="collection strategy, instead of the scenario's")
    add_manual_argument(parser)
    parser.add_argument("--dry-run", action="store_true", help="plan once and print it; command nothing")
    parser.add_argument(
        "--on-supervisor-death",
        choices=[policy.value for policy in OnDeath],
        default=OnDeath.WAIT.value,
        help="resume: at once; wait: a person gives `musselbed resume` (default: wait)",
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="at the end, check that the records obey the rules that hold in every run (musselbed check)",
    )
    bringers = [console, *(it.load() for it in entry_points("musselbed.run_options"))]
    parser.set_defaults(part=BenchPart.WHOLE, beside=[it.add_run_options(parser) for it in bringers])


def add_manual_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--manual",
        action="store_true",
        help="plan nothing: the aPad obeys rosservice call /musselbed/NAME/go_to_point, dock and others",
    )


def add_apad_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--apad",
        choices=[kind.value for kind in APadKind],
        default=APadKind.SIM.value,
        help="sim: the simulated aPad (on a master of our own, or in-process with --time asap); "
        "ros: the one on the master at ROS_MASTER_URI (default: sim)",
    )


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments that `run`, `fleet` and `mission` share."""
    parser.add_argument(
        "scenario", type=Path, metavar="SCENARIO.yaml", help="its file, or the name of a shipped one: pool-12"
    )
    add_flight_arguments(parser)


def add_flight_arguments(command: argparse.ArgumentParser) -> None:
    """The arguments for the manner of flying a scenario, and for changes to it, after the command's own."""
    # For a command that has no such argument of its own.
    command.set_defaults(manual=False, dry_run=False, on_supervisor_death=OnDeath.WAIT.value)
    parser = command.add_argument_group("the flight", "how it flies, and values in place of the scenario's")
    parser.add_argument(
        "--time", choices=[source.value for source in TimeSource], default="wall", help=_TIMES
    )
    parser.add_argument(
        "--speed",
        type=float,
        default=1.0,
        metavar="X",
        help="run X times as fast as the clock; simulated aPad only (default: 1)",
    )
    parser.add_argument(
        "--generation",
        choices=[it.value for it in Generation],
        help="generation of the aPad's software, instead of the scenario's: a (action_server), b (commander/primitive), or "
        "auto: the one on the graph",
    )
    parser.add_argument(
        "--theta", type=int, metavar="N", help="run the aMussels' time N times as fast as the aPad's"
    )
    parser.add_argument(
        "--agents",
        type=int,
        metavar="N",
        help="number of aMussels, instead of the scenario's; a file of starts needs a row for each",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed, instead of the scenario's")
    parser.add_argument(
        "--hosting",
        choices=[hosting.value for hosting in Hosting],
        help="one process for each aMussel, or one for all (the same trace), instead of the scenario's",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="the run directory (default: a new one in runs/)"
    )
    parser.add_argument(
        "--open-modem",
        type=int,
        metavar="ID",
        action="append",
        default=[],
        help="open this aMussel's modem as a serial device, RUN/modems/amusselID; repeatable",
    )
    parser.add_argument(
        "--modem",
        type=Path,
        metavar="PORT",
        help="send all sound by the physical nanomodem on this serial port; theta must be 1",
    )
    parser.add_argument(
        "--remap",
        metavar="FROM:=TO",
        action="append",
        default=[],
        help="rename a topic or service of ROS, as --remap /apad1/position:=/boat/position; repeatable",
    )
    parser.add_argument(
        "--despite",
        metavar="CHECK",
        action="append",
        default=[],
        help="start a real aPad although this check of its preflight is red; never fence, position, pilot or stop; "
        "repeatable",
    )
    add_accept(parser)
    parser.add_argument(
        "--json", action="store_true", help="print the summary as JSON on stdout, nothing else"
    )


def add_accept(parser: argparse._ActionsContainer) -> None:
    """The option by which an operator accepts a preflight's check that cannot tell."""
    parser.add_argument(
        "--accept",
        metavar="CHECK[:PERSON]",
        action="append",
        default=[],
        help="a check of the preflight that says CANNOT TELL, and who accepts that (default: the login's name); it is "
        "kept in the preflight's record; repeatable",
    )


def options_of(arguments: argparse.Namespace) -> RunOptions:
    apad, time = APadKind(getattr(arguments, "apad", APadKind.ROS)), TimeSource(arguments.time)
    is_asap, is_ros, is_scaled = time is TimeSource.ASAP, apad is APadKind.ROS, arguments.speed != 1
    mend = "leave out --apad ros, or use --time wall" if "apad" in arguments else "use --time wall or ros"
    refuse(
        (
            not SLOWEST <= arguments.speed <= FASTEST,
            f"--speed must be {SLOWEST:g} to {FASTEST:g}, not {arguments.speed}",
        ),
        (is_asap and is_ros, f"--time asap flies the simulated aPad in-process: {mend}"),
        (
            time is TimeSource.ROS and not is_ros,
            "--time ros follows another master's /clock: it needs --apad ros",
        ),
        (
            is_scaled and is_asap,
            "--speed works with --time wall only: leave it out; asap flies as fast as the machine goes",
        ),
        (
            is_scaled and (is_ros or time is not TimeSource.WALL),
            "--speed needs --time wall and the simulated aPad: a real vehicle moves in real time",
        ),
        (
            arguments.manual and is_asap,
            "--manual needs ROS, which carries the calls: use --time wall, or a script",
        ),
        (arguments.manual and arguments.dry_run, "--manual plans nothing: there is no first plan to print"),
    )
    remappings = remappings_of(arguments)
    refuse(
        (
            remappings and is_asap,
            "--remap renames topics and services of ROS, and --time asap has none: leave it out",
        )
    )
    return RunOptions(
        namespace="" if is_asap else namespace_of_shell(),
        remappings=remappings,
        despite=tuple(arguments.despite),
        accept=tuple(arguments.accept),
        open_modems=tuple(sorted(set(arguments.open_modem))),
        modem="" if arguments.modem is None else str(arguments.modem.absolute()),
        part=arguments.part,
        apad=apad,
        time=time,
        speed=arguments.speed,
        on_death=OnDeath(arguments.on_supervisor_death),
        dry_run=arguments.dry_run,
        manual=arguments.manual,
    )


def remappings_of(arguments: argparse.Namespace) -> tuple[str, ...]:
    for remapping in arguments.remap:
        if not _REMAPPING.fullmatch(remapping):
            raise UserError(f"--remap {remapping}: use FROM:=TO, two names of ROS, as /a/b:=/c")
    return tuple(arguments.remap)


def namespace_of_shell() -> str:
    """The namespace in ROS_NAMESPACE, which roslaunch sets for the nodes of a group."""
    namespace = os.environ.get("ROS_NAMESPACE", "")
    if not _NAMESPACE.fullmatch(namespace):
        raise UserError(f"ROS_NAMESPACE={namespace}: must be a name of ROS, such as basin or /lab/basin")
    return namespace.strip("/")


def run(arguments: argparse.Namespace) -> int:
    options = options_of(arguments)
    # Imported here: a help, or a mistake in the options, needs none of the parts of a flight.
    from apad_bridge.commands.fly.flight import fly, read_scenario

    trust = trust_of_typed()
    scenario, starts = read_scenario(arguments, trust)
    live = [service for asked in arguments.beside if (service := asked(arguments)) is not None]
    return fly(
        options, scenario, starts, arguments.out, arguments.json, trust, live=live, check=arguments.check
    )
