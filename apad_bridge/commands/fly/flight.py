"""Flies what a command asked for: has it checked, makes the run's directory, flies, and prints the outcome."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime, time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.hosting.interrupts import held_back
from apad_bridge.assembly.division import Member, members
from apad_bridge.commands.fly.run_checks import check_run
from apad_bridge.commands.outcome import plan_line, print_plan, report
from apad_bridge.events.mission_events import PlanMade
from apad_bridge.planning.registry import Trust, label
from apad_bridge.records.journal import read_journal
from apad_bridge.records.run_directory import PRIVATE, RunDirectory
from apad_bridge.runs.exits import Exit, peers_may_fail
from apad_bridge.runs.progress import FlightProgress
from apad_bridge.runs.several.joint_summary import Flown, combined_summary
from apad_bridge.scenario.errors import ScenarioError, UserError
from apad_bridge.scenario.flight_readiness import check_code
from apad_bridge.scenario.loader import load, with_overrides, with_values
from apad_bridge.scenario.run_options import APadKind, BenchPart, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import read_starts, save_starts, starts_of
from apad_bridge.scenario.starts_table import Start
from apad_bridge.vehicle.link_errors import PeerFailed

if TYPE_CHECKING:
    from apad_bridge.runs.watched_services import Service
    from apad_bridge.scripting.program import Program, ScriptSource


@dataclass(frozen=True, slots=True)
class Script:
    """A script that flies in place of the paper's mission."""

    file: Path
    program: Program


def _refuse_several(live: Sequence[Service], scenario: Scenario) -> None:
    """UserError for a scenario of several aPads, where a service follows one of them."""
    if (names := [it.name for it in live if not it.serves_several]) and scenario.apads:
        raise UserError(
            f"--{names[0]} shows one aPad, and the scenario names several: start `musselbed {names[0]} RUN/NAME` "
            "beside the run"
        )


def read_scenario(arguments: argparse.Namespace, trust: Trust | None) -> tuple[Scenario, Sequence[Start]]:
    """The scenario with the command line's changes, and its starts; UserError with every mistake found.

    A command has only the arguments that suit it. Strategies in files are executed with `trust` alone.
    """
    changeable = ("theta", "agents", "strategy", "seed", "hosting", "generation")
    try:
        changes = {it: getattr(arguments, it, None) for it in changeable}
        scenario = with_overrides(load(arguments.scenario), **changes)
        check_code(scenario, str(arguments.scenario), trust)
        return scenario, starts_of(scenario)
    except ScenarioError:
        raise
    except (OSError, ValueError) as error:
        raise UserError(f"{arguments.scenario}: {error}") from error


