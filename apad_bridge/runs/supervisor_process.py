"""The supervisor of a run over ROS, a process of its own.

    python -m apad_bridge.runs.supervisor_process RUN [--trust] [--resume [--keeps]]

Its standard output is for the parent: the messages of `parent_protocol`.
"""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from agents.hosting.interrupts import held_back, let_in
from agents.time_scale import TICK_MS, MissionMs
from agents.water.sea_client import RemoteSea, SeaRefused
from apad_bridge.acoustics.serial.lines import open_serial_lines
from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.flight_config import FlightConfig, flight_config
from apad_bridge.events.event import Event
from apad_bridge.events.guard_events import StopChanged, StopKind, StopState
from apad_bridge.events.mission_events import StandsDown
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.manual import CommandSource
from apad_bridge.planning.registry import Trust
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.ros.flight_opening import open_flight_context
from apad_bridge.ros.gateway.primitive_services import primitives_offered
from apad_bridge.ros.gateway.run_services import RunServices
from apad_bridge.ros.system.master_watch import forget_silent_master
from apad_bridge.ros.system.ros_pace import StampedByMaster
from apad_bridge.ros.system.ros_time import await_master, stamp_ms
from apad_bridge.ros.system.route import why_gone
from apad_bridge.runs import flying
from apad_bridge.runs.display import ParentDisplay
from apad_bridge.runs.dry_run import without_commands
from apad_bridge.runs.exits import Exit, shortage
from apad_bridge.runs.nurseries import adopt
from apad_bridge.runs.parent_protocol import Failed, Summary, say, write
from apad_bridge.runs.several.member import join_others
from apad_bridge.runs.start_state import (
    StartState,
    begin_run,
    newest_of_siblings_ms,
    ongoing_faults,
    resume_run,
)
from apad_bridge.runs.supervisor_lock import supervising
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import BenchPart, RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.amussel_orders import AMusselOrders
from apad_bridge.supervisor.clock import CommonClock
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.control_server import control_offered
from apad_bridge.supervisor.run_spec import ResumePoint, RunSpec
from apad_bridge.vehicle.link_errors import PeerFailed
from apad_bridge.world.contacts import Contacts
from apad_bridge.world.simulated_fleet import FlightFleet, NoFleet
from apad_bridge.world.world import World
from firmware_model.entry_points import in_one_line, package_to_blame

DIED = "its supervisor died"


def command_sources_of(
    scenario: Scenario, options: RunOptions, trust: Trust | None
) -> tuple[CommandSource, ...] | None:
    """The sources of commands beside a person's calls, where no mission plans: a script if there is one."""
    if not options.without_mission:
        return None
    if not options.script:
        return ()
    # Imported here, because most runs fly no script.
    from apad_bridge.scripting.program import ScriptSource, as_program
    from apad_bridge.scripting.rendezvous import REAL_TIME

    if trust is None:
        raise PeerFailed(f"{options.script} is code in a file, and nobody trusts it")
    path = Path(options.script)
    return (ScriptSource(scenario, as_program(path, trust), path.name, say, REAL_TIME),)


@dataclass(frozen=True, slots=True)
class _Run:
    """One supervisor's run: its directory, what it flies and how, and the state in which it starts."""

    path: Path
    config: FlightConfig
    options: RunOptions
    start_state: StartState
    sea: RemoteSea | None = None
    """The sea that several aPads share, in a process of its own."""


def fly(run_dir: Path, trust: Trust | None, *, resume: bool, keeps: bool) -> int:
    """Flies, and writes the summary or the failure for the parent; returns the exit code."""
    run = _open_run(run_dir, trust, resume=resume, keeps=keeps)
    try:
        with ExitStack() as stack:
            with let_in():  # it waits for others: for agents, the master, the aPad
                run, fleet = _adopt_fleet(run)
                context = stack.enter_context(_flight_context(run, fleet))
                calls = stack.enter_context(primitives_offered(run.config.scenario, run.options))
                if calls is not None:
                    stack.enter_context(closing(RunServices(run.path, run.config.scenario.apad.name)))
                run = _begin_with_others(run, context)
            if not run.options.script:  # a script cannot be resumed in the middle
                run.start_state.recorder.begin_checkpoint(run.start_state.learned, run.start_state.start_ms)
            if calls is not None:
                # Last: whoever finds a supervisor that takes orders may end it in order from then on.
                context = _under_control(stack, context, run, calls)
            stack.callback(forget_silent_master, run.options.master_uri)
            summary = _fly_mission(run, context, calls)
    except (PeerFailed, TimeoutError) as error:
        # A node falls silent with its master: the master is then the cause to name.
        write(Failed(why_gone(run.options.master_uri) or str(error)))
        return Exit.PEER_FAILED
    finally:
        run.start_state.recorder.close()
    fleet.close()
    write(Summary(summary))
    return Exit.DONE


