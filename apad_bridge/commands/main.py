"""The command `musselbed`."""

from __future__ import annotations

import argparse
import sys
from importlib.metadata import version

from apad_bridge.commands import doctor, fleet, mission, mu, replay, resume, run
from apad_bridge.commands.exits import EXITS, Exit, UserError


def parser() -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(
        prog="musselbed",
        description="A vehicle-in-the-loop test bench: a real or simulated ROS 1 aPad serves a fleet of simulated "
        "aMussels, each in a process of its own.",
        epilog=f"exit codes: {EXITS}. Start with: musselbed doctor; musselbed run launch_scripts/scenarios/pool-12.yaml "
        "--time asap",
    )
    top.add_argument("--version", action="version", version=f"musselbed {version('musselbed')}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for command in (run, resume, fleet, mission, replay, mu, doctor):
        command.add_parser(commands)
    return top


def main(arguments: list[str] | None = None) -> int:
    chosen = parser().parse_args(arguments)
    try:
        code: int = chosen.run(chosen)
    except UserError as error:
        print(f"musselbed {chosen.command}: {error}", file=sys.stderr)
        return Exit.USER_MISTAKE
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    return code


if __name__ == "__main__":
    sys.exit(main())
