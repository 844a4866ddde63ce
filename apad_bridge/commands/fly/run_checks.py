"""Checks a run of one aPad or of several before anything of it is made."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from agents.mussel.port.board_link import serial_line
from apad_bridge.assembly.safety import unreachable_starts
from apad_bridge.doctor.finding import CheckStatus
from apad_bridge.ros.system.route import somebodys_master
from apad_bridge.ros_names.names import in_full
from apad_bridge.runs.exits import refuse
from apad_bridge.scenario.choices import OWN_GENERATIONS
from apad_bridge.scenario.errors import UserError, in_ranges
from apad_bridge.scenario.flight_readiness import problems_with_real_vehicle, warnings
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts_table import Start
from apad_bridge.vehicle.link_errors import PeerFailed

if TYPE_CHECKING:
    from apad_bridge.commands.prepare.run_preflight import Report


def check_run(options: RunOptions, scenario: Scenario, starts: Sequence[Start]) -> Report | None:
    """Warns on stderr, and returns the preflight of a real aPad that is to move.

    UserError for a mistake, or on red; PeerFailed for somebody's master that does not answer.
    """
    if options.open_modems:
        _check_opened(options, scenario)
    if options.modem:
        _check_physical(options, scenario)
    _check_boards(options, scenario)
    refuse(
        (
            scenario.time_stands_while_stopped and (options.apad is APadKind.ROS or scenario.apads),
            "time_stands_while_stopped: only one simulated aPad on the run's own master has such a time: leave it out",
        ),
    )
    if scenario.apads:
        _refuse_for_several(options, scenario)
    check_real_vehicle(options, scenario)
    if options.apad is APadKind.SIM:
        generation = scenario.apad.generation
        if options.time is not TimeSource.ASAP and generation not in OWN_GENERATIONS:
            raise UserError(
                f"the stack {generation.value!r} brings no simulated aPad: fly its vehicle by --apad ros, or ours by "
                "--generation a"
            )
        for happens, mend in (*warnings(scenario), *unreachable_starts(scenario, starts)):
            print(f"musselbed: warning: {happens}: {mend}", file=sys.stderr)
        return None
    master_uri = somebodys_master()
    if options.has_real_vehicle and not options.dry_run:
        return _preflight(options.on_master(master_uri), scenario, starts)
    show_docks_in_use(options, scenario)
    return None


def _preflight(options: RunOptions, scenario: Scenario, starts: Sequence[Start]) -> Report:
    """Looks at everything that needs no order, and refuses to start on red."""
    from apad_bridge.commands.prepare.run_preflight import (
        Report,
        accepted_by,
        findings_of,
        names_in_full,
        now,
        proofs,
        refuse_red,
    )

    print("musselbed: checks before the real aPad moves ...", file=sys.stderr, flush=True)
    apads = names_in_full(scenario, options.namespace)
    findings = (*findings_of(scenario, starts, options), *proofs(scenario, options.master_uri, apads))
    accepted = accepted_by(options.accept, findings, apads)
    report = Report(scenario.name, options.master_uri, now(), findings, accepted)
    for key in refuse_red(report, apads, options.despite):
        print(f"musselbed: warning: {key} is red, and a person decided to start despite it", file=sys.stderr)
    for key, person in accepted.items():
        print(f"musselbed: warning: {key} cannot be told, and {person} accepts that", file=sys.stderr)
    for finding in findings:
        if finding.status is not CheckStatus.OK:
            print(f"musselbed: {finding.line()}", file=sys.stderr)
    return report


def check_real_vehicle(options: RunOptions, scenario: Scenario) -> None:
    """Refuses a real aPad without what keeps it safe, before anything starts."""
    if not options.has_real_vehicle:
        return
    problems = problems_with_real_vehicle(scenario)
    if options.on_death is OnDeath.RESUME:
        problems.append(
            "a real aPad moves again only after a person confirms: leave --on-supervisor-death resume out, and call "
            "musselbed resume"
        )
    if problems:
        raise UserError("\n".join(problems))


def show_docks_in_use(options: RunOptions, scenario: Scenario) -> None:
    """Warns of docks of somebody's aPad that hold something already, which a new run takes for empty or for its own."""
    if options.apad is not APadKind.ROS:
        return
    from apad_bridge.doctor.apad_checks import check_docks
    from apad_bridge.doctor.finding import run_check
    from apad_bridge.doctor.graph_checks import Graph
    from apad_bridge.doctor.live_apad import LiveAPad
    from apad_bridge.doctor.network import Unreachable
    from apad_bridge.ros.door import DOOR

    try:
        found = Graph.read(somebodys_master())
    except (Unreachable, PeerFailed):
        return  # the run itself says so
    for name in scenario.apad_names:
        apad = LiveAPad(DOOR, found, in_full(options.namespace, name))
        for finding in run_check("docks", partial(check_docks, apad, scenario), apad.name):
            if finding.status is not CheckStatus.OK:
                print(
                    f"musselbed: warning: {finding.check}: {finding.found}: {finding.mend}", file=sys.stderr
                )


