"""`musselbed run` of a scenario with several aPads: prints the allocation, flies a run for each, combines the summaries."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from apad_bridge.assembly.division import Member, members
from apad_bridge.commands.outcome import print_plan, report
from apad_bridge.records.run_directory import PRIVATE, RunDirectory, RunDirectoryError
from apad_bridge.runs.dry_run import first_plan
from apad_bridge.runs.exits import Exit, UserError
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.runs.several.lockstep import fly_in_step
from apad_bridge.runs.several.parent import directory_of, fly_side_by_side
from apad_bridge.runs.several.summary import combined_summary
from apad_bridge.scenario.run_options import APadKind, Part, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import Start, read_starts, save_starts
from apad_bridge.vehicle.errors import PeerFailed


def run(
    options: RunOptions, scenario: Scenario, starts: Sequence[Start], out: Path | None, as_json: bool
) -> int:
    """Returns the exit code. UserError for options that several aPads do not support; PeerFailed if an aPad's run fails."""
    _refuse_unsupported(options)
    all_members = members(scenario, starts)
    if options.dry_run:
        return _print_plans(all_members, as_json)
    try:
        whole = RunDirectory.create(scenario.name, datetime.now(UTC), out)
    except RunDirectoryError as error:
        raise UserError(str(error)) from error
    whole.write_inputs(scenario, starts)
    for member in all_members:
        directory = directory_of(member, whole)
        directory.path.mkdir(mode=PRIVATE)
        directory.write_inputs(member.scenario, member.starts)
        options.save(directory.path)
    failures: dict[str, str] = {}
    if not as_json:
        print(_allocation_text(all_members), flush=True)
    progress = FlightProgress(scenario.name, round(scenario.duration_s * 1000), quiet=as_json)
    if options.time is TimeSource.ASAP:
        directories = {member.name: directory_of(member, whole) for member in all_members}
        with progress:
            summaries, handed_on = fly_in_step(all_members, scenario.sharing, directories, progress)
    else:
        with progress:
            summaries, failures, handed_on = fly_side_by_side(
                all_members, scenario.sharing, options, whole, progress
            )
    if not summaries:
        raise PeerFailed(_failure_text(failures))
    summary = combined_summary(scenario.name, summaries, handed_on)
    whole.write_json(whole.summary, summary)
    save_starts(whole.ends, _ends(all_members, whole), scenario.area.origin)
    flown_by = "by hand" if options.manual else scenario.mission.collection
    code = report(scenario.name, flown_by, whole, summary, as_json, progress.messages)
    if failures:
        raise PeerFailed(_failure_text(failures))
    return code


def _refuse_unsupported(options: RunOptions) -> None:
    if options.part is not Part.WHOLE:
        raise UserError(
            f"{options.part.value}: the scenario names several aPads: `musselbed run` flies them; "
            "or leave `apads` out, and give each its fleet.share"
        )
    if options.modem:
        raise UserError("--modem: a physical modem has one aPad: leave it out, or `apads` in the scenario")
    if options.dry_run and options.apad is APadKind.ROS:
        raise UserError("--dry-run of several aPads plans without ROS: leave out --apad ros")


def _print_plans(all_members: Sequence[Member], as_json: bool) -> int:
    plans = {member.name: first_plan(member.scenario) for member in all_members}
    if as_json:
        print(
            json.dumps(
                {
                    it.name: {"serves": list(it.scenario.fleet.ids), "plan": plans[it.name]}
                    for it in all_members
                }
            )
        )
        return Exit.DONE
    print(_allocation_text(all_members))
    for name, plan in plans.items():
        print(f"{name}: ", end="")
        print_plan(plan, as_json=False)
    return Exit.DONE


def _allocation_text(all_members: Sequence[Member]) -> str:
    return "\n".join(
        f"{member.name} serves aMussels {', '.join(map(str, member.scenario.fleet.ids))}"
        for member in all_members
    )


def _ends(all_members: Sequence[Member], whole: RunDirectory) -> list[Start]:
    """The ends of all runs, so that another run can begin there; an aMussel without an end is at its start."""
    ends: list[Start] = []
    for member in all_members:
        fleet = member.scenario.fleet
        path = directory_of(member, whole).path
        ends += read_starts(path, member.scenario.area, fleet.ids)
    return sorted(ends, key=lambda end: end.agent_id)


def _failure_text(failures: Mapping[str, str]) -> str:
    return "; ".join(f"{name}: {why}" for name, why in failures.items())
