"""Collects a report's contents from a run: figures and series, energy, beliefs' scores, faults and what followed."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, NamedTuple

from apad_bridge.analysis.belief_scores.comparisons import best_record, comparisons_in
from apad_bridge.analysis.belief_scores.scores import Scores, scores_of
from apad_bridge.analysis.energy.energy import AgentEnergy, energy_of
from apad_bridge.analysis.replay.build import read_run
from apad_bridge.analysis.replay.history import ShownEvent, shown_event
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import PRE_EMPTED, PrimitiveChanged, StepGivenUp
from apad_bridge.records.journal import Entry
from apad_bridge.records.run_directory import RunDirectory, RunDirectoryError
from apad_bridge.scenario.firmware_config import charge_models
from firmware_model.power.charge import ChargeModel

_PERIOD_MS = 10_000
"""Between two comparisons of beliefs, as `musselbed beliefs` has it."""
_FOLLOWS_MS = 600_000
_MOST_FOLLOWING = 4
_MOST_FAULTS = 200


class Trouble(NamedTuple):
    """A fault, and the events of the next ten minutes: of that aMussel, or of all where it is of none."""

    fault: ShownEvent
    followed: tuple[ShownEvent, ...]


@dataclass(frozen=True, slots=True)
class RunReport:
    name: str
    """The name of the run's directory."""
    flown_on: str
    """The day of the run's begin."""
    versions: dict[str, Any]
    """The software that flew it, by versions.json; empty where that file is missing."""
    data: dict[str, Any]
    """The series of the replay page."""
    summary: dict[str, Any] | None
    """None for a run that has not ended."""
    charge_model: ChargeModel
    """The charge model of a nominal board."""
    energy: list[AgentEnergy]
    why_no_energy: str | None
    """Why the energy is left out; None if it is not."""
    scores: Scores | None
    """None where no aMussel has both a belief and a truth."""
    why_scored_by_journal: str | None
    """Why the beliefs are not those of the bag; None if they are."""
    troubles: list[Trouble]
    more_troubles: int
    """Number of troubles beyond those in the list."""
    stopped_ms: list[tuple[int, int]]
    """(begin, end) of each span in which a person or a guard kept the mission from the aPad."""


def contents_of(directory: RunDirectory) -> RunReport:
    """RunDirectoryError, one line, when the directory holds no run that can be shown."""
    scenario, journal, summary, state, data = read_run(directory)
    troubles = list(troubles_in(journal.entries))
    record, why_journal = best_record(directory.path)
    energy, why_no_energy = _energy(directory) if data["has_truth"] else ([], None)
    return RunReport(
        name=directory.path.resolve().name,
        flown_on=datetime.fromtimestamp(directory.scenario.stat().st_mtime, UTC).date().isoformat(),
        versions=_versions(directory),
        data=data,
        summary=summary,
        charge_model=charge_models(scenario)(0),
        energy=energy,
        why_no_energy=why_no_energy,
        scores=scores_of(comparisons_in(directory.path, _PERIOD_MS, record)),
        why_scored_by_journal=why_journal,
        troubles=troubles[:_MOST_FAULTS],
        more_troubles=max(0, len(troubles) - _MOST_FAULTS),
        stopped_ms=state.interruptions.spans_ms(journal.last_ms),
    )


def _energy(directory: RunDirectory) -> tuple[list[AgentEnergy], str | None]:
    try:
        return energy_of(directory), None
    except RunDirectoryError as error:
        return [], str(error)


def _versions(directory: RunDirectory) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(directory.versions.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found


def troubles_in(entries: Iterable[Entry]) -> Iterator[Trouble]:
    """Yields the faults of a run in their order, each with what followed."""
    told = [
        it for entry in entries if not _is_routine(entry.event) and (it := shown_event(entry)) is not None
    ]
    for n, fault in enumerate(told):
        if fault.category.is_trouble:
            later = (it for it in told[n + 1 :] if it.at_ms <= fault.at_ms + _FOLLOWS_MS)
            same = (it for it in later if fault.agent is None or it.agent == fault.agent)
            yield Trouble(fault, tuple(it for it, _ in zip(same, range(_MOST_FOLLOWING), strict=False)))


def _is_routine(event: Event) -> bool:
    """A go-to that makes way for another has not failed."""
    return isinstance(event, PrimitiveChanged | StepGivenUp) and event.reason == PRE_EMPTED
