"""`musselbed mission`: the supervisor's mission and planner without a fleet, for real aMussels or another fleet."""

from __future__ import annotations

from typing import Any

from apad_bridge.commands.fly import run as run_command
from apad_bridge.commands.help_text import STRATEGY, ending
from apad_bridge.scenario.run_options import BenchPart


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "mission",
        description="Flies the scenario's mission with the aPad on the master at ROS_MASTER_URI, for aMussels that it "
        "finds there. It reads whole status packets on /musselbed/heard, or /amusselN/position and battery_level of an "
        "existing fleet, and publishes its packets to them on /musselbed/said. It serves the scenario's ids only.",
        epilog=ending(
            "musselbed mission launch_scripts/scenarios/pool-12.yaml",
            "musselbed mission launch_scripts/scenarios/pool-12.yaml --remap /apad1/position:=/boat/position",
        ),
    )
    parser.add_argument("--strategy", metavar=STRATEGY, help="collection strategy, instead of the scenario's")
    run_command.add_manual_argument(parser)
    run_command.add_scenario_arguments(parser)
    parser.set_defaults(run=run_command.run, part=BenchPart.MISSION, check=False, beside=())
