"""Beliefs beside truth in a recorded run: what the journal says of both, at times a period apart."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from apad_bridge.beliefs.modes import Mode, mode_of
from apad_bridge.boards import charge_model
from apad_bridge.records.journal import Line, read_journal
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.records.samples import Water
from apad_bridge.replay.history import History
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from firmware_model.states import State


@dataclass(frozen=True, slots=True)
class Compared:
    """One aMussel at one time. Ages are agent time since the newest packet; `deviation` is None for a belief that claims to
    be certain."""

    agent_id: int
    at_ms: int
    age_h: float
    mode: Mode
    """What it was."""
    mode_right: bool
    error: float
    """Of the primary charge, believed less true."""
    deviation: float | None
    covered: bool | None
    """Whether the truth lay in the interval of 95 %."""
    clamped: bool
    """The truth rests at 0 or 1."""
    place_error_m: float | None
    """None in a dock: it is where the aPad is."""


def compared_in(run_dir: Path, period_ms: int) -> Iterator[Compared]:
    """Of every aMussel of which both are journaled. RunDirectoryError, one line, when the directory holds no such run."""
    directory = RunDirectory.open(run_dir)
    try:
        scenario = load(directory.scenario)
    except ScenarioError as error:
        raise RunDirectoryError(error.lines[0]) from error
    history = History(read_journal(directory.journal), scenario.theta, charge_model(scenario.board))
    water = Water(scenario)
    for now_ms in range(0, history.end_ms + 1, period_ms):
        history.advance(now_ms)
        yield from _at(history, water, scenario, now_ms)


def _at(history: History, water: Water, scenario: Scenario, now_ms: int) -> Iterator[Compared]:
    for agent_id, line in sorted(history.now.beliefs.items()):
        truth = history.now.truths.get(agent_id)
        if truth is None:
            continue
        sample = water.sample(truth, max(scenario.theta * now_ms, truth.at_ms))
        mode = mode_of(State(sample.state), sample.primary, sample.secondary)
        deviation = line.get("sd")
        yield Compared(
            agent_id,
            now_ms,
            scenario.theta * (now_ms - line["heard"]) / 3_600_000,
            mode,
            _mode_in(line) is mode,
            line["charge"] - sample.primary,
            deviation,
            None if deviation is None else line["low"] <= sample.primary <= line["high"],
            not 0 < sample.primary < 1,
            None
            if sample.docked
            else math.hypot(line["north_m"] - sample.north_m, line["east_m"] - sample.east_m),
        )


def _mode_in(line: Line) -> Mode:
    if "mode" in line:
        return Mode[line["mode"]]
    return mode_of(State[line["state"]], line["charge"], line["secondary"])