def fly(
    options: RunOptions,
    scenario: Scenario,
    starts: Sequence[Start],
    out: Path | None,
    as_json: bool,
    trust: Trust,
    *,
    live: Sequence[Service] = (),
    script: Script | None = None,
    check: bool = False,
) -> int:
    """Flies one aPad or several, and returns the exit code. UserError, or a line and its exit code, before anything starts.

    A run of several aPads has a directory for each, below its own. `live` are the services beside the run.
    With `check` the records are checked at the end, and a broken rule decides the exit code. Of a fleet without `out`
    that ends in order its bag alone stays: the run is its mission's, perhaps on another machine.
    """
    _refuse_several(live, scenario)
    scenario = with_end_by_in_seconds(scenario, datetime.now(), options.speed)
    preflight = check_run(options, scenario, starts)
    all_members = members(scenario, starts)
    if options.dry_run and options.apad is APadKind.SIM:
        return _print_plans(all_members, as_json, trust)
    stem = scenario.name if script is None else f"{script.file.stem}-{scenario.name}"
    whole = RunDirectory.create(stem, datetime.now(UTC), out)
    only_bags = options.part is BenchPart.FLEET and out is None
    _write_inputs(whole, options, scenario, starts, all_members, script)
    _mark_own(whole, all_members)
    if preflight is not None:
        preflight.save(whole.preflight)
    if scenario.apads and not as_json:
        print(_allocation_text(all_members), flush=True)
    if options.time is not TimeSource.ASAP and not options.dry_run and not as_json:
        print(f"run: {whole.path}   (pause it: musselbed stop {whole.path})", flush=True)
        if only_bags:
            print("at the end its bag alone stays; --out DIR keeps all of it", flush=True)
        if options.apad is APadKind.ROS and options.part is not BenchPart.FLEET:
            from apad_bridge.commands.prepare.run_preflight import recording_commands

            for command in recording_commands(scenario, options.namespace):
                print(f"on the vehicle's computer: {command}", flush=True)
    title = scenario.name if script is None else script.file.name
    progress = FlightProgress(title, scenario.duration_ms, quiet=as_json)
    with peers_may_fail(progress.was_shown):
        with ExitStack() as stack:
            stack.enter_context(progress)
            tell = progress.print_message
            for service in live:
                tell(service.title + stack.enter_context(service.beside(whole.path, tell)))
            flown = _fly(options, scenario, all_members, whole, progress, trust, script=script)
        if not flown.summaries:
            raise PeerFailed(*failure_lines(flown.failures, is_alone=not scenario.apads))
        if options.dry_run:
            return print_plan(next(read_journal(whole.journal).events(PlanMade), None), as_json)
        summary = _whole_summary(whole, scenario, all_members, flown)
        flown_by = flown_by_whom(options, scenario)
        bags = (
            whole.reduced_to_bags([it.name for it in all_members]) if only_bags and not flown.failures else []
        )
        is_virtual = options.time is TimeSource.ASAP
        code = report(
            scenario, flown_by, whole, summary, as_json, progress.messages, bags=bags, is_virtual=is_virtual
        )
        if flown.failures:
            raise PeerFailed(*failure_lines(flown.failures, is_alone=not scenario.apads))
        return _checked(whole, code) if check else code


def _checked(whole: RunDirectory, code: int) -> int:
    """Checks the records, with lines on stderr; a broken rule is a bug, whatever else the code says."""
    from apad_bridge.commands.look.check import broken_rules, exit_of_rules, print_rules

    broken = broken_rules(whole.path)
    print_rules(broken, sys.stderr)
    return exit_of_rules(broken) or code


def flown_by_whom(options: RunOptions, scenario: Scenario) -> str:
    """Names the source of the orders: a script, a strategy or a person."""
    if options.script:
        return Path(options.script).name
    return "by hand" if options.manual else label(scenario.mission.collection)


def failure_lines(failures: Mapping[str, str], *, is_alone: bool = True) -> list[str]:
    """A line for each aPad that failed; it names the aPads of several."""
    return [why if is_alone else f"{name}: {why}" for name, why in failures.items()]


def _write_inputs(
    whole: RunDirectory,
    options: RunOptions,
    scenario: Scenario,
    starts: Sequence[Start],
    all_members: Sequence[Member],
    script: Script | None,
) -> None:
    whole.write_inputs(scenario, starts)
    if script is not None:
        text = script.file.read_text(encoding="utf-8")
        (whole.path / "script.py").write_text(text, encoding="utf-8")
    for member in all_members:
        directory = whole.of_apad(member.name, len(all_members))
        if directory != whole:
            directory.path.mkdir(mode=PRIVATE)
            directory.write_inputs(member.scenario, member.starts)
        options.save(directory.path)


def _mark_own(whole: RunDirectory, all_members: Sequence[Member]) -> None:
    """Marks the runs that name code as begun here, so that they can be continued. A flight needs no mark."""
    from apad_bridge.runs.trusted_runs import mark

    try:
        for member in all_members:
            mark(whole.of_apad(member.name, len(all_members)), member.scenario)
    except (OSError, RuntimeError) as error:
        print(
            f"musselbed: warning: the run cannot be marked as begun here ({error}): to continue it, "
            "`musselbed resume` needs --trust",
            file=sys.stderr,
        )