def _open_run(run_dir: Path, trust: Trust | None, *, resume: bool, keeps: bool) -> _Run:
    """Opens the records of a new run, or of one whose supervisor died."""
    directory = RunDirectory(run_dir)
    config, options = flight_config(load(directory.scenario), trust), RunOptions.load(run_dir)
    if not options.owns_master:
        await_master()
    if not resume:
        start_state = begin_run(directory, config, options, stamp_ms)
        return _Run(run_dir, config, options, start_state, _find_sea(config, options))
    if options.owns_master:
        # After a restart of the machine the run has another master than before.
        options = options.on_own_master(os.environ.get("ROS_MASTER_URI", options.master_uri))
    options = replace(options.next_epoch(), keeps=options.keeps or keeps)
    options.save(run_dir)
    sea = _find_sea(config, options)
    others_ms = None if sea is None else sea.now_ms
    start_state = resume_run(directory, config, options, say, stamp_ms, others_ms)
    if (resume_point := start_state.resume_point) is not None and options.keeps:
        at_ms = MissionMs(max(start_state.start_ms, start_state.journal.last_ms))
        resume_point, events = stood_down(resume_point, at_ms, is_real=options.has_real_vehicle)
        for event in events:
            start_state.recorder.event(at_ms, event)
        start_state = replace(start_state, resume_point=resume_point)
    return _Run(run_dir, config, options, start_state, sea)


def stood_down(before: ResumePoint, at_ms: MissionMs, *, is_real: bool) -> tuple[ResumePoint, list[Event]]:
    """The state of one that keeps the fleet of a supervisor that died, and the journal's lines of it.

    Our heartbeats go on, so the watchdog of a real vehicle does not hold it: a stop of ours does, until a person's word.
    """
    after = replace(before, state=before.state.stood_down())
    events: list[Event] = [StandsDown(DIED)]
    if not is_real or before.stops.in_force is not None:
        return after, events
    number = before.stops.next_number
    held = StopChanged(number, StopKind.HOLD, "guard: supervisor", StopState.ORDERED, DIED)
    return replace(after, stops=before.stops.after(at_ms, held)), [*events, held]


def _find_sea(config: FlightConfig, options: RunOptions) -> RemoteSea | None:
    """Connects to the sea that several aPads share, if there is one. PeerFailed when it does not answer, or refuses."""
    if not options.sea or config.sea is None:
        return None
    name = config.scenario.apad.name
    try:
        return RemoteSea.at(options.sea, options.apads.index(name), name, options.epoch, config.sea)
    except SeaRefused as refused:
        raise PeerFailed(
            f"no place in the sea that the aPads share: {refused}; see {options.sea}/sea.log"
        ) from None


