"""Faults in flights in virtual time, each by itself and in seeded mixes: which laws of a run they break.

The faults are the rows of docs/faults.md, and the laws those of `musselbed check`. In a mix the supervisor is killed
several times, each time with stimuli under way, and another goes on from the journal with the same aMussels. A mix that
breaks a law is flown again with fewer and fewer of its faults, until each that is left is needed for that.
"""

from __future__ import annotations

import shutil
import tempfile
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.table import Table

from agents.hosting.in_process import InProcessHost
from apad_bridge.analysis.invariants import check_run
from apad_bridge.assembly import fleet_parts, parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.assembly.safety import safety_of
from apad_bridge.events.fleet import FaultBegan, Stimulated
from apad_bridge.records.journal import JournalTail, read_journal
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import PreparedFlight, RunSpec, prepare
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.runs.resuming import begin_run, ongoing_faults, resume_run
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.timed_faults import TABLE, FaultAt, FaultMix, Faults, Injection, TimedFault, planned
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.contacts import Contacts
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.vehicle.link import InProcessVehicle
from benchmarks.rows import told

SCENARIOS = Path(__file__).parents[1] / "launch_scripts" / "scenarios"
SCENARIO, WITH_SOUND = SCENARIOS / "pool-12.yaml", SCENARIOS / "sound-12.yaml"
"""Every second mix is flown in water, with whole boards."""
FLIGHT_S, SHORT_S = 900, 120
TRIES, SHORT_TRIES = 10, 2
SEED = 20261122
KILLS = 7
"""Kills of the supervisor in a mix."""
_FAULTS_OF_A_MIX = 60
_EVERY_S = 2

Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class Outcome:
    """A flight under the faults: the number that happened, and the laws that its records break."""

    happened: int
    broken: tuple[str, ...]
    killed: int = 0
    """The number of supervisors that were killed."""


def in_one_process(path: Path, flight_s: int = FLIGHT_S) -> Scenario:
    whole = load(path)
    return replace(whole, duration_s=flight_s, fleet=replace(whole.fleet, hosting=Hosting.ONE_PROCESS))


def flown(scenario: Scenario, faults: Sequence[FaultAt], kills: int = 0) -> Outcome:
    """Flies the scenario in this process with these faults, and checks its records. An exception breaks a law, too.

    The supervisor is killed and resumed up to `kills` times, each time after a tick that queued stimuli.
    """
    scenario = replace(scenario, faults=Faults(at=tuple(faults)))
    with tempfile.TemporaryDirectory(prefix="chaos-") as folder, ExitStack() as stack:
        directory, starts = RunDirectory(Path(folder) / "run"), starts_of(scenario)
        directory.path.mkdir()
        directory.write_inputs(scenario, starts)
        progress = stack.enter_context(FlightProgress(scenario.name, scenario.duration_ms, quiet=True))
        try:
            supervisors = _Supervisors(scenario, progress, stack)
            flying = supervisors.begin(directory)
            for n in range(1, kills + 1):
                if not _stimulated(flying, directory, 1000 * scenario.duration_s * n / (kills + 1)):
                    break
                left = RunDirectory(directory.path.with_name(f"resumed-{n}"))
                shutil.copytree(directory.path, left.path)  # what a kill leaves: closing would write more
                flying.recorder.close()
                directory, flying = left, supervisors.begin(left)
            if not flying.flight.supervisor.has_ended:
                flying.flight.run()
            flying.finish()
        except Exception as error:  # the very thing that is looked for
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(frame.filename).name}, line {frame.lineno}"
            return Outcome(0, (f"no exception: {type(error).__name__}: {error} ({where})",))
        broken = tuple(f"{it.rule}: {it.reason}" for it in check_run(directory))
        lines = read_journal(directory.journal).lines
    happened = sum(it["kind"] == FaultBegan.kind and "refused" not in it for it in lines)
    return Outcome(happened, broken, supervisors.begun - 1)


def _stimulated(flying: PreparedFlight, directory: RunDirectory, due_ms: float) -> bool:
    """Flies to the first tick from `due_ms` on that queues a stimulus; False if the flight ends before."""
    with closing(JournalTail(directory.journal)) as tail:
        while not flying.flight.step():
            queued = any(it["kind"] == Stimulated.kind for it in tail.read_new().lines)
            if queued and flying.flight.now_ms > due_ms:
                return True
    return False