def _fly(
    options: RunOptions,
    scenario: Scenario,
    all_members: Sequence[Member],
    whole: RunDirectory,
    progress: FlightProgress,
    trust: Trust,
    script: Script | None,
) -> Flown:
    if options.time is not TimeSource.ASAP:
        # Imported here, as the other way below: this process needs one of the two, and the parent's parts are few.
        from apad_bridge.runs import parent

        return parent.fly(all_members, scenario.sharing, options, whole, progress, trust)
    from apad_bridge.runs.nurseries import begin_nurseries

    with held_back(), ExitStack() as stack:
        # The nurseries come up on another processor while this process imports the rest.
        nurseries = begin_nurseries(stack, all_members, whole, trust)
        from apad_bridge.runs.several.lockstep import fly_in_step

        sources: tuple[ScriptSource, ...] | None = None
        if script is not None:
            from apad_bridge.scripting import program

            sources = (
                program.ScriptSource(scenario, script.program, script.file.name, progress.print_message),
            )
        flown = fly_in_step(all_members, scenario.sharing, whole, progress, sources, nurseries, trust=trust)
    for source in sources or ():
        source.join()
        source.print_error()
    return flown


def _whole_summary(
    whole: RunDirectory, scenario: Scenario, all_members: Sequence[Member], flown: Flown
) -> dict[str, Any]:
    """The summary of the whole run; of several aPads it and their ends are written here."""
    if not scenario.apads:
        (summary,) = flown.summaries.values()
        return summary
    combined = combined_summary(scenario.name, flown.summaries, flown.handed_on)
    whole.write_json(whole.summary, combined)
    save_starts(whole.ends, _ends(all_members, whole), scenario.area.origin)
    return combined


def _ends(all_members: Sequence[Member], whole: RunDirectory) -> list[Start]:
    """The ends of all runs, so that another run can begin there; an aMussel without an end is at its start."""
    ends: list[Start] = []
    for member in all_members:
        path = whole.of_apad(member.name, len(all_members)).path
        ends += read_starts(path, member.scenario.area, member.scenario.fleet.ids)
    return sorted(ends, key=lambda end: end.agent_id)


def _print_plans(all_members: Sequence[Member], as_json: bool, trust: Trust) -> int:
    from apad_bridge.runs.dry_run import first_plan

    if all_members[0].scenario.fleet.firmware:
        print("a dry run flies our firmware in place of fleet.firmware", file=sys.stderr)
    plans = {member.name: first_plan(member.scenario, trust) for member in all_members}
    if len(all_members) == 1:
        return print_plan(plans[all_members[0].name], as_json)
    if as_json:
        served = {it.name: list(it.scenario.fleet.ids) for it in all_members}
        told = {name: {"serves": served[name], "plan": plan_line(made)} for name, made in plans.items()}
        print(json.dumps(told))
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


def with_end_by_in_seconds(scenario: Scenario, now: datetime, speed: float = 1.0) -> Scenario:
    """The scenario with `mission.end_by` in seconds of mission time, which passes `speed` times as fast as the clock's.

    `now` is local. ScenarioError for a time that has passed today.
    """
    end_by = scenario.mission.end_by
    if not isinstance(end_by, str):
        return scenario
    hour, minute = map(int, end_by.split(":"))
    seconds = (datetime.combine(now.date(), time(hour, minute)) - now.replace(tzinfo=None)).total_seconds()
    if seconds <= 0:
        raise ScenarioError([f"mission.end_by: it is {now:%H:%M}, and {end_by} has passed today"])
    # A fast mission's begin is not known better than to a second.
    return with_values(scenario, {"mission.end_by": float(max(1, int(seconds * speed)))}, "mission.end_by")
