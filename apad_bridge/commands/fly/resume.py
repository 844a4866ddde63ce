"""`musselbed resume`: another supervisor continues a run whose supervisor died."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from apad_bridge.commands.help_text import ending
from apad_bridge.commands.trust import add_trust_argument, trust_of_run
from apad_bridge.runs.exits import peers_may_fail, require_yes
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.run_options import APadKind, RunOptions, TimeSource
from apad_bridge.vehicle.link_errors import PeerFailed


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "resume",
        description="Starts another supervisor for a run. It takes over the live fleet, or starts it again where none "
        "lives, as after a restart of the machine. It reads the journal and the checkpoint, checks the docks, reports the "
        "restored state, and continues the mission. It locks out the old supervisor, should that still run.",
        epilog=ending(
            "musselbed resume runs/pool-12-1",
            "musselbed resume runs/pool-12-1 --confirm-motion",
            note="With a real aPad nothing moves before a person has confirmed it.",
        ),
    )
    parser.add_argument("directory", type=Path, metavar="RUN", help="the run's directory")
    parser.add_argument(
        "--confirm-motion", action="store_true", help="confirm that the real aPad may move again"
    )
    add_trust_argument(parser)
    parser.add_argument(
        "--json", action="store_true", help="print the summary as JSON on stdout, nothing else"
    )


def run(arguments: argparse.Namespace) -> int:
    # Imported here: a help, or a mistake in the options, needs none of the parts of a flight.
    from apad_bridge.commands.fly.flight import failure_lines, flown_by_whom
    from apad_bridge.commands.fly.run_checks import check_real_vehicle
    from apad_bridge.commands.outcome import report
    from apad_bridge.records.journal import FORMAT_VERSION, format_of
    from apad_bridge.records.run_directory import RunDirectory
    from apad_bridge.runs import resuming
    from apad_bridge.runs.progress import FlightProgress
    from apad_bridge.runs.supervisor_lock import supervisor_of
    from apad_bridge.runs.trusted_runs import code_of
    from apad_bridge.scenario.flight_readiness import check_code
    from apad_bridge.scenario.loader import load

    path = arguments.directory
    directory = RunDirectory.open(path)
    if (run_format := format_of(directory.journal)) != FORMAT_VERSION:
        raise UserError(
            f"{directory.journal} has format {run_format}, and this version resumes format {FORMAT_VERSION} alone: "
            f"resume the run with the version that began it ({directory.versions})"
        )
    options = RunOptions.load(path)
    if options.time is TimeSource.ASAP:
        raise UserError(
            f"a run in virtual time always repeats: musselbed run {directory.scenario} --time asap"
        )
    if options.script:
        raise UserError(
            f"a script cannot continue in the middle: musselbed script {options.script} begins anew"
        )
    if (pid := supervisor_of(path)) is not None:
        raise UserError(f"the run's supervisor lives (pid {pid}): there is nothing to resume")
    if directory.summary.exists():
        raise UserError(f"the run has ended: see {directory.summary}")
    trust = trust_of_run(arguments, directory)
    try:
        code = [] if trust is not None else code_of(directory)
    except ValueError as error:  # a scenario or a fleet that this version cannot read
        raise UserError(str(error)) from error
    if code:
        raise UserError(
            f"{path} names code ({', '.join(code)}), and is no run that you began here and that is unchanged: "
            "add --trust if you trust it"
        )
    scenario = load(directory.scenario)
    check_code(scenario, str(path), trust)
    _check_foreign_master(path, options)
    check_real_vehicle(options, scenario)
    if options.apad is APadKind.ROS and not arguments.confirm_motion:
        require_yes(
            "The aPad will move again. Is the water around it clear?",
            "a real aPad moves again only after a person's confirmation: add --confirm-motion",
            "not confirmed: no order was given",
        )
    progress = FlightProgress(scenario.name, scenario.duration_ms, quiet=arguments.json)
    with peers_may_fail(progress.was_shown), progress:
        flown = resuming.resume(scenario.apad.name, path, options, progress, trust)
        if flown.failures:
            raise PeerFailed(*failure_lines(flown.failures))
    (summary,) = flown.summaries.values()
    flown_by = flown_by_whom(options, scenario)
    return report(scenario, flown_by, directory, summary, arguments.json, progress.messages)


def _check_foreign_master(path: Path, options: RunOptions) -> None:
    """PeerFailed when a master is gone that nobody starts again: somebody else's, or that of several aPads."""
    from apad_bridge.ros.system.route import why_gone

    if not options.owns_master and (gone := why_gone(options.master_uri)) is not None:
        if len(options.apads) > 1 and (path.parent / "ros" / "master.log").exists():
            raise PeerFailed(
                f"{gone}: it was the run's own, and a run of several aPads ends with it; its records: {path.parent}"
            )
        raise PeerFailed(
            f"{gone}: the run flew with the aPad on that master; start both again, then: musselbed resume {path}"
        )
