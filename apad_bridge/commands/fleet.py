"""`musselbed fleet`: simulated aMussels on ROS without a mission, for another planner."""

from __future__ import annotations

from typing import Any

from apad_bridge.commands import run as run_command
from apad_bridge.runs.exits import EXITS
from apad_bridge.scenario.run_options import Part


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "fleet",
        help="simulated aMussels on the master at ROS_MASTER_URI, and no mission",
        description="Starts the scenario's aMussels, a process each, on the master at ROS_MASTER_URI. They report on "
        "/amusselN/position and battery_level, are docked by whoever publishes /amusselN/position_static, and surface or "
        "sink by rosservice call /amusselN/surface and /amusselN/sink. Nothing is planned and no aPad is commanded.",
        epilog=f"Ends with the scenario's time or Ctrl-C. exit codes: {EXITS}",
    )
    run_command.add_scenario_arguments(parser)
    parser.set_defaults(run=run_command.run, part=Part.FLEET, strategy="none", console=False, check=False)
