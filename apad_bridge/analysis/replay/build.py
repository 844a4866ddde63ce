"""Builds a run's replay.html: one file that opens from disk, without a network and without the run's other files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from apad_bridge.analysis.energy.energy import rails_of
from apad_bridge.analysis.replay.series import add_rails, whole_view
from apad_bridge.events.person_orders import PERSON_ORDERS, Act, Button, PersonOrder
from apad_bridge.records.journal import JournalContents, read_journal
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.records.run_state import RunState
from apad_bridge.records.sample_file import read_samples
from apad_bridge.scenario.run_options import RunOptions
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.text.text_file import write_atomically

SCRIPTS = ("colours.js", "plots.js", "map.js", "details.js", "stops.js", "view.js", "page.js", "live.js")
"""The page's own, in the order in which it has them."""
_LONGEST_VALUE = 80


def build_replay(run_dir: Path) -> Path:
    """Writes the run's replay.html from its journal so far, and returns its path.

    A run of several aPads has one page with all of them, in the directory that holds theirs. RunDirectoryError, one line,
    when the directory holds no run that can be shown.
    """
    apads = sorted(it.parent for it in run_dir.glob("*/journal.jsonl"))
    if apads and not (run_dir / "journal.jsonl").is_file():
        page = RunDirectory(run_dir).replay
        write_atomically(page, render([_named(it) for it in apads]))
        return page
    directory = RunDirectory.open(run_dir)
    write_atomically(directory.replay, render([_whole(directory)]))
    return directory.replay


def build_comparison(run_dir: Path, other_dir: Path) -> Path:
    """Writes one page with both runs side by side and what differs, into the first run's directory; returns its path.

    RunDirectoryError, one line, when one of them holds no run that can be shown, or holds those of several aPads.
    """
    first, other = _named(run_dir), _named(other_dir)
    if first["run_name"] == other["run_name"]:
        first["run_name"], other["run_name"] = str(run_dir), str(other_dir)
    settings = [_settings(RunDirectory(it)) for it in (run_dir, other_dir)]
    first["differs"] = [
        [key, *(_words(it.get(key)) for it in settings)]
        for key in {**settings[0], **settings[1]}
        if settings[0].get(key) != settings[1].get(key)
    ]
    page = RunDirectory(run_dir).replay.with_name(f"compared-with-{other_dir.resolve().name}.html")
    write_atomically(page, render([first, other]))
    return page


def _named(run_dir: Path) -> dict[str, Any]:
    """A run's data, under the name of its directory."""
    return {**_whole(RunDirectory.open(run_dir)), "run_name": run_dir.resolve().name}


def _whole(directory: RunDirectory) -> dict[str, Any]:
    """A run's data with the rails of its boards, as far as its journal is whole and a second run is the same."""
    scenario, journal, _, _, data = read_run(directory)
    if journal.dropped == 0:
        try:
            add_rails(data, rails_of(scenario, journal))
        except (KeyError, TypeError, ValueError):
            # A journal of another version, which this firmware cannot follow, or a codec that is not installed here.
            data["rails"] = []
    return data


def _settings(directory: RunDirectory) -> dict[str, Any]:
    """The values of the resolved scenario, by dotted keys."""

    def flat(at: str, value: Any) -> Iterator[tuple[str, Any]]:
        if isinstance(value, dict):
            for key, inner in value.items():
                yield from flat(f"{at}.{key}" if at else str(key), inner)
        else:
            yield at, value

    return dict(flat("", yaml.safe_load(directory.scenario.read_text(encoding="utf-8"))))


def _words(value: Any) -> str:
    text = "" if value is None else str(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}…"


class ShownRun(NamedTuple):
    """A run's records, its state at their end, and the page's data."""

    scenario: Scenario
    journal: JournalContents
    summary: dict[str, Any] | None
    state: RunState
    data: dict[str, Any]


def read_run(directory: RunDirectory) -> ShownRun:
    """RunDirectoryError, one line, when the directory holds no run that can be shown."""
    try:
        scenario, journal = directory.load_scenario(), read_journal(directory.journal)
        summary = directory.read_summary()
        view = whole_view(scenario, journal, read_samples(directory.samples))
        data = {**view.data(summary), "is_real": _is_real(directory)}
        return ShownRun(scenario, journal, summary, view.state, data)
    except RunDirectoryError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise RunDirectoryError(f"{directory.journal}: cannot be shown: {error}") from error


def _is_real(directory: RunDirectory) -> bool:
    try:
        return RunOptions.load(directory.path).is_beside_real_vehicle
    except FileNotFoundError:  # a flight in virtual time
        return False


def render(runs: list[dict[str, Any]]) -> str:
    """The page, with styles, data and scripts in it; the runs are those of the aPads of one flight, or two to compare."""
    # "<" is escaped, so that no text of a scenario can end the script element that holds the data.
    encoded = json.dumps(runs, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    buttons = [
        (it.in_bar, _button(act, order, it)) for act, order in PERSON_ORDERS.items() for it in order.buttons
    ]
    parts = {
        "TITLE": escape(f"{runs[0]['name']} - {'live' if 'live' in runs[0] else 'replay'}"),
        "LICENSE": _resource("uplot/LICENSE"),
        "STYLE": _resource("uplot/uPlot.min.css") + _resource("page.css"),
        "DATA": encoded,
        "LIBRARY": _resource("uplot/uPlot.iife.min.js"),
        "SCRIPT": "".join(map(_resource, SCRIPTS)),
        "BAR": "".join(text for in_bar, text in buttons if in_bar),
        "ORDERS": "".join(text for in_bar, text in buttons if not in_bar),
    }
    page = _resource("page.html")
    for name, text in parts.items():
        before, after = page.split(f"<!--{name}-->")
        page = before + text + after
    return page


def _button(act: Act, order: PersonOrder, button: Button) -> str:
    named = {
        "id": button.id,
        "title": button.title,
        "data-act": act,
        "data-asks": button.asks,
        "data-sends": json.dumps(button.sends),
        "data-names": "stop" if "--stop" in order.arguments else "",
    }
    told = "".join(f' {name}="{escape(it)}"' for name, it in named.items() if it)
    return f'<button class="order"{told}>{escape(button.label)}</button>\n'


def _resource(name: str) -> str:
    return (files("apad_bridge.analysis.replay") / name).read_text(encoding="utf-8")
