"""`musselbed fleet`: simulated aMussels on ROS without a mission, for another planner."""

from __future__ import annotations

from typing import Any

from apad_bridge.commands.fly import run as run_command
from apad_bridge.commands.help_text import ending
from apad_bridge.scenario.run_options import BenchPart


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "fleet",
        description="Starts the scenario's aMussels, a process each, on the master at ROS_MASTER_URI. They report on "
        "/amusselN/position and battery_level. A publisher of /amusselN/position_static docks them, and rosservice call "
        "/amusselN/surface and /amusselN/sink moves them. This command plans nothing and commands no aPad. "
        "Only its bag stays, as runs/SCENARIO-STAMP.bag; with --out DIR the whole run does.",
        epilog=ending(
            "musselbed fleet launch_scripts/scenarios/pool-12.yaml",
            "musselbed fleet launch_scripts/scenarios/pool-12.yaml --time ros --agents 4",
            note="It ends with the scenario's time or Ctrl-C.",
        ),
    )
    run_command.add_scenario_arguments(parser)
    parser.set_defaults(run=run_command.run, part=BenchPart.FLEET, strategy="none", check=False, beside=())
