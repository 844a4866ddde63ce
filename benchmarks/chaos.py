"""Faults of aMussels in flights in virtual time, each by itself and in seeded mixes: which laws of a run they break.

The faults are those of /musselbed/inject_fault, and the laws those of `musselbed check`. A mix that breaks a law is flown
again with fewer and fewer of its faults, until each that is left is needed for that.
"""

from __future__ import annotations

import random
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.table import Table

from apad_bridge.analysis.invariants import check_run
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import open_in_process
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Hosting, Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.fleet import NoFleet
from apad_bridge.supervisor.roster import Fault, FaultRequest, Presences, Roster, RosterRequest

SCENARIO = Path(__file__).parents[1] / "launch_scripts" / "scenarios" / "pool-12.yaml"
FLIGHT_S = 900
TRIES = 10
SEED = 20261122
_FAULTS_OF_A_MIX = 60

Item = TypeVar("Item")


@dataclass(frozen=True, slots=True, order=True)
class Injection:
    """A fault of an aMussel in the tick at mission second `at_s`. A coil slips in a dock only."""

    at_s: int
    agent_id: int
    fault: Fault


@dataclass(frozen=True, slots=True)
class Outcome:
    """A flight under the faults: the number that happened, and the laws that its records break."""

    happened: int
    broken: tuple[str, ...]


class _Injector:
    """The roster's source of requests: those of each tick in turn. It counts the ones that were done."""

    def __init__(self, injections: Sequence[Injection]) -> None:
        self.happened = 0
        self._injections = sorted(injections)
        self._ticks = 0

    def ask(self, request: RosterRequest) -> str | None:
        return "nobody else asks here"

    def take(self) -> list[RosterRequest]:
        due = [it for it in self._injections if it.at_s == self._ticks]
        self._ticks += 1
        return [FaultRequest(it.agent_id, it.fault) for it in due]

    def answer(self, request: RosterRequest, refusal: str | None) -> None:
        self.happened += refusal is None


def flown(injections: Sequence[Injection], flight_s: int = FLIGHT_S) -> Outcome:
    """Flies the paper's pool in this process with these faults, and checks its records."""
    whole = load(SCENARIO)
    scenario = replace(whole, duration_s=flight_s, fleet=replace(whole.fleet, hosting=Hosting.ONE_PROCESS))
    injector = _Injector(injections)
    with tempfile.TemporaryDirectory(prefix="chaos-") as folder, ExitStack() as stack:
        directory, starts = RunDirectory(Path(folder)), starts_of(scenario)
        directory.write_inputs(scenario, starts)
        progress = stack.enter_context(FlightProgress(scenario.name, 1000 * flight_s, quiet=True))
        prepared = open_in_process(
            stack, scenario, starts, directory, progress, join=lambda it: _with_roster(it, scenario, injector)
        )
        prepared.flight.run()
        prepared.finish()
        broken = tuple(f"{it.law}: {it.reason}" for it in check_run(directory))
    return Outcome(injector.happened, broken)


def _with_roster(context: FlightContext, scenario: Scenario, injector: _Injector) -> FlightContext:
    assert not isinstance(context.fleet, NoFleet)
    presences = Presences(scenario.fleet.ids, scenario.area.depth_m)
    return replace(context, roster=Roster(presences, injector, context.fleet.coordinator))


def alone(fault: Fault, ids: Sequence[int]) -> list[Injection]:
    """The same fault of one aMussel after the other, every two seconds."""
    return [Injection(at_s, ids[at_s // 2 % len(ids)], fault) for at_s in range(0, FLIGHT_S, 2)]


def mixed(seed: str, ids: Sequence[int]) -> list[Injection]:
    """Bursts of faults: several of one aMussel in a row, or of several within a tick."""
    rng = random.Random(seed)
    injections: set[Injection] = set()
    while len(injections) < _FAULTS_OF_A_MIX:
        at_s, agent_id = rng.randrange(FLIGHT_S), rng.choice(ids)
        for _ in range(rng.randint(1, 6)):
            injections.add(Injection(min(at_s, FLIGHT_S - 1), agent_id, rng.choice(list(Fault))))
            at_s += rng.choice((0, 1, 5))
            agent_id = rng.choice((agent_id, *ids))
    return sorted(injections)


def shrunk(items: Sequence[Item], breaks: Callable[[Sequence[Item]], bool]) -> list[Item]:
    """A part of `items` that still breaks, from which none can be left out alone. It leaves out larger parts first."""
    left, size = list(items), max(1, len(items) // 2)
    while True:
        first, before = 0, len(left)
        while first < len(left):
            fewer = left[:first] + left[first + size :]
            if breaks(fewer):
                left = fewer
            else:
                first += size
        if size == 1 and len(left) == before:
            return left
        size = max(1, size // 2)


def measure(tries: int = TRIES) -> dict[str, Any]:
    """Each fault by itself, and so many mixes. A row that broke a law has the faults that it needs for that."""
    ids = load(SCENARIO).fleet.ids
    stories = {f"{fault} alone": alone(fault, ids) for fault in Fault}
    stories |= {f"mix, seed {SEED + n}": mixed(str(SEED + n), ids) for n in range(tries)}
    return {"flight_s": FLIGHT_S, "rows": [_row(name, story) for name, story in stories.items()]}


def _row(name: str, story: Sequence[Injection]) -> dict[str, Any]:
    outcome = flown(story)
    needed = shrunk(story, lambda part: bool(flown(part).broken)) if outcome.broken else []
    return {
        "story": name,
        "asked": len(story),
        "happened": outcome.happened,
        "broken": list(outcome.broken[:5]),
        "needed": [f"{it.fault} of aMussel {it.agent_id} at {it.at_s} s" for it in needed],
    }


def show(result: dict[str, Any], console: Console) -> None:
    table = Table("faults", "asked for", "happened", "laws broken")
    for row in result["rows"]:
        table.add_row(row["story"], str(row["asked"]), str(row["happened"]), str(len(row["broken"])))
    console.print(table)
    for row in result["rows"]:
        if row["broken"]:
            console.print(f"{row['story']}: {'; '.join(row['broken'])}; needs {', '.join(row['needed'])}")
