"""`musselbed imc RUN`: show a run live on a console that speaks IMC (Neptus), and take its orders."""

from __future__ import annotations

import argparse
import ipaddress
import json
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError

if TYPE_CHECKING:
    from apad_bridge.runs.watched_services import Service

LOOPBACK = "127.0.0.1"
NEPTUS_PORT = 6001
_LAST_PACKETS_S = 3.0
_NO_AUTHENTICATION = (
    "IMC has no authentication: whoever can send from a listed console's address and port can give its orders"
)


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "imc",
        description="Sends the aPad and the aMussels to consoles that speak IMC: places, batteries, states and events. "
        "Writes all its packets into an LSF log in the run's directory. A console that is listed with its IMC "
        f"id may order go-to, station keeping, stop and abort. {_NO_AUTHENTICATION}. Ctrl-C ends this and not the run.",
        epilog=ending(
            "musselbed imc runs/pool-12-1",
            "musselbed imc runs/pool-12-1 --neptus 0x4001@192.168.1.7:6001 --host 192.168.1.5",
        ),
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
    _add_gateway_arguments(parser, "")
    parser.add_argument(
        "--json",
        action="store_true",
        help="print the address, the log and the end as JSON on stdout, a line each",
    )


def add_run_options(parser: argparse.ArgumentParser) -> Callable[[argparse.Namespace], Service | None]:
    """Adds the arguments by which `musselbed run` has a gateway beside it; returns the maker of what was asked for."""
    group = parser.add_argument_group("IMC", "a console that speaks IMC, such as Neptus (docs/neptus.md)")
    group.add_argument(
        "--imc",
        action="store_true",
        help="show the run on such consoles; by default on one of this machine, which gives no orders",
    )
    _add_gateway_arguments(group, "imc-")
    return _asked


def _asked(arguments: argparse.Namespace) -> Service | None:
    """The gateway that `musselbed run` was asked for; None for none.

    UserError for a gateway that cannot be opened so.
    """
    asked: list[str] = []
    for console in arguments.neptus:
        asked += ["--neptus", console]
    if arguments.imc_host != LOOPBACK:
        asked += ["--host", arguments.imc_host]
    if arguments.imc_port is not None:
        asked += ["--port", str(arguments.imc_port)]
    if arguments.imc_multicast:
        asked.append("--multicast")
    if not arguments.imc:
        if asked:
            raise UserError("--neptus, --imc-host, --imc-port and --imc-multicast need --imc")
        return None
    _require_imcpy()
    return imc_service(tuple(asked))


def _add_gateway_arguments(parser: Any, prefix: str) -> None:
    parser.add_argument(
        "--neptus",
        action="append",
        default=[],
        metavar="[ID@]HOST:PORT",
        help="a console; its orders count with its IMC id alone, as 0x4001@127.0.0.1:6001; repeatable "
        f"(default: {LOOPBACK}:{NEPTUS_PORT}, which is shown the run)",
    )
    parser.add_argument(
        f"--{prefix}host",
        default=LOOPBACK,
        metavar="ADDRESS",
        help="the address of this machine's interface to the consoles (default: this machine alone)",
    )
    parser.add_argument(
        f"--{prefix}port",
        type=int,
        metavar="N",
        help="listen on this port (default: by the aPad's IMC id, 6002 for apad1); 0: a free one",
    )
    parser.add_argument(
        f"--{prefix}multicast",
        action="store_true",
        help="announce to 224.0.75.69 too, and show the run to consoles that announce themselves there",
    )


def run(arguments: argparse.Namespace) -> int:
    _require_imcpy()
    from apad_bridge.imc.imc_gateway import GatewaySettings, ImcGateway, serve
    from apad_bridge.imc.wire import ImcConsole

    try:
        consoles = tuple(map(ImcConsole.parse, arguments.neptus or [f"{LOOPBACK}:{NEPTUS_PORT}"]))
    except ValueError as error:
        raise UserError(f"--neptus {error}") from error
    host, port = _interface(arguments.host), arguments.port
    if port is not None and not 0 <= port < 65536:
        raise UserError(f"--port must be 0 to 65535, not {port}")

    def tell(data: dict[str, Any], text: str) -> None:
        print(json.dumps(data) if arguments.json else text, flush=True)

    def listening(gateway: ImcGateway) -> None:
        here, listens_on = gateway.address
        log, apad = gateway.log_folder, gateway.apad
        tell(
            {"listens": f"{here}:{listens_on}", "system": apad.name, "imc_id": apad.imc_id, "log": str(log)},
            f"IMC on {here}:{listens_on}, as {apad.name} ({apad.imc_id:#06x}), "
            f"for {', '.join(map(_console_text, consoles))}; log: {log}",
        )

    try:
        ended_by, dropped = serve(
            arguments.directory,
            GatewaySettings((host, port), consoles, arguments.multicast),
            listening,
            lambda text: print(f"musselbed imc: {text}", file=sys.stderr, flush=True),
        )
    except OSError as error:
        raise UserError(error.strerror or str(error)) from error
    for reason, count in sorted(dropped.items()):
        print(f"musselbed imc: dropped {count} times: {reason}", file=sys.stderr, flush=True)
    if ended_by is not None:
        tell({"ended_by": ended_by}, f"the run has ended: {ended_by}")
    return Exit.DONE


def imc_service(asked: tuple[str, ...]) -> Service:
    """A gateway beside a run, with these arguments of `musselbed imc`."""
    from apad_bridge.runs.watched_services import Service

    return Service("imc", asked, _LAST_PACKETS_S)


def _console_text(console: Any) -> str:
    host, port = console.address
    gives = "gives no orders" if console.imc_id is None else f"gives orders as {console.imc_id:#06x}"
    return f"{host}:{port} ({gives})"


def _interface(text: str) -> str:
    """An address of one interface: it goes into the announcements, so that a console finds the way."""
    try:
        address = ipaddress.IPv4Address(text)
    except ValueError as error:
        raise UserError(
            f"--host {text}: must be the IPv4 address of one interface of this machine"
        ) from error
    if address.is_unspecified or address.is_multicast:
        raise UserError(
            f"--host {text}: name the address of one interface, by which consoles reach this machine"
        )
    return text


def _require_imcpy() -> None:
    if find_spec("imcpy") is None:
        raise UserError(
            "imcpy is not installed (there is none for Python 3.14): run launch_scripts/install, "
            "or pip install 'musselbed[imc]'"
        )