def beside_others(before: ResumePoint, pace: CommonClock, others_ms: int) -> ResumePoint:
    """The resume point at the mission time that others have come to while this flight opened its parts."""
    now_ms = MissionMs(max(before.now_ms, others_ms // TICK_MS * TICK_MS))
    pace.begin_at(pace.clock_ms() - now_ms)
    return replace(before, now_ms=now_ms)


def _begin_with_others(run: _Run, context: FlightContext) -> _Run:
    """Waits for the flights in the same sea, so that all missions have one time. One that resumes goes on at theirs."""
    options, pace, resume_point = run.options, context.pace, run.start_state.resume_point
    if run.sea is None and (resume_point is None or not options.is_one_of_several):
        return run
    assert isinstance(pace, StampedByMaster)  # several aPads follow a clock that is not theirs
    if run.sea is None:
        assert resume_point is not None
        name = run.config.scenario.apad.name
        others_ms = newest_of_siblings_ms(RunDirectory(run.path), name, options.apads)
        return _resumed_at(run, beside_others(resume_point, pace, others_ms))
    try:
        begin = run.sea.begin(tuple(run.config.ids), pace.clock_ms())
    except SeaRefused as refused:
        raise PeerFailed(f"no place in the sea that the aPads share: {refused}") from None
    pace.begin_at(begin.clock_ms)
    if resume_point is None:
        if begin.now_ms is not None:
            raise PeerFailed("it was not ready when the other aPads began: the sea does not go back")
        return run
    before_ms = MissionMs(-TICK_MS) if begin.now_ms is None else begin.now_ms
    return _resumed_at(run, replace(resume_point, now_ms=before_ms))


def _resumed_at(run: _Run, resume_point: ResumePoint) -> _Run:
    return replace(run, start_state=replace(run.start_state, resume_point=resume_point))


def _adopt_fleet(run: _Run) -> tuple[_Run, FlightFleet | NoFleet]:
    """Adopts the run's fleet in the state in which the last supervisor left it, with the stimuli that wait for it."""
    start_state, start_ms = run.start_state, run.start_state.start_ms
    if run.options.part is BenchPart.MISSION:
        return run, NoFleet()
    fleet = adopt(run.config, run.path, run.options.epoch, start_ms, run.options.open_modems, run.sea)
    start_state.recorder.truths(fleet.water.take_truths())
    start_state.presences.mute_as_before(fleet.coordinator)
    return replace(run, start_state=start_state.deliver_again(fleet.coordinator)), fleet


@contextmanager
def _flight_context(run: _Run, fleet: FlightFleet | NoFleet) -> Iterator[FlightContext]:
    """Opens the parts of the flight: those on the graph, the serial lines, and the link to other aPads' runs."""
    scenario, options, start_state = run.config.scenario, run.options, run.start_state
    faults = flight_parts.fault_injection(
        run.config,
        fleet,
        start_state.journal.last_ms if options.is_resumed else -1,
        ongoing_faults(start_state.recorder.state),
        real_hull=options.has_real_vehicle,
    )
    with (
        open_flight_context(
            scenario,
            options,
            world=World(fleet, faults, Contacts(start_state.held)),
            resume_point=start_state.resume_point,
            truths_at=start_state.recorder.truths_at,
            presences=start_state.presences,
            allocation=start_state.learned.allocation,
            tell=say,
        ) as context,
        open_serial_lines(
            run.path, options.open_modems, options.modem, start_state.start_ms, say
        ) as serial_lines,
    ):
        context = replace(context, serial_lines=serial_lines, flush_records=start_state.recorder.flush)
        context = join_others(context, scenario, options, run.path, write)
        yield without_commands(context) if options.dry_run else context


def _under_control(stack: ExitStack, context: FlightContext, run: _Run, calls: CallQueue) -> FlightContext:
    """Takes orders of commands, too, and counts those that it drops."""
    has_water = run.config.scenario.water is not None and run.options.part is not BenchPart.MISSION
    amussels = AMusselOrders(run.config.ids, context.world.roster, has_water)
    gate, speed = context.safety.gate, context.pace.speed
    if run.config.scenario.time_stands_while_stopped and speed is not None:
        # A call takes a tick, and may lift the stop.
        speed.is_held = lambda: gate.stops.keeps_still and not calls.has_calls
    dropped = stack.enter_context(control_offered(run.path, calls, gate, amussels=amussels, speed=speed))
    return replace(context, dropped=lambda: context.dropped() + dropped)


def _fly_mission(run: _Run, context: FlightContext, call_queue: CallQueue | None) -> dict[str, Any]:
    """Flies, and returns the summary. A script has ended by then, and its error is printed."""
    options, start_state = run.options, run.start_state
    config = run.config
    command_sources = (
        None if call_queue is None else command_sources_of(config.scenario, options, config.trust)
    )
    summary = flying.fly(
        run.config,
        context,
        start_state.recorder,
        ParentDisplay(),
        RunSpec(
            start_state.resume_point,
            start_state.learned,
            command_sources,
            calls=call_queue,
            until_first_plan=options.dry_run,
        ),
    )
    if options.script:
        from apad_bridge.scripting.program import ScriptSource

        for command_source in command_sources or ():
            if isinstance(command_source, ScriptSource):
                command_source.join()
                command_source.print_error()
    return summary


def main() -> int:
    parser = argparse.ArgumentParser(
        description="The supervisor of one run; started by musselbed, not by hand."
    )
    parser.add_argument("run", type=Path)
    parser.add_argument(
        "--trust", action="store_true", help="the command that started it trusts the run's code"
    )
    parser.add_argument("--resume", action="store_true")
    parser.add_argument(
        "--keeps",
        action="store_true",
        help="with --resume: keep the fleet of one of several aPads, order nothing",
    )
    arguments = parser.parse_args()
    try:
        with held_back(), supervising(arguments.run):
            trust = Trust() if arguments.trust else None
            return fly(arguments.run, trust, resume=arguments.resume, keeps=arguments.keeps)
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    except OSError as error:
        if (why := shortage(error)) is None:
            raise
        write(Failed(f"{arguments.run}: {why}"))
        return Exit.PEER_FAILED
    except (
        PeerFailed,
        RunDirectoryError,
    ) as error:  # what fails after the records are open is handled in `fly`
        write(Failed(str(error)))
        return Exit.PEER_FAILED
    except Exception as error:
        if (package := package_to_blame(error)) is None:
            raise
        traceback.print_exception(error)
        write(Failed(f"{package}: {in_one_line(error)}; see {arguments.run}/supervisor.log"))
        return Exit.PEER_FAILED


if __name__ == "__main__":
    sys.exit(main())
