"""One supervisor's flight, from the parts that the options name to the summary on disk.

A flight in virtual time with the supervisor and the simulated aPad in this process, and with its records.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.hosting.in_process import OneProcess
from agents.hosting.process_host import ProcessHost
from apad_bridge.assembly import parts
from apad_bridge.assembly.water import fleet_of
from apad_bridge.mission.call_queue import CalledFront
from apad_bridge.mission.manual import Front
from apad_bridge.mission.state import MissionState
from apad_bridge.records.recorder import Recorder
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.summary import Ending
from apad_bridge.runs import flying
from apad_bridge.runs.nurseries import FOLDER
from apad_bridge.runs.progress import Shows
from apad_bridge.runs.status import Status
from apad_bridge.scenario.schema import Hosting, Scenario
from apad_bridge.scenario.starts import Start
from apad_bridge.supervisor.clock import AsFastAsPossible
from apad_bridge.supervisor.context import Announce, Known, Surroundings
from apad_bridge.supervisor.core import TICK_MS, Supervisor
from apad_bridge.supervisor.fleet import Fleet
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.sample_collection import SampleCollection
from apad_bridge.vehicle.commands import DockClosed
from apad_bridge.vehicle.link import InProcessVehicle
from apad_bridge.vehicle.primitives import PrimitiveFailed


def fly_here(
    scenario: Scenario,
    starts: Sequence[Start],
    directory: RunDirectory,
    progress: Shows,
    fronts: Sequence[Front] = (),
) -> dict[str, Any]:
    """Flies to the end and gives the summary."""
    recorder = Recorder(directory, scenario, parts.agent_ids(scenario))
    flying.journal_start(recorder, scenario, starts)
    fleet = flying.open_fleet(scenario, starts, directory.path / FOLDER)
    try:
        course = flying.Course(fronts=tuple(fronts))
        return flying.fly(scenario, flying.in_process(scenario, fleet), recorder, progress.show, course)
    finally:
        recorder.close()
        fleet.host.close()


JOURNAL_FORMAT = 1
_COMMAND_IDS_PER_EPOCH = 1_000_000


@dataclass(frozen=True, slots=True)
class GoOn:
    """Where a resumed flight goes on: what the journal last said."""

    now_ms: int
    state: MissionState
    epoch: int
    apad_fraction_at_start: float | None
    first_failure: PrimitiveFailed | None = None
    """As the port had latched it."""


@dataclass(frozen=True, slots=True)
class Course:
    """What of a mission a flight flies: from where, by whose orders, and how far."""

    go_on: GoOn | None = None
    """None: from its beginning."""
    known: Known | None = None
    """What was learned already; None for nothing."""
    fronts: tuple[Front, ...] = ()
    """With any there is no mission of our own: the aPad does what these order."""
    override: CalledFront | None = None
    """By which the mission can be taken over."""
    until_first_plan: bool = False
    """Ends with the first plan instead of the mission."""

    @property
    def start_ms(self) -> int:
        """The mission time of the flight's first tick."""
        return 0 if self.go_on is None else self.go_on.now_ms + TICK_MS


ANEW = Course()
"""The scenario's own mission, from its beginning to its end."""


def open_fleet(scenario: Scenario, starts: Sequence[Start], folder: Path) -> Fleet:
    """A new fleet, hosted as the scenario says; a process per aMussel keeps its files in `folder`."""
    config, births = parts.fleet_config(scenario), parts.births(scenario, starts)
    if scenario.fleet.hosting is Hosting.ONE_PROCESS:
        host: OneProcess | ProcessHost = OneProcess(config, births)
    else:
        folder.mkdir()
        host = ProcessHost.start(str(folder), config, births)
    return fleet_of(scenario, host, dict.fromkeys(births, 0))


def in_process(scenario: Scenario, fleet: Fleet) -> Surroundings:
    """Virtual time with the simulated aPad in this process."""
    return Surroundings(InProcessVehicle(parts.simulated_apad(scenario)), AsFastAsPossible(), fleet)


def fly(
    scenario: Scenario,
    surroundings: Surroundings,
    recorder: Recorder,
    show: Callable[[Status], None],
    course: Course = ANEW,
) -> dict[str, Any]:
    """Flies its course to the end, and gives the summary. SIGINT and SIGTERM end it in order."""
    flying = prepare(scenario, surroundings, recorder, show, course)
    with stopped_by_signals(flying.flight):
        flying.flight.run()
    return flying.finish()


@contextmanager
def stopped_by_signals(*flights: Flight) -> Iterator[None]:
    """SIGINT and SIGTERM end them in order."""

    def stop(*_: object) -> None:
        for flight in flights:
            flight.stop("the operator")

    with ExitStack() as stack:
        for number in (signal.SIGINT, signal.SIGTERM):
            stack.callback(signal.signal, number, signal.signal(number, stop))
        yield


