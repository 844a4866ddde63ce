"""The supervisor of a run over ROS, a process of its own: python -m apad_bridge.runs.supervisor_process RUN [--resume]

Its standard output is for the parent: the messages of `parent_protocol`.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from agents.hosting.interrupts import held_back, let_in
from apad_bridge.acoustics.serial.lines import open_serial_lines
from apad_bridge.mission.call_queue import CallQueue
from apad_bridge.mission.manual import CommandSource
from apad_bridge.records.event_kinds import EventKind
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.ros.context import open_flight_context
from apad_bridge.ros.gateway.primitive_services import primitives_offered
from apad_bridge.ros.system.route import why_silent
from apad_bridge.runs import flying, resuming
from apad_bridge.runs.children import supervising
from apad_bridge.runs.dry_run import without_commands
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.nurseries import adopt
from apad_bridge.runs.parent_protocol import Failed, Summary, say, write
from apad_bridge.runs.progress import ParentDisplay
from apad_bridge.runs.several.member import member_parts
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import Part, RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.program import ScriptSource, as_program
from apad_bridge.scripting.rendezvous import REAL_TIME
from apad_bridge.supervisor.context import FlightContext
from apad_bridge.supervisor.fleet import Fleet
from apad_bridge.vehicle.errors import PeerFailed


def command_sources_of(
    scenario: Scenario, options: RunOptions, call_queue: CallQueue | None
) -> tuple[CommandSource, ...]:
    """The sources of commands in place of the paper's mission: a person's calls, and a script if there is one."""
    if call_queue is None or not options.without_mission:
        return ()
    command_sources: tuple[CommandSource, ...] = (call_queue,)
    if options.script:
        path = Path(options.script)
        command_sources = (
            *command_sources,
            ScriptSource(scenario, as_program(path), path.name, say, REAL_TIME),
        )
    return command_sources


def fly(run_dir: Path, resume: bool) -> int:
    directory = RunDirectory(run_dir)
    scenario, options = load(directory.scenario), RunOptions.load(run_dir)
    if resume:
        options = options.next_epoch()
        options.save(run_dir)
    start_state = (
        resuming.resume_run(directory, scenario, options, say)
        if resume
        else resuming.begin_run(directory, scenario, options)
    )
    recorder, resume_point, start_ms = start_state.recorder, start_state.resume_point, start_state.start_ms
    member = member_parts(scenario, options, run_dir, start_state, write)
    if member is not None and resume_point is not None and options.keeps:
        resume_point = replace(resume_point, state=resume_point.state.stood_down())
        recorder.event(start_ms, EventKind.STANDS_DOWN, reason="its supervisor died")
    try:
        with ExitStack() as stack:
            with let_in():  # it waits for others: for agents, the master, the aPad
                fleet = (
                    None
                    if options.part is Part.MISSION
                    else _adopt_fleet(scenario, options, run_dir, start_state)
                )
                docked = {} if resume_point is None else dict(resume_point.state.docked)
                # The bodies' state, not the mission's: a contact that was on its way when a supervisor died is delivered
                # again, and one that a body has felt is not.
                docked_ids = tuple(it.agent_id for it in recorder.truths_at(start_ms) if it.docked)
                if member is not None:
                    docked_ids += tuple(sorted(member.allocation.served_for_others & set(docked.values())))
                context = stack.enter_context(
                    open_flight_context(
                        scenario,
                        options,
                        fleet,
                        docked,
                        docked_ids,
                        start_ms,
                        recorder.truths_at,
                        start_state.presences,
                        say,
                        None if member is None else member.allocation,
                    )
                )
                call_queue = stack.enter_context(primitives_offered(scenario, options))
                serial_lines = stack.enter_context(
                    open_serial_lines(run_dir, options.open_modems, options.modem, start_ms, say)
                )
            context = replace(context, serial_lines=serial_lines)
            if member is not None:
                context = member.extend(context)
            summary = _fly_mission(
                scenario, options, replace(start_state, resume_point=resume_point), context, call_queue
            )
    except (PeerFailed, TimeoutError) as error:
        # A node falls silent with its master: the master is then the cause to name.
        why = why_silent(options.master_uri)
        cause = str(error) if why is None else f"the ROS master at {options.master_uri} is gone ({why})"
        write(Failed(cause))
        return Exit.PEER_FAILED
    finally:
        recorder.close()
    if fleet is not None:
        fleet.host.close()
    write(Summary(summary))
    return Exit.DONE


def _adopt_fleet(
    scenario: Scenario, options: RunOptions, run_dir: Path, start_state: resuming.StartState
) -> Fleet:
    """Adopts the run's fleet in the state in which the last supervisor left it."""
    fleet = adopt(scenario, run_dir, options.epoch, start_state.start_ms, options.open_modems)
    start_state.recorder.truths(fleet.take_truths())
    start_state.presences.mute_as_before(fleet.coordinator)
    resuming.repeat_placements(
        start_state.journal, fleet.coordinator, start_state.recorder, start_state.start_ms
    )
    return fleet


def _fly_mission(
    scenario: Scenario,
    options: RunOptions,
    start_state: resuming.StartState,
    context: FlightContext,
    call_queue: CallQueue | None,
) -> dict[str, Any]:
    """Flies, and returns the summary. A script has ended by then, and its error is printed."""
    command_sources = command_sources_of(scenario, options, call_queue)
    if not options.script:  # a script cannot be resumed in the middle
        start_state.recorder.begin_checkpoint(start_state.learned, start_state.start_ms)
    summary = flying.fly(
        scenario,
        without_commands(context) if options.dry_run else context,
        start_state.recorder,
        ParentDisplay(),
        flying.RunSpec(
            start_state.resume_point,
            start_state.learned,
            tuple(command_sources),
            takeover=None if command_sources else call_queue,
            until_first_plan=options.dry_run,
        ),
    )
    for command_source in command_sources:
        if isinstance(command_source, ScriptSource):
            command_source.join()
            command_source.print_error()
    return summary


def main() -> int:
    parser = argparse.ArgumentParser(
        description="The supervisor of one run; started by musselbed, not by hand."
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--resume", action="store_true")
    arguments = parser.parse_args()
    try:
        with held_back(), supervising(arguments.run):
            return fly(arguments.run, arguments.resume)
    except KeyboardInterrupt:
        return Exit.INTERRUPTED
    except (
        PeerFailed,
        RunDirectoryError,
    ) as error:  # what fails after the records are open is handled in `fly`
        write(Failed(str(error)))
        return Exit.PEER_FAILED


if __name__ == "__main__":
    sys.exit(main())
