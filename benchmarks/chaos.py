"""Faults in flights in virtual time, each by itself and in seeded mixes: which laws of a run they break.

The faults are the rows of docs/faults.md, and the laws those of `musselbed check`. A mix that breaks a law is flown again
with fewer and fewer of its faults, until each that is left is needed for that.
"""

from __future__ import annotations

import json
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.table import Table

from apad_bridge.analysis.invariants import check_run
from apad_bridge.records.event_kinds import EventKind
from apad_bridge.records.journal import read_journal
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import open_in_process
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.timed_faults import TABLE, FaultAt, FaultMix, Faults, Injection, TimedFault, planned

SCENARIOS = Path(__file__).parents[1] / "launch_scripts" / "scenarios"
SCENARIO, WITH_SOUND = SCENARIOS / "pool-12.yaml", SCENARIOS / "sound-12.yaml"
"""Every second mix is flown in water, with whole boards."""
FLIGHT_S = 900
TRIES = 10
SEED = 20261122
_FAULTS_OF_A_MIX = 60
_EVERY_S = 2

Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class Outcome:
    """A flight under the faults: the number that happened, and the laws that its records break."""

    happened: int
    broken: tuple[str, ...]


def in_one_process(path: Path, flight_s: int = FLIGHT_S) -> Scenario:
    whole = load(path)
    return replace(whole, duration_s=flight_s, fleet=replace(whole.fleet, hosting=Hosting.ONE_PROCESS))


def flown(scenario: Scenario, faults: Sequence[FaultAt]) -> Outcome:
    """Flies the scenario in this process with these faults, and checks its records. An exception breaks a law, too."""
    scenario = replace(scenario, faults=Faults(at=tuple(faults)))
    with tempfile.TemporaryDirectory(prefix="chaos-") as folder, ExitStack() as stack:
        directory, starts = RunDirectory(Path(folder)), starts_of(scenario)
        directory.write_inputs(scenario, starts)
        progress = stack.enter_context(
            FlightProgress(scenario.name, round(1000 * scenario.duration_s), quiet=True)
        )
        try:
            prepared = open_in_process(stack, scenario, starts, directory, progress)
            prepared.flight.run()
            prepared.finish()
        except Exception as error:  # the very thing that is looked for
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(frame.filename).name}, line {frame.lineno}"
            return Outcome(0, (f"no exception: {type(error).__name__}: {error} ({where})",))
        broken = tuple(f"{it.law}: {it.reason}" for it in check_run(directory))
        lines = read_journal(directory.journal).lines
    happened = sum(it["kind"] == EventKind.FAULT and "refused" not in it for it in lines)
    return Outcome(happened, broken)


def alone(fault: TimedFault, ids: Sequence[int]) -> list[FaultAt]:
    """The same fault of one aMussel after the other, or of the aPad again and again."""
    if TABLE[fault].is_of_apad:
        return [
            FaultAt(fault=fault, at_s=at_s) for at_s in range(10, FLIGHT_S, 2 * round(TABLE[fault].span_s))
        ]
    return [
        FaultAt(fault=fault, at_s=at_s, id=ids[at_s // _EVERY_S % len(ids)])
        for at_s in range(0, FLIGHT_S, _EVERY_S)
    ]


def mixed(seed: int, ids: Sequence[int]) -> list[FaultAt]:
    """Bursts of faults: several of one aMussel in a row, or of several within a tick; as a scenario's `faults.mix`."""
    mix = Faults(mix=FaultMix(seed=seed, count=_FAULTS_OF_A_MIX))
    return [_at(at_ms, it) for at_ms, it in planned(mix, ids, FLIGHT_S, processes=False)]


def _at(at_ms: int, it: Injection) -> FaultAt:
    return FaultAt(fault=it.fault, at_s=at_ms / 1000, id=it.agent_id)


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
    pool, sound = in_one_process(SCENARIO), in_one_process(WITH_SOUND)
    ids = pool.fleet.ids
    faults = [it for it in TimedFault if not TABLE[it].needs_process]
    rows = [_row(f"{it} alone", pool, alone(it, ids)) for it in faults]
    for n in range(tries):
        scenario = sound if n % 2 else pool
        rows.append(
            _row(f"mix, seed {SEED + n}, {scenario.name}", scenario, mixed(SEED + n, scenario.fleet.ids))
        )
    return {"flight_s": FLIGHT_S, "rows": rows}


def _row(name: str, scenario: Scenario, story: Sequence[FaultAt]) -> dict[str, Any]:
    outcome = flown(scenario, story)
    needed = shrunk(story, lambda part: bool(flown(scenario, part).broken)) if outcome.broken else []
    row = {
        "story": name,
        "asked": len(story),
        "happened": outcome.happened,
        "broken": list(outcome.broken[:5]),
        "needed": [
            f"{it.fault} of {'the aPad' if it.id is None else f'aMussel {it.id}'} at {it.at_s:g} s"
            for it in needed
        ],
    }
    print(json.dumps(row), file=sys.stderr, flush=True)
    return row


def show(result: dict[str, Any], console: Console) -> None:
    table = Table("faults", "asked for", "happened", "laws broken")
    for row in result["rows"]:
        table.add_row(row["story"], str(row["asked"]), str(row["happened"]), str(len(row["broken"])))
    console.print(table)
    for row in result["rows"]:
        if row["broken"]:
            console.print(f"{row['story']}: {'; '.join(row['broken'])}; needs {', '.join(row['needed'])}")
