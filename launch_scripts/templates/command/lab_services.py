"""The number of services of a run."""

import json
from pathlib import Path

from apad_bridge.scenario.errors import UserError


def add_parser(commands):
    parser = commands.add_parser("services", description="Prints the number of services of a run.")
    parser.add_argument("directory", type=Path, metavar="RUN")


def run(arguments):
    """Returns the exit code. A UserError ends the command with its line, and code 2."""
    try:
        print(json.loads((arguments.directory / "summary.json").read_text())["services"])
    except FileNotFoundError as error:
        raise UserError(
            f"{error.filename} is not there: name the directory of a run that has ended"
        ) from error
    return 0