def _refuse_for_several(options: RunOptions, scenario: Scenario) -> None:
    refuse(
        (
            scenario.sharing.consensus is not None and options.time is not TimeSource.ASAP,
            "sharing.consensus: aPads agree in virtual time alone: add --time asap, or leave the key out",
        ),
        (options.script, "a script flies one aPad, and the scenario names several: leave `apads` out"),
        (
            options.part is not BenchPart.WHOLE,
            f"{options.part.value}: the scenario names several aPads: `musselbed run` flies them; "
            "or leave `apads` out, and give each its fleet.share",
        ),
        (options.modem, "--modem: a physical modem has one aPad: leave it out, or `apads` in the scenario"),
        (
            options.open_modems,
            "--open-modem opens a modem beside one aPad: leave it out, or `apads` in the scenario",
        ),
        (
            options.dry_run and options.apad is APadKind.ROS,
            "--dry-run of several aPads plans without ROS: leave out --apad ros",
        ),
    )


def _check_boards(options: RunOptions, scenario: Scenario) -> None:
    """UserError, with the mend, for a real board on a serial line that cannot be flown so."""
    if options.part is BenchPart.MISSION or options.dry_run:
        return
    for program in scenario.fleet.firmware:
        if (line := serial_line(program.executable)) is None:
            continue
        key = f"fleet.firmware {program.executable}"
        refuse(
            (_is_fast(options), f"{key}: a real board takes real time: use --time wall, without --speed"),
            (not Path(line[0]).exists(), f"{key}: there is no such device; is the board plugged in?"),
        )


def _is_fast(options: RunOptions) -> bool:
    return options.time is TimeSource.ASAP or options.speed != 1


def _check_opened(options: RunOptions, scenario: Scenario) -> None:
    """UserError, with the mend, for the first modem that cannot be opened."""
    ids = scenario.fleet.ids
    fleet = f"there is no such aMussel; the fleet's are {in_ranges(ids)}" if ids else "the fleet is empty"
    refuse(
        *((it not in ids, f"--open-modem {it}: {fleet}") for it in options.open_modems),
        (
            options.part is BenchPart.MISSION,
            "--open-modem needs a fleet: a mission alone has no aMussels; use it with `musselbed fleet`",
        ),
        (
            options.time is TimeSource.ASAP,
            "--open-modem needs real time, as your driver does: use --time wall",
        ),
        (options.modem, "--open-modem and --modem exclude each other: simulated sound, or real sound"),
        (
            scenario.water is None,
            "--open-modem needs water between modems: add the block `water: {}` to the scenario, "
            "or what its own key says (docs/reference/scenario-keys.md)",
        ),
    )


def _check_physical(options: RunOptions, scenario: Scenario) -> None:
    """UserError, with the mend, for a physical modem that cannot be used."""
    refuse(
        (
            not scenario.time_scale.is_real,
            f"--modem: real sound cannot be accelerated, and theta is {scenario.theta}: say --theta 1",
        ),
        (_is_fast(options), "--modem: real sound takes real time: use --time wall, without --speed"),
        (
            scenario.water is not None,
            "--modem: the real water carries the sound: take the block `water` out of the scenario, or leave --modem out",
        ),
        (
            not Path(options.modem).exists(),
            f"--modem {options.modem}: there is no such device; is the modem plugged in?",
        ),
    )
