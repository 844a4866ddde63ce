"""`musselbed console RUN`: a run that flies, live in a browser."""

from __future__ import annotations

import argparse
import json
import sys
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError
from apad_bridge.vehicle.link_errors import PeerFailed

if TYPE_CHECKING:
    from apad_bridge.runs.watched_services import Service

LOOPBACK = "127.0.0.1"
_LAST_PAGE_S = 2.0


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "console",
        description="Serves the replay page of a run with live data: the map, the batteries, the events, and buttons for "
        "stop, continue, abort and remarks. Ctrl-C ends the console and not the run. Each console prints an address with "
        "its own token. Anybody with the address may give orders. Without RUN it shows the run on the master at "
        "ROS_MASTER_URI, which may fly on another machine.",
        epilog=ending("musselbed console runs/pool-12-1 --open", "musselbed console --port 8080"),
    )
    add_run_arguments(parser)
    parser.add_argument(
        "--host",
        default=LOOPBACK,
        metavar="ADDRESS",
        help="listen on this address; the token then travels without encryption (default: this machine alone)",
    )
    parser.add_argument(
        "--port", type=int, default=0, metavar="N", help="listen on this port (default: a free one)"
    )
    parser.add_argument(
        "--name",
        action="append",
        default=[],
        metavar="NAME",
        help="a further name of it, as of a proxy before it; under other names it answers nothing",
    )
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    parser.add_argument(
        "--json",
        action="store_true",
        help="print the page's address and the line of an order as JSON on stdout",
    )


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.console.process import ListenAddress, serve
    from apad_bridge.console.server import order_line

    if not 0 <= arguments.port < 65536:
        raise UserError(f"--port must be 0 to 65535, not {arguments.port}")

    def tell(url: str) -> None:
        order = order_line(url)
        print(
            json.dumps({"url": url, "order": order})
            if arguments.json
            else f"{url}\na program stops it by: {order}",
            flush=True,
        )
        if arguments.open and not webbrowser.open(url):
            raise UserError(f"no browser could be started: open {url} in one")

    def show_end(reason: str) -> None:
        print(
            json.dumps({"ended_by": reason}) if arguments.json else f"the run has ended: {reason}", flush=True
        )

    def warn(text: str) -> None:
        print(f"musselbed console: {text}", file=sys.stderr, flush=True)

    try:
        with directory_of(arguments) as directory:
            serve(
                directory,
                ListenAddress(arguments.host, arguments.port, tuple(it.lower() for it in arguments.name)),
                tell,
                show_end,
                warn,
            )
    except OSError as error:
        raise UserError(
            f"cannot listen on {arguments.host} port {arguments.port}: {error.strerror}"
        ) from error
    return Exit.DONE


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """RUN, or the run on the master: what `directory_of` reads."""
    parser.add_argument(
        "directory",
        type=Path,
        nargs="?",
        metavar="RUN",
        help="the run's directory (default: the run on the master at ROS_MASTER_URI)",
    )
    parser.add_argument("--apad", metavar="NAME", help="without RUN: which of several aPads on that master")


@contextmanager
def directory_of(arguments: argparse.Namespace) -> Iterator[Path]:
    """The directory of RUN, or a copy of the run on the master that lasts while it is entered. UserError for both."""
    if arguments.directory is not None and arguments.apad is not None:
        raise UserError("--apad chooses a run on the master: leave out RUN")
    if arguments.directory is not None:
        yield arguments.directory
        return
    from apad_bridge.console.mirror import mirrored
    from apad_bridge.ros.remote_run import Unheard, find_run

    with ExitStack() as stack:
        try:
            copy = stack.enter_context(mirrored(find_run(arguments.apad), Unheard))
        except (PeerFailed, Unheard) as error:
            print(f"musselbed {arguments.command}: {error}", file=sys.stderr)
            raise SystemExit(Exit.PEER_FAILED) from error
        yield copy


def add_run_options(parser: argparse.ArgumentParser) -> Callable[[argparse.Namespace], Service | None]:
    """Adds the argument by which `musselbed run` has a console beside it; returns the maker of what was asked for."""
    parser.add_argument(
        "--console",
        action="store_true",
        help="serve a live page of the run to a browser on this machine, and print its address",
    )
    return lambda arguments: console_service() if arguments.console else None


def console_service() -> Service:
    """A console beside a run; its address is the page's. It ends after its pages have the run's summary."""
    from apad_bridge.console.process import TOKEN_VARIABLE
    from apad_bridge.runs.watched_services import Service

    def again(line: str) -> tuple[tuple[str, ...], dict[str, str]]:
        url = urlsplit(_url(line))
        return ("--port", str(url.port)), {TOKEN_VARIABLE: url.query.removeprefix("token=")}

    return Service("console", ("--json",), _LAST_PAGE_S, again, _url, "live page: ")


def _url(line: str) -> str:
    url: str = json.loads(line)["url"]
    return url
