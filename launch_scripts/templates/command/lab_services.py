"""The number of services of a run."""

import json
from pathlib import Path


def add_parser(commands):
    parser = commands.add_parser("services", description="Prints the number of services of a run.")
    parser.add_argument("directory", type=Path, metavar="RUN")
    parser.set_defaults(run=run)


def run(arguments):
    print(json.loads((arguments.directory / "summary.json").read_text())["services"])
    return 0
