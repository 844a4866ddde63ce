"""`musselbed capacity`: what no strategy can exceed in a scenario, and how many aMussels its aPads sustain."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.runs.exits import Exit


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "capacity",
        description="Prints bounds that follow from the batteries, the docks and the duty cycle alone. No strategy exceeds "
        "them, because they exclude travel, docking and waiting. docs/studies.md derives them.",
        epilog=ending(
            "musselbed capacity launch_scripts/scenarios/pool-12.yaml",
            "musselbed capacity launch_scripts/scenarios/bay-24.yaml --agents 12 --json",
        ),
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO.yaml")
    parser.add_argument(
        "--theta", type=int, metavar="N", help="run the aMussels' time N times as fast as the aPad's"
    )
    parser.add_argument("--agents", type=int, metavar="N", help="another number of aMussels")
    parser.add_argument("--seed", type=int, metavar="N", help="another seed")
    parser.add_argument(
        "--json", action="store_true", help="print the bounds as JSON on stdout, nothing else"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.assembly.capacity import bounds_of
    from apad_bridge.scenario.loader import load, with_overrides

    scenario = with_overrides(
        load(arguments.scenario), theta=arguments.theta, agents=arguments.agents, seed=arguments.seed
    )
    bounds = bounds_of([scenario])
    if arguments.json:
        print(json.dumps(asdict(bounds)))
        return Exit.DONE
    print(f"{scenario.name}: {bounds.text}")
    if bounds.cycles_per_apad_charge is not None:
        print(
            f"a full aPad fills the whole fleet from empty {bounds.cycles_per_apad_charge:.2f} times, without its travel"
            + (
                ""
                if scenario.theta == 1
                else f"; at theta {scenario.theta} that is {scenario.theta} times too often"
            )
        )
    return Exit.DONE
