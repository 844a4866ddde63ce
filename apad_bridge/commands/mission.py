"""`musselbed mission`: the supervisor's mission and planner without a fleet, for real aMussels or another fleet."""

from __future__ import annotations

from typing import Any

from apad_bridge.commands import run as run_command
from apad_bridge.runs.exits import EXITS
from apad_bridge.scenario.run_options import Part


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "mission",
        help="the supervisor alone, for aMussels that are real or another's",
        description="Flies the scenario's mission with the aPad on the master at ROS_MASTER_URI, for aMussels that it "
        "hears there: whole status packets on /musselbed/heard, or /amusselN/position and battery_level of an existing "
        "fleet. What it says to them goes out on /musselbed/said. The scenario's ids say which aMussels are its business.",
        epilog=f"exit codes: {EXITS}",
    )
    run_command.add_scenario_arguments(parser)
    parser.add_argument("--strategy", metavar="NAME", help="another collection strategy than the scenario's")
    run_command.add_manual_argument(parser)
    parser.set_defaults(run=run_command.run, part=Part.MISSION, console=False, check=False)
