"""Flies one supervisor's mission, from the parts that the options name to the summary on disk.

`open_in_process` opens one in virtual time, with the supervisor, the simulated aPad and the recorder in this process.
"""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from agents.hosting import interrupts
from agents.hosting.in_process import InProcessHost
from agents.hosting.nursery_client import NurseryDied
from agents.hosting.process_host import ProcessHost
from agents.nursery.launch import NurseryFailed, StartedNursery
from agents.time_scale import MissionMs
from agents.water.sea import Sea
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.capacity_bounds import battery_worth_min
from apad_bridge.assembly.flight_config import FlightConfig
from apad_bridge.assembly.safety import safety_of
from apad_bridge.assembly.scenario_energy_model import energy_model
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import MissionEnd
from apad_bridge.events.run_events import EndReason, RunBegan, RunEnded
from apad_bridge.planning.registry import label
from apad_bridge.records.journal import FORMAT_VERSION
from apad_bridge.records.recorder import Recorder, RecordsFailed
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.summary import Ending
from apad_bridge.runs.display import ProgressDisplay, line_of
from apad_bridge.runs.nurseries import FOLDER, begin_nursery
from apad_bridge.runs.progress_status import RunStatus
from apad_bridge.runs.supervisor_lock import supervising
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts_table import Start
from apad_bridge.supervisor.clock import AsFastAsPossible, ClockLost
from apad_bridge.supervisor.context import Announce, FlightContext
from apad_bridge.supervisor.forecast import Forecast, Forecaster
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.run_spec import FROM_START, ResumePoint, RunSpec
from apad_bridge.supervisor.sample_collection import NoSampleCollection, SampleCollection
from apad_bridge.supervisor.supervisor import Supervisor
from apad_bridge.vehicle.link_errors import PeerFailed
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.simulated_fleet import FlightFleet
from apad_bridge.world.world import World

_EPOCH = 1
"""The number of a fleet's first supervisor."""
SLOW_PLAN_S = 10.0
"""The wall time after which a strategy that still plans is told."""
_YOUNG_OBJECTS = 50_000
"""The number of new objects after which this process looks for garbage cycles. A tick of a large fleet makes thousands of
objects and no cycle. Python's own 700 cost a tenth of a flight."""


def open_in_process(
    stack: ExitStack,
    config: FlightConfig,
    starts: Sequence[Start],
    directory: RunDirectory,
    sea: Sea | None = None,
    nursery: StartedNursery | None = None,
) -> tuple[FlightContext, Recorder]:
    """Opens the context of a flight in virtual time, with its fleet, and its records; `stack` closes them.

    `sea` is the one that several flights share. `nursery` was begun for its fleet; None for a fleet in one process, or
    without one yet. PeerFailed when the fleet does not start, or another process flies this run.
    """
    stack.enter_context(supervising(directory.path))
    scenario = config.scenario
    recorder = Recorder(directory, scenario, config.ids, battery_min=battery_worth_min(scenario))
    stack.callback(recorder.close)
    journal_start(recorder, scenario, starts)
    fleet = open_fleet(config, starts, directory.path, sea, nursery)
    stack.callback(fleet.close)
    return in_process_context(config, fleet), recorder


def journal_start(recorder: Recorder, scenario: Scenario, starts: Sequence[Start]) -> None:
    """Writes the journal's first line, which a reader needs before anything else."""
    recorder.event(
        MissionMs(0),
        RunBegan(
            format=FORMAT_VERSION,
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
        ),
    )


