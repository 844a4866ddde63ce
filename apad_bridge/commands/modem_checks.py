"""Checks the options of a run that opens modems, or attaches a physical one, before anything starts."""

from __future__ import annotations

from pathlib import Path

from apad_bridge.runs.exits import UserError
from apad_bridge.scenario.id_ranges import in_ranges
from apad_bridge.scenario.run_options import Part, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario


def check_modems(options: RunOptions, scenario: Scenario) -> None:
    """UserError, with the mend, for the first option that cannot be used."""
    if options.open_modems:
        _check_opened(options, scenario)
    if options.modem:
        _check_physical(options, scenario)


def _check_opened(options: RunOptions, scenario: Scenario) -> None:
    ids = scenario.fleet.ids
    for agent_id in options.open_modems:
        if agent_id not in ids:
            raise UserError(
                f"--open-modem {agent_id}: there is no such aMussel; the fleet's are {in_ranges(ids)}"
                if ids
                else f"--open-modem {agent_id}: the fleet is empty"
            )
    if options.part is Part.MISSION:
        raise UserError(
            "--open-modem needs a fleet: a mission alone has no aMussels; say it to `musselbed fleet`"
        )
    if options.time is TimeSource.ASAP:
        raise UserError("--open-modem needs real time, which a driver lives in: use --time wall")
    if options.modem:
        raise UserError("--open-modem and --modem exclude each other: simulated sound, or real sound")
    if scenario.water is None:
        raise UserError(
            "--open-modem needs water between modems: add the block `water: {}` to the scenario, "
            "or what its own key says (docs/scenarios.md)"
        )


def _check_physical(options: RunOptions, scenario: Scenario) -> None:
    if scenario.theta != 1:
        raise UserError(
            f"--modem: real sound cannot be accelerated, and theta is {scenario.theta}: say --theta 1"
        )
    if options.time is TimeSource.ASAP or options.speed != 1:
        raise UserError("--modem: real sound takes real time: use --time wall, without --speed")
    if scenario.water is not None:
        raise UserError(
            "--modem: the real water carries the sound: take the block `water` out of the scenario, or leave --modem out"
        )
    if not Path(options.modem).exists():
        raise UserError(f"--modem {options.modem}: there is no such device; is the modem plugged in?")
