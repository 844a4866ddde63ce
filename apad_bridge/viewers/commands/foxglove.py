"""`musselbed foxglove RUN`: show a run live in Foxglove or Lichtblick; they give no orders."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError

if TYPE_CHECKING:
    from apad_bridge.runs.watched_services import Service

LOOPBACK = "127.0.0.1"
_PORT = 8765
_LAST_MESSAGES_S = 2.0


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "foxglove",
        description="Serves all topics of a run that flies over ROS to Foxglove and Lichtblick, by their WebSocket. They "
        "see the flight and cannot order anything. A page in a browser needs the printed address with its token; any other "
        "program on this machine may connect. Ctrl-C ends this and not the run. Without RUN it serves the master at "
        "ROS_MASTER_URI.",
        epilog=ending(
            "musselbed foxglove runs/pool-12-1",
            "musselbed foxglove --port 8766",
            note="docs/ros-tools.md says which viewer is for what, and where the layout is.",
        ),
    )
    parser.add_argument(
        "directory",
        type=Path,
        nargs="?",
        metavar="RUN",
        help="the run's directory (default: the master at ROS_MASTER_URI)",
    )
    parser.add_argument(
        "--host",
        default=LOOPBACK,
        metavar="ADDRESS",
        help="listen on this address; whoever reaches it sees the run (default: this machine alone)",
    )
    parser.add_argument(
        "--port",
        type=int,
        default=_PORT,
        metavar="N",
        help=f"listen on this port; 0: a free one (default: {_PORT})",
    )
    parser.add_argument("--json", action="store_true", help="print the address as JSON on stdout")


def add_run_options(parser: argparse.ArgumentParser) -> Callable[[argparse.Namespace], Service | None]:
    """Adds the argument by which `musselbed run` has a server beside it; returns the maker of what was asked for."""
    parser.add_argument(
        "--foxglove",
        type=int,
        metavar="PORT",
        help="serve the run's topics to Foxglove and Lichtblick on this machine, at this port, such as 8765; 0: a free one",
    )
    return _asked


def _asked(arguments: argparse.Namespace) -> Service | None:
    """The server that `musselbed run` was asked for; None for none. UserError for a server that cannot be opened so."""
    port: int | None = arguments.foxglove
    if port is None:
        return None
    _require_foxglove()
    _refuse_port("--foxglove", port)
    if arguments.time == "asap":
        raise UserError(
            "--foxglove shows a flight over ROS, and --time asap flies without it: leave one of them out"
        )
    from apad_bridge.runs.watched_services import Service
    from apad_bridge.viewers.viewer_gate import TOKEN_VARIABLE

    def again(line: str) -> tuple[tuple[str, ...], dict[str, str]]:
        url = urlsplit(line[line.index("ws://") :].rstrip())
        return ("--port", str(url.port)), {TOKEN_VARIABLE: url.query.removeprefix("token=")}

    return Service("foxglove", ("--port", str(port)), _LAST_MESSAGES_S, again, serves_several=True)


def run(arguments: argparse.Namespace) -> int:
    _require_foxglove()
    _refuse_port("--port", arguments.port)
    from apad_bridge.viewers.foxglove_server import serve

    def tell(port: int, token: str) -> None:
        url = f"ws://{arguments.host}:{port}/?token={token}"
        text = f"for Foxglove and Lichtblick (connection: Foxglove WebSocket): {url}"
        print(json.dumps({"url": url}) if arguments.json else text, flush=True)

    def warn(text: str) -> None:
        print(f"musselbed foxglove: {text}", file=sys.stderr, flush=True)

    if serve(arguments.directory, arguments.host, arguments.port, tell, warn):
        warn("the ROS master is gone: the run has ended")
    return Exit.DONE


def _refuse_port(option: str, port: int) -> None:
    if not 0 <= port < 65536:
        raise UserError(f"{option} must be 0 to 65535, not {port}")


def _require_foxglove() -> None:
    if find_spec("foxglove") is None:
        raise UserError(
            "foxglove-sdk is not installed: run launch_scripts/install, or pip install 'musselbed[foxglove]'"
        )