class _Supervisors:
    """Makes one supervisor after the other for the same aMussels and the same aPad, which live on when one is killed."""

    def __init__(self, scenario: Scenario, progress: FlightProgress, stack: ExitStack) -> None:
        self.begun = 0
        self._scenario, self._progress, self._stack = scenario, progress, stack
        self._config = flight_config(scenario)
        bodies = fleet_parts.initial_states(scenario, starts_of(scenario))
        self._host = InProcessHost(fleet_parts.fleet_config(self._config), bodies)
        self._vehicle = InProcessVehicle(parts.simulated_apad(scenario))
        self._granted_ms: Mapping[int, int] = dict.fromkeys(bodies, 0)

    def begin(self, directory: RunDirectory) -> PreparedFlight:
        """The next supervisor's flight; a second one goes on from the files in the directory."""
        config = self._config
        options = RunOptions(
            *(BenchPart.WHOLE, APadKind.SIM, TimeSource.ASAP, 1.0, OnDeath.WAIT),
            owns_master=True,
            epoch=self.begun + 1,
        )
        if self.begun:
            state = resume_run(directory, config, options, lambda line: None)
        else:
            state = begin_run(directory, config, options)
        self.begun += 1
        self._stack.callback(state.recorder.close)
        fleet = fleet_parts.fleet_of(config, self._host, self._granted_ms, state.start_ms)
        self._granted_ms = fleet.coordinator.granted_ms
        state = state.deliver_again(fleet.coordinator)
        last_ms = state.journal.last_ms if state.journal.lines else -1
        context = FlightContext(
            vehicle=self._vehicle,
            pace=AsFastAsPossible(),
            fleet=fleet,
            safety=safety_of(self._scenario),
            contacts=Contacts(state.held),
            faults=parts.fault_injection(config, fleet, last_ms, ongoing_faults(state.journal)),
        )
        state.recorder.begin_checkpoint(state.learned, state.start_ms)
        spec = RunSpec(state.resume_point, state.learned)
        return prepare(config, context, state.recorder, self._progress, spec)


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


def measure(tries: int = TRIES, short: bool = False) -> dict[str, Any]:
    """Each fault by itself, and so many mixes. A row that broke a law has the faults that it needs for that."""
    tries, flight_s = (SHORT_TRIES, SHORT_S) if short else (tries, FLIGHT_S)
    pool, sound = in_one_process(SCENARIO, flight_s), in_one_process(WITH_SOUND, flight_s)
    ids = pool.fleet.ids
    faults = [it for it in TimedFault if not TABLE[it].needs_process]
    rows = [_row(f"{it} alone", pool, alone(it, ids)) for it in faults]
    for n in range(tries):
        scenario = sound if n % 2 else pool
        story = mixed(SEED + n, scenario.fleet.ids)
        rows.append(_row(f"mix, seed {SEED + n}, {scenario.name}", scenario, story, KILLS))
    return {"flight_s": flight_s, "rows": rows}


def _row(name: str, scenario: Scenario, story: Sequence[FaultAt], kills: int = 0) -> dict[str, Any]:
    outcome = flown(scenario, story, kills)
    needed = shrunk(story, lambda part: bool(flown(scenario, part, kills).broken)) if outcome.broken else []
    row: dict[str, Any] = {
        "story": name,
        "asked": len(story),
        "happened": outcome.happened,
        "killed": outcome.killed,
        "broken": list(outcome.broken[:5]),
        "needed": [
            f"{it.fault} of {'the aPad' if it.id is None else f'aMussel {it.id}'} at {it.at_s:g} s"
            for it in needed
        ],
    }
    return told(row)


def show(result: dict[str, Any], console: Console) -> None:
    table = Table("faults", "asked for", "happened", "supervisors killed", "laws broken")
    for row in result["rows"]:
        figures = (row["asked"], row["happened"], row["killed"], len(row["broken"]))
        table.add_row(row["story"], *map(str, figures))
    console.print(table)
    for row in result["rows"]:
        if row["broken"]:
            console.print(f"{row['story']}: {'; '.join(row['broken'])}; needs {', '.join(row['needed'])}")
