"""The supervisor of a run over ROS, a process of its own: python -m apad_bridge.runs.supervisor_process RUN [--resume]

Its standard output is for the parent: a JSON line a tick (`Status`), words for a person, and at last the summary. It goes
on when nobody reads it.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from apad_bridge.acoustics.serial.lines import open_rims
from apad_bridge.mission.call_queue import CalledFront
from apad_bridge.mission.manual import Front
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.ros.context import open_surroundings
from apad_bridge.ros.gateway.primitive_services import primitives_offered
from apad_bridge.ros.system.route import why_silent
from apad_bridge.runs import flying, resuming
from apad_bridge.runs.children import supervising
from apad_bridge.runs.dry_run import dry
from apad_bridge.runs.exits import Exit
from apad_bridge.runs.nurseries import adopt
from apad_bridge.runs.several.member import seat_of
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.run_options import Part, RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.handover import REAL_TIME
from apad_bridge.scripting.program import ScriptFront, as_program
from apad_bridge.supervisor.context import Surroundings
from apad_bridge.supervisor.fleet import Fleet
from apad_bridge.vehicle.errors import PeerFailed


def say(line: str) -> None:
    """To the parent, if there still is one."""
    with contextlib.suppress(BrokenPipeError):
        print(line, flush=True)


def fronts_of(scenario: Scenario, options: RunOptions, called: CalledFront | None) -> tuple[Front, ...]:
    """Who gives the orders, where it is not the paper's mission: a script, a person's calls, or both."""
    if called is None or not options.without_mission:
        return ()
    fronts: tuple[Front, ...] = (called,)
    if options.script:
        path = Path(options.script)

        def tell(line: str) -> None:
            say(json.dumps({"said": line}))

        fronts = (*fronts, ScriptFront(scenario, as_program(path), path.name, tell, REAL_TIME))
    return fronts


def fly(run_dir: Path, resume: bool) -> int:
    directory = RunDirectory(run_dir)
    scenario, options = load(directory.scenario), RunOptions.load(run_dir)
    begun = (
        resuming.resume(directory, scenario, options, say)
        if resume
        else resuming.begin(directory, scenario, options)
    )
    recorder, go_on, start_ms = begun.recorder, begun.go_on, begun.start_ms
    squad = seat_of(scenario, options, run_dir, begun, say)
    if squad is not None and go_on is not None and options.keeps:
        go_on = replace(go_on, state=go_on.state.stood_down())
        recorder.event(start_ms, "stands_down", reason="its supervisor died")
    try:
        fleet = None if options.part is Part.MISSION else _adopted(scenario, options, run_dir, begun)
        docked = {} if go_on is None else dict(go_on.state.docked)
        # What the bodies felt, not what the mission knows: a contact that was on its way when a supervisor died is told
        # again, and one that was felt is not.
        held = tuple(it.agent_id for it in recorder.truths_at(start_ms) if it.docked)
        if squad is not None:
            held += tuple(sorted(squad.share.guests & set(docked.values())))
        with (
            open_surroundings(
                scenario,
                options,
                fleet,
                docked,
                held,
                start_ms,
                recorder.truths_at,
                begun.presences,
                say,
                None if squad is None else squad.share,
            ) as surroundings,
            primitives_offered(scenario, options) as called,
            open_rims(run_dir, options.open_modems, options.modem, start_ms, say) as rims,
        ):
            surroundings = replace(surroundings, rims=rims)
            if squad is not None:
                surroundings = squad.around(surroundings)
            summary = _flown(scenario, options, replace(begun, go_on=go_on), surroundings, called)
    except (PeerFailed, TimeoutError) as error:
        # A node falls silent with its master: the master is then the cause to name.
        why = why_silent(options.master_uri)
        cause = str(error) if why is None else f"the ROS master at {options.master_uri} is gone ({why})"
        say(json.dumps({"failed": cause}))
        return Exit.PEER_FAILED
    finally:
        recorder.close()
    if fleet is not None:
        fleet.host.close()
    say(json.dumps({"summary": summary}))
    return Exit.DONE


def _adopted(scenario: Scenario, options: RunOptions, run_dir: Path, begun: resuming.Begun) -> Fleet:
    """The run's fleet, as it was when the last supervisor left it."""
    fleet = adopt(scenario, run_dir, options.epoch, begun.start_ms, options.open_modems)
    begun.recorder.truths(fleet.take_truths())
    begun.presences.mute_as_before(fleet.coordinator)
    resuming.place_again(begun.journal, fleet.coordinator, begun.recorder, begun.start_ms)
    return fleet


def _flown(
    scenario: Scenario,
    options: RunOptions,
    begun: resuming.Begun,
    surroundings: Surroundings,
    called: CalledFront | None,
) -> dict[str, Any]:
    """The summary. A script has ended, with what it had to say."""
    fronts = fronts_of(scenario, options, called)
    if not options.script:  # which cannot go on in the middle
        begun.recorder.keep(begun.known, begun.start_ms)
    summary = flying.fly(
        scenario,
        dry(surroundings) if options.dry_run else surroundings,
        begun.recorder,
        lambda status: say(status.to_line()),
        flying.Course(
            begun.go_on,
            begun.known,
            tuple(fronts),
            override=None if fronts else called,
            until_first_plan=options.dry_run,
        ),
    )
    for front in fronts:
        if isinstance(front, ScriptFront):
            front.join()
            front.print_error()
    return summary


def main() -> int:
    parser = argparse.ArgumentParser(
        description="The supervisor of one run; started by musselbed, not by hand."
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("--resume", action="store_true")
    arguments = parser.parse_args()
    with supervising(arguments.run):
        return fly(arguments.run, arguments.resume)


if __name__ == "__main__":
    sys.exit(main())