def open_fleet(
    config: FlightConfig,
    starts: Sequence[Start],
    run_dir: Path,
    sea: Sea | None = None,
    nursery: StartedNursery | None = None,
) -> FlightFleet:
    """Starts a new fleet, hosted as the scenario states; a process per aMussel keeps its files in the run's directory.

    It joins the `sea` that several flights share, if there is one, and adopts the `nursery` that was begun for it.
    """
    scenario = config.scenario
    if scenario.fleet.hosting is Hosting.ONE_PROCESS:
        initial_states = fleet_parts.initial_states(scenario, starts)
        host: InProcessHost | ProcessHost = InProcessHost(fleet_parts.fleet_config(config), initial_states)
    else:
        looks_ahead = config.sea is None and config.board.whole is None and not scenario.fleet.firmware
        nursery = nursery or begin_nursery(config, starts, run_dir)
        folder = run_dir / FOLDER
        try:
            host = ProcessHost.adopt(str(folder), _EPOCH, looks_ahead=looks_ahead, nursery=nursery)
        except (NurseryFailed, NurseryDied) as error:
            raise PeerFailed(f"the fleet cannot start: {error}; see {folder}") from error
    return fleet_parts.fleet_of(config, host, dict.fromkeys((it.agent_id for it in starts), 0), sea=sea)


def in_process_context(config: FlightConfig, fleet: FlightFleet) -> FlightContext:
    """Virtual time with the simulated aPad in this process."""
    return FlightContext(
        vehicle=InProcessVehicle(flight_parts.simulated_apad(config.scenario)),
        pace=AsFastAsPossible(),
        world=World(fleet, flight_parts.fault_injection(config, fleet)),
        safety=safety_of(config.scenario),
    )


def fly(
    config: FlightConfig,
    context: FlightContext,
    recorder: Recorder,
    progress: ProgressDisplay,
    spec: RunSpec = FROM_START,
) -> dict[str, Any]:
    """Flies to the end and returns the summary. SIGINT, SIGTERM and SIGHUP end it in order."""
    prepared = prepare(config, context, recorder, progress, spec)
    with interrupts.held_back():
        with stopped_by_signals(prepared.flight):
            try:
                prepared.flight.run()
            except RecordsFailed as failed:
                # Told at once, because a vehicle may take seconds to come to rest.
                progress.print_message(str(failed))
                # Without records, but in order: a vehicle holds its place, and a mission gives up its orders.
                # An aMussel forgets what is acknowledged, and nothing more is written.
                prepared.flight.supervisor.samples = NoSampleCollection()
                prepared.flight.stop(MissionEnd(failed.reason))
                prepared.flight.run()
                raise
            except ClockLost as lost:
                reason = EndReason.CLOCK_LOST
                prepared.flight.end_at_once(MissionEnd(reason, f"{reason}: {lost}"))
        return prepared.finish()


@contextmanager
def stopped_by_signals(*flights: Flight) -> Iterator[None]:
    """Signals that ask the process to end stop the flights in order while this context is entered."""

    def stop() -> None:
        for flight in flights:
            flight.stop(MissionEnd(EndReason.OPERATOR))

    with interrupts.received_by(stop):
        yield


@dataclass(frozen=True, slots=True)
class PreparedFlight:
    """A flight that is ready to run, and the function that makes its summary."""

    flight: Flight
    recorder: Recorder
    finish: Callable[[], dict[str, Any]]
    """Writes the last records after the flight's end, and returns the summary."""


