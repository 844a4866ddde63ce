"""The process that owns the sea of a run with several aPads over ROS.

    python -m apad_bridge.runs.several.sea_process RUN

It serves the sea in the run's directory, prints a line once it does, and ends when no supervisor has been there for ten
minutes. It has no state to save: packets in the water are lost with it.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from agents.hosting.started import outlive_starter
from agents.water import sea_link
from agents.water.sea_server import SeaServer
from apad_bridge.assembly.fleet_parts import shared_sea
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.scenario.loader import load


def main() -> int:
    parser = argparse.ArgumentParser(
        description="The sea of one run with several aPads; started by musselbed, not by hand."
    )
    parser.add_argument("run", type=Path)
    path: Path = parser.parse_args().run
    scenario = load(RunDirectory(path).scenario)
    names = scenario.apad_names
    sea = shared_sea(scenario, len(names))
    if sea is None:
        parser.error(f"{path}: no water that several aPads share")
    with sea_link.listen(str(path)) as listener:
        print("the sea is served", flush=True)
        outlive_starter()
        SeaServer(sea, names, listener).run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
