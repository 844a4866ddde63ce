"""`musselbed ros2 RUN`: show a run live on ROS 2; it takes no orders from there."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from apad_bridge.commands.help_text import ending
from apad_bridge.commands.look.console import add_run_arguments, directory_of
from apad_bridge.runs.exits import Exit

if TYPE_CHECKING:
    from apad_bridge.ros2.topics import RunTopics


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "ros2",
        description="Publishes a run's aPad and aMussels on ROS 2, by standard messages, as long as the run flies and "
        "after its end. It takes no orders. Ctrl-C ends this and not the run. By default programs of this machine alone "
        "see it; ROS_AUTOMATIC_DISCOVERY_RANGE and ROS_DOMAIN_ID mean what they mean to ROS 2. Without RUN it shows "
        "the run on the master at ROS_MASTER_URI, which may fly on another machine.",
        epilog=ending(
            "musselbed ros2 runs/pool-12-1",
            "musselbed ros2 --apad apad2",
            note="It needs launch_scripts/install --ros2; docs/ros2.md has the topics.",
        ),
    )
    add_run_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print the node's name as JSON on stdout")


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.ros2.ros2_process import Ros2Gone, require_ros2, serve

    require_ros2()

    def began(topics: RunTopics) -> None:
        text = f"on ROS 2 as the node /{topics.node}: {topics.summary}"
        print(json.dumps({"node": f"/{topics.node}"}) if arguments.json else text, flush=True)

    def tell(text: str) -> None:
        print(f"musselbed ros2: {text}", file=sys.stderr, flush=True)

    try:
        with directory_of(arguments) as directory:
            serve(directory, began, tell)
    except Ros2Gone as error:
        tell(str(error))
        return Exit.PEER_FAILED
    return Exit.DONE
