"""A run's directory: the names of its files. It is made for one run alone and never written over.

Every file appears whole or not at all, except the journal and the bags, which grow.
"""

from __future__ import annotations

import hashlib
import json
import platform
import shutil
import subprocess
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from typing import Any

from apad_bridge.planning.registry import digest_of_file, label
from apad_bridge.scenario.errors import ScenarioError, UserError
from apad_bridge.scenario.loader import load, with_strategy_copies, with_values, write_resolved
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import save_starts
from apad_bridge.scenario.starts_table import ENDS_NAME, STARTS_NAME, Start
from apad_bridge.scenario.text.text_file import write_atomically
from firmware_model.entry_points import parts_of_others

RUNS = Path("runs")
PRIVATE = 0o700
"""The mode of directories that we make for a run: other users of the machine can reach nothing in them."""
_GIT_S = 3.0
_PACKAGES = ("musselbed", "numpy", "rosbags", "rospy")


class RunDirectoryError(UserError, ValueError):
    """The directory cannot be used; the message is one line with the remedy."""


@dataclass(frozen=True, slots=True)
class RunDirectory:
    path: Path

    @classmethod
    def create(cls, scenario_name: str, now_utc: datetime, out: Path | None = None) -> RunDirectory:
        """Makes a new directory.

        It is `out`, which must be new or empty, or `runs/<scenario>-<UTC stamp>`, with -2, -3 ... if that exists. An empty
        one that is there keeps its mode.
        """
        if out is not None:
            return cls(_claim(out))
        path = RUNS / f"{scenario_name}-{now_utc:%Y%m%dT%H%M%SZ}"
        try:
            return cls(new_folder(path, PRIVATE))
        except OSError as error:
            raise RunDirectoryError(f"{path}: {error.strerror}; choose another place with --out") from error

    @classmethod
    def open(cls, path: Path) -> RunDirectory:
        """Opens a former run's directory; RunDirectoryError when there is no journal in it."""
        if not path.exists():
            raise RunDirectoryError(f"{path}: no such folder: name the directory of a run")
        if not (path / "journal.jsonl").is_file():
            apad_runs = sorted(str(journal.parent) for journal in path.glob("*/journal.jsonl"))
            mend = f"; a run of several aPads has one for each: {', '.join(apad_runs)}" if apad_runs else ""
            raise RunDirectoryError(f"{path}: no run: it has no journal.jsonl{mend}")
        return cls(path)

    @classmethod
    def created(cls, path: Path) -> RunDirectory:
        """Opens the directory of a run that may not have begun; RunDirectoryError when there is no scenario in it."""
        if not (path / "scenario.yaml").is_file():
            raise RunDirectoryError(f"{path}: no run: it has no scenario.yaml")
        return cls(path)

    def of_apad(self, name: str, apads: int) -> RunDirectory:
        """The directory of one aPad's run: this one for the only aPad of a run, else one of its own below."""
        return self if apads == 1 else RunDirectory(self.path / name)

    @property
    def scenario(self) -> Path:
        return self.path / "scenario.yaml"

    @property
    def preflight(self) -> Path:
        """The findings before a real aPad moved."""
        return self.path / "preflight.json"

    @property
    def versions(self) -> Path:
        return self.path / "versions.json"

    @property
    def starts(self) -> Path:
        return self.path / STARTS_NAME

    @property
    def ends(self) -> Path:
        return self.path / ENDS_NAME

    @property
    def journal(self) -> Path:
        return self.path / "journal.jsonl"

    @property
    def samples(self) -> Path:
        return self.path / "samples.jsonl"

    @property
    def checkpoint(self) -> Path:
        return self.path / "checkpoint.jsonl"

    @property
    def summary(self) -> Path:
        return self.path / "summary.json"

    @property
    def replay(self) -> Path:
        return self.path / "replay.html"

    @property
    def bags(self) -> list[Path]:
        """The bags in the order in which they were begun: run.bag, then one for each resume."""
        found: list[Path] = []
        while self._bag(len(found)).exists():
            found.append(self._bag(len(found)))
        return found

    @property
    def next_bag(self) -> Path:
        return self._bag(len(self.bags))

    def read_summary(self) -> dict[str, Any] | None:
        """The run's summary; None before its end. RunDirectoryError for a damaged one, OSError for one nobody may read."""
        try:
            summary = json.loads(self.summary.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (ValueError, RecursionError) as error:
            raise RunDirectoryError(f"{self.summary} is damaged: {error}") from error
        if not isinstance(summary, dict):
            raise RunDirectoryError(f"{self.summary} is damaged: it is no mapping")
        return summary

    def load_scenario(self) -> Scenario:
        """The run's scenario. RunDirectoryError, one line, for one that this version does not take."""
        try:
            return load(self.scenario)
        except ScenarioError as error:
            raise RunDirectoryError(error.lines[0]) from error

    def scenario_as_flown(self) -> Scenario:
        """The run's scenario; starts from a file are those of the run, because that file may have changed since.

        ScenarioError as `load`.
        """
        scenario = load(self.scenario)
        if not isinstance(scenario.fleet.start, str):
            return scenario
        return with_values(scenario, {"fleet.start": str(self.starts.absolute())}, str(self.scenario))

    def write_inputs(self, scenario: Scenario, starts: Iterable[Start]) -> None:
        """Writes the run's inputs: scenario.yaml, starts.csv, versions.json, and the files of strategies."""
        save_starts(self.starts, starts, scenario.area.origin)
        mission = scenario.mission
        digests = {
            label(it): digest
            for it in (mission.collection, mission.redeployment)
            if (digest := digest_of_file(it))
        }
        write_resolved(self.scenario, with_strategy_copies(scenario, self.path) if digests else scenario)
        files = {
            "strategy_files": digests,
            "firmware_files": firmware_digests(scenario),
            "packages_of_others": parts_of_others(),
        }
        self.write_json(self.versions, {**versions(), **{name: it for name, it in files.items() if it}})

    def reduced_to_bags(self, apads: Sequence[str]) -> list[Path]:
        """Moves the bag of each of the aPads' runs beside this directory, as its name and .bag, and removes the rest.

        Returns the bags. Of a run that another supervisor continued all stays, because that one's command still reads it:
        the list is then empty.
        """
        runs = {name: self.of_apad(name, len(apads)) for name in apads}
        if any(len(it.bags) != 1 for it in runs.values()):
            return []
        kept = []
        for name, it in runs.items():
            of_one = self.path.name if len(runs) == 1 else f"{self.path.name}-{name}"
            kept.append(it.bags[0].rename(self.path.with_name(f"{of_one}.bag")))
        shutil.rmtree(self.path)
        return kept

    def write_json(self, path: Path, data: dict[str, Any]) -> None:
        write_atomically(path, json.dumps(data, indent=2, allow_nan=False) + "\n")

    def _bag(self, n: int) -> Path:
        return self.path / ("run.bag" if n == 0 else f"run-{n}.bag")


def firmware_digests(scenario: Scenario) -> dict[str, str]:
    """The SHA-256 of each program on boards, by its path. A real board on a serial line is no file, and has none."""
    programs = {it.executable for it in scenario.fleet.firmware if Path(it.executable).is_file()}
    return {it: hashlib.sha256(Path(it).read_bytes()).hexdigest() for it in sorted(programs)}


def versions() -> dict[str, str | None]:
    """The versions of the software that decides a run's figures; None for a package that is not installed."""
    found: dict[str, str | None] = {"python": platform.python_version(), "commit": _commit()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


def _commit() -> str | None:
    """The commit of our own files, with "-dirty" where some have changed; None for an installation without git."""
    here = Path(__file__).parents[2]
    if not (here / ".git").exists():
        return None
    try:
        described = subprocess.run(
            ["git", "-C", str(here), "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12"],
            capture_output=True,
            text=True,
            timeout=_GIT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return described.stdout.strip() or None


def new_folder(path: Path, mode: int = 0o777) -> Path:
    """Makes the folder `path`; with -2, -3 ... at its name if that exists."""
    for n in count(1):
        folder = path if n == 1 else path.with_name(f"{path.name}-{n}")
        with suppress(FileExistsError):
            folder.mkdir(mode, parents=True)
            break
    return folder


def _claim(out: Path) -> Path:
    try:
        out.mkdir(mode=PRIVATE, parents=True, exist_ok=True)
        taken = any(out.iterdir())
    except OSError as error:
        raise RunDirectoryError(f"{out}: {error.strerror}; --out wants a new or empty directory") from error
    if taken:
        raise RunDirectoryError(
            f"{out}: is not empty; a run never overwrites another: choose a new directory"
        )
    return out
