"""Marks of the runs that this user began on this machine and that name code: strategies in files, and firmware.

A mark is a file in the user's state folder, so whoever sends or alters a run's directory cannot make one. It is named by
the directory's place, and holds a digest of the scenario and of all code that it names. So no copy, no run that was moved
and no altered run has one.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path

from agents.nursery.fleet_file import FLEET_NAME, FleetFile
from apad_bridge.planning.registry import InFile, label
from apad_bridge.records.run_directory import PRIVATE, RunDirectory
from apad_bridge.runs.nurseries import FOLDER
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.text.text_file import write_atomically


def code_of(directory: RunDirectory, scenario: Scenario | None = None) -> list[str]:
    """The names of all code that a resumed run would execute, as people read them. ScenarioError as `load`.

    `scenario` is the run's, where it need not be loaded.
    """
    scenario = scenario or load(directory.scenario)
    strategies = (scenario.mission.collection, scenario.mission.redeployment)
    commands = _commands(scenario)
    if _prepared_commands(directory) not in (None, commands):
        commands = [*commands, f"{FOLDER}/{FLEET_NAME}"]
    return list(dict.fromkeys([*(label(it) for it in strategies if InFile.of(it)), *commands]))


def mark(directory: RunDirectory, scenario: Scenario | None = None) -> None:
    """Marks a run that begins, if it names code, and removes the marks of directories that are gone.

    OSError where nothing can be kept; RuntimeError for a user without a home. `scenario` as for `code_of`.
    """
    if not code_of(directory, scenario):
        return
    folder = _folder()
    folder.mkdir(mode=PRIVATE, parents=True, exist_ok=True)
    for old in folder.glob("*.json"):
        if not _is_of_a_run(old):
            old.unlink(missing_ok=True)
    data = {"run": os.path.realpath(directory.path), "digest": _digest(directory)}
    write_atomically(_mark_of(directory), json.dumps(data) + "\n")


def is_own(directory: RunDirectory) -> bool:
    """True for a marked run whose scenario, code and prepared fleet are those with which it began."""
    try:
        marked = json.loads(_mark_of(directory).read_text())
        fleet = _prepared_commands(directory)
        return bool(marked["digest"] == _digest(directory)) and fleet in (
            None,
            _commands(load(directory.scenario)),
        )
    except (OSError, ValueError, KeyError, TypeError, RuntimeError):
        return False


def _is_of_a_run(kept: Path) -> bool:
    try:
        return Path(json.loads(kept.read_text())["run"]).exists()
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _folder() -> Path:
    """`$XDG_STATE_HOME/musselbed/runs`; a relative value counts as none, as its specification says."""
    given = os.environ.get("XDG_STATE_HOME", "")
    state = Path(given) if os.path.isabs(given) else Path.home() / ".local" / "state"
    return state / "musselbed" / "runs"


def _mark_of(directory: RunDirectory) -> Path:
    return _folder() / f"{hashlib.sha256(os.fsencode(os.path.realpath(directory.path))).hexdigest()}.json"


def _digest(directory: RunDirectory) -> str:
    """The SHA-256 of the scenario's file, and of the name and content of each file of code that it names."""
    digest = hashlib.sha256(directory.scenario.read_bytes())
    for name in _files(load(directory.scenario)):
        digest.update(hashlib.sha256(os.fsencode(name)).digest())
        digest.update(hashlib.sha256(Path(name).read_bytes()).digest())
    return digest.hexdigest()


def _files(scenario: Scenario) -> Iterator[str]:
    """The files of strategies and of firmware; a file among a firmware's arguments may be its program."""
    for strategy in (scenario.mission.collection, scenario.mission.redeployment):
        if (in_file := InFile.of(strategy)) is not None:
            yield in_file.path
    for program in scenario.fleet.firmware:
        yield from (it for it in (program.executable, *program.arguments) if os.path.isfile(it))


def _commands(scenario: Scenario) -> list[str]:
    return [" ".join((it.executable, *it.arguments)) for it in scenario.fleet.firmware]


def _prepared_commands(directory: RunDirectory) -> list[str] | None:
    """The firmware that another nursery of this run would start; None for a run without a fleet's file."""
    folder = directory.path / FOLDER
    if not (folder / FLEET_NAME).exists():
        return None
    return [" ".join(it.command) for it in FleetFile.read(str(folder)).fleet.firmware]
