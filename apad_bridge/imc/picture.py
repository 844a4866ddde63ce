"""A run as a console shows it, read from its journal and from the samples that aMussels uploaded.

Beliefs, not truths: a console on the water knows what the supervisor knows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from apad_bridge.analysis.replay.history import History, ShownEvent
from apad_bridge.events.mission_events import Phase, PrimitiveChanged, PrimitivePhase
from apad_bridge.events.person_events import Overridden, PersonOrdered
from apad_bridge.events.vehicle_events import APadMoved
from apad_bridge.records.journal import Entry, JournalTail
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.records.sample_file import KeptSample, SampleTail
from apad_bridge.scenario.schema import Scenario
from firmware_model.state_groups import BEYOND_HELP, STRANDED, UP_AND_UNDOCKED
from firmware_model.states import State

_NEWEST_MS = 5000
"""The aPad's velocity comes from two positions that are at most so much mission time apart, and old."""


@dataclass(frozen=True, slots=True)
class ConsoleAPad:
    """Metres north and east of the scenario's origin, m/s, radians from north to east."""

    north_m: float
    east_m: float
    heading_rad: float
    velocity_m_s: tuple[float, float]
    voltage_v: float | None
    fraction: float | None


@dataclass(frozen=True, slots=True)
class AMusselView:
    agent_id: int
    north_m: float
    east_m: float
    state: State
    is_docked: bool
    fraction: float
    """Charge of the primary battery."""
    spread: float | None
    """The width of the belief's interval of 95 %; None where an estimator gives none."""

    @property
    def is_up(self) -> bool:
        return self.is_docked or self.state in UP_AND_UNDOCKED

    @property
    def is_lost(self) -> bool:
        return self.state in BEYOND_HELP

    @property
    def is_stranded(self) -> bool:
        return self.state in STRANDED


@dataclass(frozen=True, slots=True)
class PersonsManoeuvre:
    """A person's go-to or hold under way."""

    is_go_to: bool
    goal_m: tuple[float, float]
    whole_m: float
    """The straight way at its beginning; 0 for a hold."""


class RunPicture:
    """Follows one run: `poll` reads what is new, the properties are as of the newest line."""

    def __init__(self, run_dir: Path, scenario: Scenario) -> None:
        """RunDirectoryError, one line, for a directory that holds no run that has begun."""
        self._directory = RunDirectory.open(run_dir)
        self._journal = JournalTail(self._directory.journal)
        begun = self._journal.read_new()
        self._history = History(begun, scenario)
        self._samples = SampleTail(self._directory.samples)
        self._track: tuple[tuple[int, APadMoved], ...] = ()
        """The newest two places of the aPad, with their mission times."""
        self.manoeuvre: PersonsManoeuvre | None = None
        self.last_failed: bool | None = None
        """Result of a person's last go-to; None while there was none."""
        self._reported_events = 0
        self._take(begun.entries)
        self._history.advance(self._history.end_ms)
        self._reported_events = len(self._history.events)  # a console that comes later gets no old news

    def poll(self) -> list[ShownEvent]:
        """Reads what is new, and returns the new events for people."""
        new = self._journal.read_new()
        self._history.add(new)
        self._take(new.entries)
        self._history.advance(self._history.end_ms)
        events = self._history.events[self._reported_events :]
        self._reported_events += len(events)
        return events

    def new_samples(self) -> Iterator[KeptSample]:
        """The samples that were uploaded since the last call."""
        return self._samples.new_samples()

    def close(self) -> None:
        self._journal.close()
        self._samples.close()

    @property
    def ended_by(self) -> str | None:
        return self._history.now.ended_by

    @property
    def has_summary(self) -> bool:
        return self._directory.summary.is_file()

    @property
    def phase(self) -> str:
        return self._history.now.phase

    @property
    def primitive(self) -> str:
        return self._history.now.primitive

    @property
    def is_by_hand(self) -> bool:
        return self.phase == Phase.COMMANDED.value

    @property
    def apad(self) -> ConsoleAPad | None:
        if (seen := self._history.now.apad) is None:
            return None
        return ConsoleAPad(
            seen.north_m,
            seen.east_m,
            seen.heading_rad,
            self._velocity_m_s(),
            seen.voltage_v,
            seen.battery,
        )

    @property
    def amussels(self) -> list[AMusselView]:
        """Every aMussel that was heard, by id; one in a dock is where the aPad is."""
        now = self._history.now
        views = []
        for agent_id, belief in sorted(now.beliefs.items()):
            is_docked = agent_id in now.docks and now.apad is not None
            place = now.apad if is_docked and now.apad is not None else belief
            low, high = belief.low, belief.high
            views.append(
                AMusselView(
                    agent_id=agent_id,
                    north_m=place.north_m,
                    east_m=place.east_m,
                    state=belief.state,
                    is_docked=is_docked,
                    fraction=belief.charge,
                    spread=None if low is None or high is None else high - low,
                )
            )
        return views

    @property
    def progress(self) -> float | None:
        """The part of the go-to's way that is behind the aPad, 0 to 1; None without a go-to."""
        if self.manoeuvre is None or not self.manoeuvre.is_go_to or self.apad is None:
            return None
        left_m = math.dist((self.apad.north_m, self.apad.east_m), self.manoeuvre.goal_m)
        return max(0.0, 1 - left_m / self.manoeuvre.whole_m) if self.manoeuvre.whole_m else 1.0

    def _take(self, entries: list[Entry]) -> None:
        for at_ms, event in entries:
            match event:
                case APadMoved():
                    self._track = (*self._track[-1:], (at_ms, event))
                case PersonOrdered(
                    order="go to" | "hold", north_m=float() | int() as north, east_m=float() | int() as east
                ):
                    self._begin(event.order == "go to", (north, east))
                case PersonOrdered(order="stop" | "abort") | Overridden(taken=False):
                    self.manoeuvre = None
                case PrimitiveChanged(
                    name="go to point", phase=PrimitivePhase.SUCCEEDED | PrimitivePhase.FAILED
                ):
                    self._end(event)

    def _begin(self, is_go_to: bool, goal_m: tuple[float, float]) -> None:
        here = self._track[-1][1] if self._track else None
        whole_m = math.dist((here.north_m, here.east_m), goal_m) if here and is_go_to else 0.0
        self.manoeuvre = PersonsManoeuvre(is_go_to, goal_m, whole_m)

    def _end(self, go_to: PrimitiveChanged) -> None:
        manoeuvre = self.manoeuvre
        if manoeuvre is None or not manoeuvre.is_go_to or go_to.north_m is None or go_to.east_m is None:
            return
        if (
            math.dist((go_to.north_m, go_to.east_m), manoeuvre.goal_m) < 1e-3
        ):  # not the one that it pre-empted
            self.manoeuvre, self.last_failed = None, go_to.phase is PrimitivePhase.FAILED

    def _velocity_m_s(self) -> tuple[float, float]:
        if len(self._track) < 2:
            return 0.0, 0.0
        (before_ms, before), (now_ms, now) = self._track
        span_ms = now_ms - before_ms
        if not 0 < span_ms <= _NEWEST_MS or self._history.end_ms - now_ms > _NEWEST_MS:
            return 0.0, 0.0
        return (
            1000 * (now.north_m - before.north_m) / span_ms,
            1000 * (now.east_m - before.east_m) / span_ms,
        )
