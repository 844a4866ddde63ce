"""`musselbed capacity`: upper bounds of a scenario's uptime, activity and samples, and of the fleet its docks sustain."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apad_bridge.commands.help_text import ending
from apad_bridge.commands.trust import add_trust_argument, trust_of_looked_at
from apad_bridge.runs.exits import Exit
from apad_bridge.scenario.errors import UserError

if TYPE_CHECKING:
    from apad_bridge.planning.registry import Trust
    from apad_bridge.scenario.schema import Scenario
    from apad_bridge.studies.capacity_diagram import SizedFlights

_SEEDS = (1, 2, 3)


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "capacity",
        description="Prints bounds that follow from the batteries, the docks and the duty cycle alone. No strategy exceeds "
        "them, because they exclude travel, docking and waiting. Whole boards have two: a strategy that times its services "
        "to skip wakes may exceed the first. docs/studies.md derives them. A fleet that begins with low charges may stay "
        "below them for ever: --fly tells from which start charge this fleet is held.",
        epilog=ending(
            "musselbed capacity pool-12",
            "musselbed capacity pool-12 --fly",
            "musselbed capacity bay-24 --agents 12 --json",
        ),
    )
    parser.add_argument(
        "scenario", type=Path, metavar="SCENARIO.yaml", help="its file, or the name of a shipped one: pool-12"
    )
    parser.add_argument(
        "--theta", type=int, metavar="N", help="run the aMussels' time N times as fast as the aPad's"
    )
    parser.add_argument(
        "--agents", type=int, metavar="N", help="number of aMussels, instead of the scenario's"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed, instead of the scenario's")
    parser.add_argument(
        "--json", action="store_true", help="print the bounds as JSON on stdout, nothing else"
    )
    parser.add_argument(
        "--fly",
        action="store_true",
        help="fly ten days of the aMussels' time from seven mean start charges, by the scenario's own rules: a minute",
    )
    add_trust_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.assembly.capacity_bounds import bounds_of
    from apad_bridge.scenario.loader import load, with_overrides

    scenario = with_overrides(
        load(arguments.scenario), theta=arguments.theta, agents=arguments.agents, seed=arguments.seed
    )
    bounds = bounds_of([scenario])
    phases = _flown(scenario, trust_of_looked_at(arguments)) if arguments.fly else []
    if arguments.json:
        print(json.dumps({**asdict(bounds), "phases": [asdict(it) for it in phases]}))
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
    if phases:
        _print_phases(phases)
    elif bounds.sustained_from_empty < bounds.amussels <= bounds.sustained:
        print(
            f"{bounds.sustained:.1f} is a bound and no promise: more than {bounds.sustained_from_empty:.1f} aMussels that "
            "begin low stay low. From which start charge this fleet is held: --fly"
        )
    return Exit.DONE


def _flown(scenario: Scenario, trust: Trust | None) -> list[SizedFlights]:
    from apad_bridge.mission.policy.plan_checks import StrategyFailed
    from apad_bridge.scenario.flight_readiness import check_code
    from apad_bridge.studies.capacity_diagram import diagram_of
    from apad_bridge.studies.event_driven import model_gap

    if not scenario.fleet.ids:
        raise UserError("--fly: the scenario has no aMussels")
    if (gap := model_gap(scenario)) is not None:
        raise UserError(f"--fly: the event-driven model leaves out {gap}")
    check_code(scenario, scenario.name, trust)
    try:
        return diagram_of(scenario, _SEEDS, trust)
    except StrategyFailed as failed:
        raise UserError(f"--fly: the strategy failed: {failed}") from failed


def _print_phases(phases: Sequence[SizedFlights]) -> None:
    from apad_bridge.studies.capacity_diagram import held_from

    for it in phases:
        print(
            f"from a mean charge of {it.start_charge:g}: {it.held} of {it.flown} flights held, "
            f"{it.uptime_percent:.1f} % uptime"
        )
    if (least := held_from(phases)) is None:
        print(f"no start holds this fleet for ever, up to a mean charge of {phases[-1].start_charge:g}")
    else:
        print(f"the fleet is held for ever from a mean charge of {least:g} at the start")