@dataclass(frozen=True, slots=True)
class Prepared:
    """A flight that is ready to be flown, and what makes its summary."""

    flight: Flight
    finish: Callable[[], dict[str, Any]]
    """After its end: writes the last of its records, and gives the summary."""


def prepare(
    scenario: Scenario,
    surroundings: Surroundings,
    recorder: Recorder,
    show: Callable[[Status], None],
    course: Course = ANEW,
) -> Prepared:
    """What `fly` flies."""
    supervisor = _supervisor(scenario, surroundings, recorder, course)

    def show_tick(now_ms: int) -> None:
        show(Status.of(supervisor, now_ms, surroundings.pace.behind_s))
        if course.until_first_plan and supervisor.mission.state.plan.steps:
            flight.stop("the dry run's plan")

    told = recorder if surroundings.announce is None else _Announced(recorder, surroundings.announce)
    flight = Flight(supervisor, surroundings, told, course.start_ms, (show_tick,))
    recorder.dropped_in_flight = lambda: flight.all_dropped

    def finish() -> dict[str, Any]:
        recorder.event(flight.now_ms, "end", reason=flight.ended_by)
        return recorder.finish(flight.now_ms, _ending(flight, course.go_on))

    return Prepared(flight, finish)


def _supervisor(
    scenario: Scenario, surroundings: Surroundings, recorder: Recorder, course: Course
) -> Supervisor:
    """With the docks as the journal last had them."""
    go_on = course.go_on
    supervisor = parts.supervisor(
        scenario,
        None if go_on is None else go_on.state,
        first_command_id=1 + (0 if go_on is None else go_on.epoch * _COMMAND_IDS_PER_EPOCH),
        samples=_collection(scenario, surroundings, recorder),
        fronts=course.fronts,
        override=course.override,
        # The aPad's modem is where its water is: with the fleet, and not with a mission alone.
        has_modem=surroundings.fleet is not None,
        docks_by_eye=surroundings.docks_by_eye,
        breakdown=surroundings.breakdown,
        share=surroundings.share,
        known=course.known,
    )
    if go_on is not None:
        supervisor.port.first_failure = go_on.first_failure
        for slot, agent_id in go_on.state.docked:
            supervisor.port.docks.take(DockClosed(go_on.now_ms, slot, agent_id))
    return supervisor


def _ending(flight: Flight, go_on: GoOn | None) -> Ending:
    supervisor = flight.supervisor
    failure = supervisor.port.first_failure
    return Ending(
        ended_by=flight.ended_by,
        first_cause=None if failure is None else failure.reason,
        cost_m=supervisor.mission.state.cost_m,
        services=supervisor.mission.state.services,
        apad_energy_fraction=_fraction_used(supervisor, go_on),
        dropped=flight.all_dropped,
        samples_gone={} if supervisor.samples is None else supervisor.samples.gone,
    )


class _Announced:
    """The records, and a listener that hears the same events."""

    def __init__(self, recorder: Recorder, announce: Announce) -> None:
        self.truths = recorder.truths
        self.samples = recorder.samples
        self.tick = recorder.tick
        self._recorder = recorder
        self._announce = announce

    def event(self, at_ms: int, kind: str, **data: Any) -> None:
        self._recorder.event(at_ms, kind, **data)
        self._announce(at_ms, kind, **data)


def journal_start(recorder: Recorder, scenario: Scenario, starts: Sequence[Start]) -> None:
    """The journal's first line: what a reader needs before anything else."""
    recorder.event(
        0,
        "run",
        format=JOURNAL_FORMAT,
        scenario=scenario.name,
        theta=scenario.theta,
        seed=scenario.seed,
        duration_s=scenario.duration_s,
        pool_threshold=scenario.mission.pool_threshold,
        full_threshold=scenario.mission.full_threshold,
        agents=[
            {
                "id": start.agent_id,
                "north_m": start.north_m,
                "east_m": start.east_m,
                "primary": start.primary,
                "secondary": start.secondary,
            }
            for start in starts
        ],
    )


def _collection(
    scenario: Scenario, surroundings: Surroundings, recorder: Recorder
) -> SampleCollection | None:
    if not surroundings.keeps_samples:
        return None
    return SampleCollection(parts.agent_ids(scenario), recorder.samples_kept)


def _fraction_used(supervisor: Supervisor, go_on: GoOn | None) -> float | None:
    if supervisor.battery is None or supervisor.battery_at_start is None:
        return None
    at_start = supervisor.battery_at_start.fraction
    if go_on is not None and go_on.apad_fraction_at_start is not None:
        at_start = go_on.apad_fraction_at_start
    return at_start - supervisor.battery.fraction
