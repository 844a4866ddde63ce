"""Builds a run's replay.html: one file that opens from disk, without a network and without the run's other files."""

from __future__ import annotations

import json
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from apad_bridge.analysis.replay.series import page_data
from apad_bridge.records.journal import JournalContents, read_journal
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.scenario.errors import ScenarioError
from apad_bridge.scenario.loader import load, write_atomically
from apad_bridge.scenario.schema import Scenario

_SCRIPTS = ("plots.js", "map.js", "details.js", "page.js", "live.js")


def build_replay(run_dir: Path) -> Path:
    """Writes the run's replay.html from its journal so far, and returns its path.

    A run of several aPads has one page with all of them, in the directory that holds theirs. RunDirectoryError, one line,
    when the directory holds no run that can be shown.
    """
    apads = sorted(it.parent for it in run_dir.glob("*/journal.jsonl"))
    if apads and not (run_dir / "journal.jsonl").is_file():
        page = RunDirectory(run_dir).replay
        write_atomically(
            page, render([{**read_run(RunDirectory(it)).data, "apad_name": it.name} for it in apads])
        )
        return page
    directory = RunDirectory.open(run_dir)
    write_atomically(directory.replay, render([read_run(directory).data]))
    return directory.replay


class ShownRun(NamedTuple):
    """A run's records, and the page's data made of them."""

    scenario: Scenario
    journal: JournalContents
    summary: dict[str, Any] | None
    data: dict[str, Any]


def read_run(directory: RunDirectory) -> ShownRun:
    """RunDirectoryError, one line, when the directory holds no run that can be shown."""
    try:
        scenario, journal = load(directory.scenario), read_journal(directory.journal)
        summary = _summary(directory)
        return ShownRun(scenario, journal, summary, page_data(scenario, journal, summary))
    except ScenarioError as error:
        raise RunDirectoryError(error.lines[0]) from error
    except RunDirectoryError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise RunDirectoryError(f"{directory.journal}: cannot be shown: {error}") from error


def render(runs: list[dict[str, Any]]) -> str:
    """The page, with styles, data and scripts in it; the runs are those of the aPads of one flight."""
    # "<" is escaped, so that no text of a scenario can end the script element that holds the data.
    encoded = json.dumps(runs, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    parts = {
        "TITLE": escape(f"{runs[0]['name']} - musselbed replay"),
        "STYLE": _resource("page.css"),
        "DATA": encoded,
        "SCRIPT": "".join(map(_resource, _SCRIPTS)),
    }
    page = _resource("page.html")
    for name, text in parts.items():
        before, after = page.split(f"<!--{name}-->")
        page = before + text + after
    return page


def _summary(directory: RunDirectory) -> dict[str, Any] | None:
    """The run's summary; None for a run that has not ended."""
    if not directory.summary.is_file():
        return None
    summary: dict[str, Any] = json.loads(directory.summary.read_text(encoding="utf-8"))
    return summary


def _resource(name: str) -> str:
    return (files("apad_bridge.analysis.replay") / name).read_text(encoding="utf-8")
