"""`musselbed shadow SCENARIO.yaml`: somebody else's mission, live or from a bag: their decisions beside ours."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from apad_bridge.commands.fly.run import namespace_of_shell
from apad_bridge.commands.help_text import STRATEGY, ending
from apad_bridge.commands.trust import add_trust_argument, trust_of_looked_at
from apad_bridge.events.mission_events import MissionChanged, Phase
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.progress import WorkProgress
from apad_bridge.runs.rich_console import Console, print_result, table_of
from apad_bridge.scenario.errors import UserError

if TYPE_CHECKING:
    from apad_bridge.field.field_log.log_facts import EventReport, LoggedFact
    from apad_bridge.field.field_log.reader import FactReader
    from apad_bridge.field.shadow.compared import ComparedDecision, TheirMove
    from apad_bridge.field.shadow.shadow import Shadow
    from apad_bridge.scenario.schema import Scenario

_WAIT_S = 0.2


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "shadow",
        description="Follows a mission of somebody else's and only listens: it publishes nothing, calls no service and "
        "sends no goal. At each of their decisions it says what the scenario's strategy would have done, on our beliefs of "
        "their aMussels. Later packets tell how far each estimate was wrong.",
        epilog=ending(
            "musselbed shadow launch_scripts/scenarios/real-apad.yaml whole.bag",
            "musselbed shadow launch_scripts/scenarios/real-apad.yaml --strategy greedy --for 3600",
            note="Without a bag it listens on the master at ROS_MASTER_URI. See docs/mixing.md.",
        ),
    )
    parser.add_argument(
        "scenario", type=Path, metavar="SCENARIO.yaml", help="names the aPad and its aMussels"
    )
    parser.add_argument(
        "bag", type=Path, nargs="?", metavar="BAG", help="a bag of the mission (default: listen)"
    )
    parser.add_argument(
        "--strategy", metavar=STRATEGY, help="another collection strategy than the scenario's"
    )
    parser.add_argument(
        "--for",
        dest="for_s",
        type=float,
        metavar="S",
        help="listen for so many seconds (default: until Ctrl-C)",
    )
    add_trust_argument(parser)
    parser.add_argument("--json", action="store_true", help="print a JSON object at the end")


def run(arguments: argparse.Namespace) -> int:
    from apad_bridge.field.shadow.shadow import Shadow
    from apad_bridge.mission.policy.plan_checks import StrategyFailed
    from apad_bridge.scenario.flight_readiness import check_code
    from apad_bridge.scenario.loader import load, with_overrides

    if arguments.bag is not None and arguments.for_s is not None:
        raise UserError("--for is for listening: leave it or the bag out")
    code = Exit.DONE
    try:
        scenario = with_overrides(load(arguments.scenario), strategy=arguments.strategy)
        trust = trust_of_looked_at(arguments, *filter(None, [arguments.strategy]))
        check_code(scenario, str(arguments.scenario), trust)
        shadow = Shadow(scenario, trust)
        if arguments.bag is not None:
            with WorkProgress(arguments.json) as progress:
                progress.step(f"reading {arguments.bag}")
                missing = _read(arguments.bag, scenario, shadow)
        else:
            code, missing = _listen(scenario, shadow, arguments)
        shadow.end()
    except StrategyFailed as error:
        print(f"musselbed shadow: {error}", file=sys.stderr)
        return Exit.PEER_FAILED
    print_result(
        arguments.json,
        {
            "strategy": scenario.mission.collection,
            "decisions": [asdict(it) | {"agrees": it.agrees} for it in shadow.decisions],
            "agreed": sum(it.agrees for it in shadow.decisions),
            "accuracy": asdict(shadow.accuracy),
            "notes": missing,
        },
        lambda: _show(shadow, scenario.mission.collection, missing, Console()),
    )
    return code


def _read(bag: Path, scenario: Scenario, shadow: Shadow) -> list[str]:
    from apad_bridge.field.field_log.reader import facts_of

    facts, missing = facts_of(bag, scenario.apad.name, namespace_of_shell())
    for fact in facts:
        shadow.take(fact)
    return missing


def _listen(scenario: Scenario, shadow: Shadow, arguments: argparse.Namespace) -> tuple[Exit, list[str]]:
    from apad_bridge.field.field_log.reader import FactReader
    from apad_bridge.ros.system.route import somebodys_master

    reader = FactReader(somebodys_master(), scenario.apad.name, namespace_of_shell())
    code = Exit.DONE
    try:
        for fact in _heard(reader, scenario, arguments.for_s):
            for decision in shadow.take(fact):
                if not arguments.json:
                    print(_line(decision), flush=True)
    except KeyboardInterrupt:
        code = Exit.INTERRUPTED
    return code, list(reader.missing.values())


def _heard(reader: FactReader, scenario: Scenario, for_s: float | None) -> Iterator[LoggedFact]:
    """The facts of the graph until the time is over, or a supervisor's mission ends."""
    from apad_bridge.field.field_log.log_facts import EventReport
    from apad_bridge.ros.graph_listener import GraphListener

    until_s = None if for_s is None else time.monotonic() + for_s
    topics = [*reader.topics, *reader.amussel_topics(scenario.fleet.ids)]
    with closing(GraphListener(topics, "musselbed_shadow")) as listener:
        print("listening", file=sys.stderr, flush=True)
        while until_s is None or time.monotonic() < until_s:
            for message in listener.take(_WAIT_S):
                for fact in reader.read(message):
                    yield fact
                    if isinstance(fact, EventReport) and _ends(fact):
                        return


