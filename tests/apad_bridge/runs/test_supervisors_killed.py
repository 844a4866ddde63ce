"""Supervisors that are killed one after the other, with stimuli under way, while their aMussels and their aPad live on."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from threading import Event

import pytest
from journals import lines_in
from scenario_files import POOL_FILE

from agents.hosting.in_process import InProcessHost
from agents.time_scale import MissionMs
from apad_bridge.analysis.invariants import check_run
from apad_bridge.assembly import fleet_parts, flight_parts
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.assembly.safety import safety_of
from apad_bridge.events.guard_events import StopChanged, StopKind, StopState
from apad_bridge.events.mission_events import MissionState, Phase, StandsDown
from apad_bridge.records.journal import JournalTail
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.flying import PreparedFlight, prepare
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.runs.start_state import begin_run, newest_of_siblings_ms, ongoing_faults, resume_run
from apad_bridge.runs.supervisor_process import beside_others, stood_down
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.scenario.timed_faults import FaultAt, Faults, TimedFault
from apad_bridge.supervisor.clock import AsFastAsPossible, WallClock
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.run_spec import ResumePoint, RunSpec
from apad_bridge.vehicle.guards.stops import NO_STOPS
from apad_bridge.world.apad.in_process import InProcessVehicle
from apad_bridge.world.contacts import Contacts
from apad_bridge.world.world import World

KILLS = 5
OPTIONS = RunOptions(
    BenchPart.WHOLE, APadKind.SIM, TimeSource.ASAP, 1.0, OnDeath.WAIT, owns_master=True, epoch=1
)


class Supervisors:
    """Makes one supervisor after the other for the same aMussels and the same aPad."""

    def __init__(self, scenario: Scenario, stack: ExitStack) -> None:
        self._scenario, self._stack = scenario, stack
        self._progress = stack.enter_context(FlightProgress(scenario.name, scenario.duration_ms, quiet=True))
        self._config = flight_config(scenario)
        bodies = fleet_parts.initial_states(scenario, starts_of(scenario))
        self._host = InProcessHost(fleet_parts.fleet_config(self._config), bodies)
        self._vehicle = InProcessVehicle(flight_parts.simulated_apad(scenario))
        self._granted_ms: Mapping[int, int] = dict.fromkeys(bodies, 0)

    def begin(self, directory: RunDirectory, epoch: int) -> PreparedFlight:
        """The flight of a supervisor; one after the first goes on from the files in the directory."""
        config, options = self._config, replace(OPTIONS, epoch=epoch)
        if epoch > 1:
            state = resume_run(directory, config, options, lambda line: None)
        else:
            state = begin_run(directory, config, options)
        self._stack.callback(state.recorder.close)
        fleet = fleet_parts.fleet_of(config, self._host, self._granted_ms, state.start_ms)
        self._granted_ms = fleet.coordinator.granted_ms
        state = state.deliver_again(fleet.coordinator)
        last_ms = state.journal.last_ms if state.journal.entries else -1
        context = FlightContext(
            vehicle=self._vehicle,
            pace=AsFastAsPossible(),
            world=World(
                fleet,
                flight_parts.fault_injection(config, fleet, last_ms, ongoing_faults(state.recorder.state)),
                Contacts(state.held),
            ),
            safety=safety_of(self._scenario),
        )
        state.recorder.begin_checkpoint(state.learned, state.start_ms)
        spec = RunSpec(state.resume_point, state.learned)
        return prepare(config, context, state.recorder, self._progress, spec)


def fly_until_a_stimulus(flying: PreparedFlight, directory: RunDirectory, due_ms: float) -> None:
    """Flies to the first tick from `due_ms` on that queues a stimulus."""
    with closing(JournalTail(directory.journal)) as tail:
        queued = False
        while not (queued and flying.flight.now_ms > due_ms):
            assert not flying.flight.step(), "the flight ended before"
            queued = any(it.event.kind == "stimulus" for it in tail.read_new().entries)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def test_supervisors_that_are_killed_lose_no_stimulus_of_theirs(stack: ExitStack, tmp_path: Path) -> None:
    """Batteries that leak in every tick, so that each kill leaves a loss of charge that the aMussels have not felt."""
    scenario = load(POOL_FILE)
    leaks = [FaultAt(fault=TimedFault.BATTERY_AGEING, at_s=2, id=n) for n in scenario.fleet.ids]
    fleet = replace(scenario.fleet, hosting=Hosting.ONE_PROCESS)
    scenario = replace(scenario, duration_s=240, fleet=fleet, faults=Faults(at=tuple(leaks)))
    directory = RunDirectory(tmp_path / "run")
    directory.path.mkdir()
    directory.write_inputs(scenario, starts_of(scenario))
    supervisors = Supervisors(scenario, stack)
    flying = supervisors.begin(directory, 1)
    for n in range(1, KILLS + 1):
        fly_until_a_stimulus(flying, directory, 1000 * scenario.duration_s * n / (KILLS + 1))
        left = RunDirectory(tmp_path / f"resumed-{n}")
        shutil.copytree(directory.path, left.path)  # what a kill leaves: closing would write more
        flying.recorder.close()
        directory, flying = left, supervisors.begin(left, n + 1)
    flying.flight.run()
    flying.finish()
    assert check_run(directory) == []
    kinds = [it["kind"] for it in lines_in(directory.journal)]
    assert kinds.count("resumed") == KILLS and kinds.count("fault") == len(leaks)


@pytest.mark.parametrize(
    ("is_real", "in_force", "held"),
    [(True, None, "hold"), (True, StopKind.OFF, "off"), (False, None, None)],
)
def test_a_real_aPad_is_held_where_another_supervisor_keeps_its_aMussels(
    is_real: bool, in_force: StopKind | None, held: str | None
) -> None:
    """The heartbeats go on, and the vehicle's watchdog with them. An OFF that was in force stays one."""
    stops = NO_STOPS
    if in_force is not None:
        stops = stops.after(1000, StopChanged(4, in_force, "Ana", StopState.ORDERED, is_persons=True))
    before = ResumePoint(MissionMs(5000), MissionState(phase=Phase.GO_COLLECT), 1, None, stops=stops)
    after, events = stood_down(before, MissionMs(5000), is_real=is_real)
    assert after.state.phase is Phase.STANDS_DOWN and isinstance(events[0], StandsDown)
    stop = after.stops.in_force
    assert (stop and stop.kind) == held
    assert len(events) == (2 if is_real and in_force is None else 1)
    if len(events) == 2:
        assert NO_STOPS.after(5000, events[1]).in_force == stop, (
            "the journal gives the same stop to whoever resumes"
        )


def test_one_that_resumes_beside_others_goes_on_at_their_time(tmp_path: Path) -> None:
    """It opened its parts from 258 s of mission time on, and meanwhile the others came to 274 s."""
    for name, newest_ms in (("apad2", 274_000), ("apad3", 273_000), ("apad1", 300_000)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "journal.jsonl").write_text(f'{{"t":{newest_ms},"kind":"tick"}}\n')
    others_ms = newest_of_siblings_ms(RunDirectory(tmp_path / "apad1"), "apad1", ("apad1", "apad2", "apad3"))
    for own_ms, now_ms in ((258_000, 274_000), (280_000, 280_000)):
        pace = WallClock(1.0, clock=lambda: 5000.0)
        resumed = beside_others(ResumePoint(MissionMs(own_ms), MissionState(), 2, None), pace, others_ms)
        pace.reach(resumed.now_ms, Event())
        assert (resumed.now_ms, pace.behind_s) == (now_ms, 0.0)
