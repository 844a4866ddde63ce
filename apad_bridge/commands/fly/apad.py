"""`musselbed apad SCENARIO`: the simulated aPad alone, as a stand-in for a real one."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from agents.hosting import started
from apad_bridge.commands.fly.run import namespace_of_shell
from apad_bridge.commands.help_text import ending
from apad_bridge.ros.system.route import environment_for, somebodys_master
from apad_bridge.scenario.choices import OWN_GENERATIONS


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "apad",
        description="Puts the scenario's simulated aPad on the master at ROS_MASTER_URI, with the topics, services and "
        "actions of its generation, and without a fleet or a mission. It prints `ready` when it is on the graph, "
        "and ends at Ctrl-C, SIGTERM or SIGHUP with exit code 130.",
        epilog=ending(
            "musselbed apad launch_scripts/scenarios/pool-12.yaml",
            "musselbed apad launch_scripts/scenarios/pool-12.yaml --generation b --time clock",
        ),
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO.yaml")
    parser.add_argument("--apad", metavar="NAME", help="one of the scenario's aPads (default: the first)")
    parser.add_argument(
        "--generation",
        choices=sorted(OWN_GENERATIONS),
        help="generation of the aPad's software, instead of the scenario's",
    )
    parser.add_argument(
        "--time",
        choices=["wall", "clock"],
        default="wall",
        help="wall: real time; clock: the master's /clock; the aPad ends when that is silent for 10 min (default: wall)",
    )


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.scenario.loader import load

    load(arguments.scenario)
    environment = environment_for(somebodys_master(), namespace_of_shell())
    options = ["--scenario", str(arguments.scenario), "--time", arguments.time]
    for option in ("apad", "generation"):
        if (value := getattr(arguments, option)) is not None:
            options += [f"--{option}", value]
    sys.stdout.flush()
    started.replace_process("apad_bridge.ros.simulated_node.apad_node", options, environment)