def _ends(event: EventReport) -> bool:
    return event.kind == MissionChanged.kind and event.data.get("phase") == Phase.ENDED


def _line(decision: ComparedDecision) -> str:
    verdict = "the same" if decision.agrees else f"ours: {_text(decision.ours)}"
    return f"{decision.at_s:.0f} s  theirs: {_text(decision.theirs)}; {verdict}"


def _text(move: TheirMove) -> str:
    return str(move.kind) if move.agent_id is None else f"{move.kind} {move.agent_id}"


def _show(shadow: Shadow, strategy: str, missing: list[str], console: Console) -> None:
    for note in missing:
        console.print(f"note: {note}", highlight=False, markup=False, soft_wrap=True)
    table = table_of(
        f"Their decisions beside those of {strategy} on our beliefs",
        ("s", "theirs", "ours", "agree", "believed charge", "age s", "charge error", "place error m"),
        left=("theirs", "ours", "agree"),
        title_justify="left",
    )
    for it in shadow.decisions:
        estimate = it.estimate
        cells = ["", "", "", ""]
        if estimate is not None:
            cells[:2] = f"{estimate.charge:.3f}", f"{estimate.age_s:.0f}"
        if estimate is not None and estimate.charge_error is not None and estimate.place_error_m is not None:
            cells[2:] = f"{estimate.charge_error:+.4f}", f"{estimate.place_error_m:.2f}"
        table.add_row(
            f"{it.at_s:.0f}", _text(it.theirs), _text(it.ours), "yes" if it.agrees else "no", *cells
        )
    console.print(table)
    agreed, accuracy = sum(it.agrees for it in shadow.decisions), shadow.accuracy
    console.print(f"{agreed} of {len(shadow.decisions)} decisions agree", highlight=False)
    if accuracy.charge_rms is not None and accuracy.place_rms_m is not None:
        inside = (
            "" if accuracy.inside is None else f"; {100 * accuracy.inside:.0f} % of charges inside our 95 %"
        )
        console.print(
            f"{accuracy.packets} packets after 10 s of silence or more: our estimate was off by "
            f"{accuracy.charge_rms:.4f} of a charge and {accuracy.place_rms_m:.2f} m, root mean square{inside}",
            highlight=False,
            soft_wrap=True,
        )