def prepare(
    config: FlightConfig,
    context: FlightContext,
    recorder: Recorder,
    progress: ProgressDisplay,
    spec: RunSpec = FROM_START,
) -> PreparedFlight:
    """Builds the flight that `fly` runs. `progress` shows its status at each tick, and its failures as they happen."""
    gc.set_threshold(max(_YOUNG_OBJECTS, gc.get_threshold()[0]))
    context = replace(context, planning=partial(progress_when_slow, tell=progress.print_message))
    forecaster = Forecaster(
        config.scenario.mission, energy_model(config.scenario), config.scenario.duration_ms
    )
    latest_tick_s: float | None = None if isinstance(context.pace, AsFastAsPossible) else 0.0

    def show_tick(now_ms: MissionMs) -> None:
        nonlocal latest_tick_s
        if latest_tick_s is not None:
            latest_tick_s = max(latest_tick_s, context.pace.behind_s)

        def forecast() -> Forecast:
            return flight.supervisor.forecast(forecaster, now_ms)

        def status() -> RunStatus:
            return RunStatus.of(flight.supervisor, now_ms, context.pace.behind_s, forecast())

        if forecaster.is_due(now_ms):
            flight.supervisor.inform(forecaster, now_ms)
        context.show_forecast(now_ms, forecast)
        progress.show_status(now_ms, status)
        if spec.until_first_plan and flight.supervisor.mission.state.plan:
            flight.stop(MissionEnd(EndReason.FIRST_PLAN))

    def print_event(at_ms: MissionMs, event: Event) -> None:
        if (line := line_of(at_ms, event)) is not None:
            progress.print_message(line)

    flight_recorder = _AnnouncingRecorder(recorder, [print_event, context.announce])
    if spec.resume_point is not None:
        context.safety.gate.stops.restore(spec.resume_point.stops)
    samples = _collection(config, context, recorder)
    flight = flight_parts.flight(config, context, flight_recorder, spec, samples, (show_tick,))
    context.ended_by_graph(flight.stop)

    def finish() -> dict[str, Any]:
        end = flight.ended_by
        recorder.event(flight.now_ms, RunEnded(str(end), end.reason))
        return recorder.finish(flight.now_ms, _ending(flight, spec.resume_point, latest_tick_s))

    return PreparedFlight(flight, recorder, finish)


@contextmanager
def progress_when_slow(name: str, tell: Callable[[str], None]) -> Iterator[None]:
    """While a strategy plans, mission time waits: `tell` takes a line about one that takes long, and one at its end."""
    begun_s = time.monotonic()
    line = f"strategy {label(name)} has planned for {SLOW_PLAN_S:g} s by now: mission time waits for it"
    timer = threading.Timer(SLOW_PLAN_S, tell, (line,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
    if (took_s := time.monotonic() - begun_s) >= SLOW_PLAN_S:
        tell(f"strategy {label(name)} planned for {took_s:.0f} s")


def _collection(
    config: FlightConfig, context: FlightContext, recorder: Recorder
) -> SampleCollection | NoSampleCollection:
    if not context.keeps_samples:
        return NoSampleCollection()
    return SampleCollection(config.ids, recorder.samples_kept, recorder.state.boards.values())


def _ending(flight: Flight, resume_point: ResumePoint | None, latest_tick_s: float | None) -> Ending:
    supervisor = flight.supervisor
    failure = supervisor.port.first_failure
    return Ending(
        ended_by=flight.ended_by,
        first_cause=None if failure is None else failure.reason,
        cost_m=supervisor.mission.state.cost_m,
        planned_m=supervisor.mission.state.planned_m,
        services=supervisor.mission.state.services,
        apad_energy_fraction=_fraction_used(supervisor, resume_point),
        dropped=flight.all_dropped,
        samples_gone=supervisor.samples.gone,
        latest_tick_s=latest_tick_s,
    )


def _fraction_used(supervisor: Supervisor, resume_point: ResumePoint | None) -> float | None:
    if supervisor.battery is None or supervisor.battery_at_start is None:
        return None
    at_start = supervisor.battery_at_start.fraction
    if resume_point is not None and resume_point.apad_fraction_at_start is not None:
        at_start = resume_point.apad_fraction_at_start
    return at_start - supervisor.battery.fraction


class _AnnouncingRecorder:
    """Passes each event of the flight to the recorder and to listeners."""

    def __init__(self, recorder: Recorder, listeners: Sequence[Announce]) -> None:
        self.truths = recorder.truths
        self.samples = recorder.samples
        self.tick = recorder.tick
        self._recorder = recorder
        self._listeners = listeners

    def event(self, at_ms: MissionMs, event: Event) -> None:
        self._recorder.event(at_ms, event)
        for listener in self._listeners:
            listener(at_ms, event)
