"""One bag of a vehicle as tracks and works: where it was, what it did, what its battery and its docks said.

The vehicle's own topics come before what a supervisor repeats of them, kind by kind.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from apad_bridge.field.field_log.log_facts import (
    BatteryReading,
    Held,
    LoggedFact,
    Place,
    Posed,
    SoundEnded,
    Witness,
    Work,
    WorkBegan,
    WorkEnded,
)

Floats = npt.NDArray[np.float64]
_SAME_S = 1.5
"""A supervisor's order and the vehicle's begin lie within a tick and a message."""
_JUMP_S = 60.0
"""No way delays a message by so much: a stamp that is off by more is of a clock that was set."""
LogFact = TypeVar("LogFact", Posed, BatteryReading, Held, WorkBegan, WorkEnded)


@dataclass(frozen=True, slots=True)
class Done:
    """A go-to, docking or undocking with its end. `is_done` and `missed` as in `WorkEnded`."""

    work: Work
    began_s: float
    ended_s: float
    is_done: bool
    missed: bool
    goal_m: Place | None = None
    agent_id: int | None = None


@dataclass(frozen=True, slots=True)
class Track:
    """Times rising, and the places at them: arrays of one length."""

    times_s: Floats
    north_m: Floats
    east_m: Floats

    def between(self, from_s: float, to_s: float) -> Track:
        low, high = np.searchsorted(self.times_s, [from_s, to_s])
        return Track(self.times_s[low:high], self.north_m[low:high], self.east_m[low:high])

    def __len__(self) -> int:
        return len(self.times_s)


@dataclass(frozen=True, slots=True)
class BatteryReadings:
    """Readings: times rising, charges in [0, 1]."""

    times_s: Floats
    fractions: Floats


@dataclass(slots=True)
class VehicleLog:
    """`works` by their begin. `missing` has a line for each definition of the bag that lacks a field."""

    name: str
    track: Track
    battery: BatteryReadings
    works: list[Done]
    tries: list[Done]
    """Each try of a docking mechanism: a supervisor counts several tries as one docking."""
    servos: list[Done]
    """Generation B's own dockings and undockings by visual servoing, which name no aMussel."""
    held: list[tuple[float, int]]
    """(time, aMussels in docks from then on), by time; empty where nobody says what the docks hold."""
    sounds: list[SoundEnded]
    missing: list[str] = field(default_factory=list)

    def of(self, *works: Work) -> list[Done]:
        return [it for it in self.works if it.work in works]

    def dock_seconds(self, times_s: Floats) -> Floats:
        """At each of these rising times, the seconds that docks have held an aMussel, summed over docks."""
        edges_s = [it for it, _ in self.held]
        counts = [count for _, count in self.held]
        if not edges_s:
            return np.zeros(len(times_s))
        sums = np.concatenate(([0.0], np.cumsum(np.diff(edges_s) * counts[:-1])))
        place = np.searchsorted(edges_s, times_s, side="right") - 1
        inside = np.maximum(place, 0)
        since_s = times_s - np.array(edges_s)[inside]
        return np.where(place < 0, 0.0, sums[inside] + since_s * np.array(counts)[inside])


def vehicle_log(name: str, facts: Sequence[LoggedFact], missing: Iterable[str] = ()) -> VehicleLog:
    own, ordered = _works(facts)
    reported_go_tos = [it for it in ordered if it.work is Work.GO_TO]
    go_tos = [_with_goal(it, reported_go_tos) for it in own if it.work is Work.GO_TO] or reported_go_tos
    # A supervisor's docking is the whole of it, with what the bench waits; the vehicle's is its mechanism's part.
    docks = [it for it in ordered if it.work is not Work.GO_TO] or [
        it for it in own if it.work is not Work.GO_TO
    ]
    return VehicleLog(
        name=name,
        track=_track(_better([it for it in facts if isinstance(it, Posed)])),
        battery=_battery(_better([it for it in facts if isinstance(it, BatteryReading)])),
        works=sorted([*go_tos, *docks], key=lambda it: it.began_s),
        # Generation B names no aMussel, and never reports whether it caught one.
        tries=[it for it in own if it.work is Work.DOCK and it.agent_id is not None]
        or [it for it in ordered if it.work is Work.DOCK],
        servos=[it for it in own if it.work is not Work.GO_TO and it.agent_id is None],
        held=_held(_better([it for it in facts if isinstance(it, Held)])),
        sounds=[it for it in facts if isinstance(it, SoundEnded)],
        missing=list(missing),
    )


def _better(found: list[LogFact]) -> list[LogFact]:
    """The vehicle's own word, or else that of a supervisor."""
    return [it for it in found if it.witness is Witness.VEHICLE] or found


def _track(poses: list[Posed]) -> Track:
    """By the messages' own stamps, which no network delays, moved to the recorder's clock as a whole.

    A message whose stamp has jumped from the others' counts when it was recorded.
    """
    at_s = np.array([it.at_s for it in poses])
    sent_s = np.array([np.nan if it.sent_s is None else it.sent_s for it in poses])
    if len(poses) and np.isfinite(sent_s).all():
        moved_s = sent_s + np.median(at_s - sent_s)
        at_s = np.where(np.abs(moved_s - at_s) < _JUMP_S, moved_s, at_s)
    # A message that came twice, or late, must not turn time back.
    order = np.flatnonzero(np.diff(np.maximum.accumulate(at_s), prepend=-np.inf) > 0)
    places = np.array([it.place_m for it in poses], dtype=float).reshape(-1, 2)
    return Track(at_s[order], places[order, 0], places[order, 1])


def _battery(found: list[BatteryReading]) -> BatteryReadings:
    ordered = sorted(found, key=lambda it: it.at_s)
    return BatteryReadings(np.array([it.at_s for it in ordered]), np.array([it.fraction for it in ordered]))


def _works(facts: Iterable[LoggedFact]) -> tuple[list[Done], list[Done]]:
    """The vehicle's works by its own word, and those that a supervisor told.

    A work without a reported end ends when the next one of the same witness begins: a new order pre-empts.
    """
    done: dict[Witness, list[Done]] = {Witness.VEHICLE: [], Witness.SUPERVISOR: []}
    running: dict[Witness, WorkBegan] = {}

    def end(began: WorkBegan, at_s: float, *, is_done: bool, missed: bool) -> None:
        work = Done(
            work=began.work,
            began_s=began.at_s,
            ended_s=at_s,
            is_done=is_done,
            missed=missed,
            goal_m=began.goal_m,
            agent_id=began.agent_id,
        )
        done[began.witness].append(work)

    for it in facts:
        if isinstance(it, WorkBegan):
            if (before := running.pop(it.witness, None)) is not None and before.key != it.key:
                end(before, it.at_s, is_done=False, missed=False)
            running[it.witness] = it
        elif isinstance(it, WorkEnded):
            began = running.get(it.witness)
            if began is not None and began.key == it.key:
                del running[it.witness]
                end(began, it.at_s, is_done=it.is_done, missed=it.missed)
    return done[Witness.VEHICLE], done[Witness.SUPERVISOR]


def _with_goal(done: Done, found: list[Done]) -> Done:
    """Generation B's services leave no goal in a log: that of the supervisor's go-to that began at the same time."""
    if done.goal_m is not None:
        return done
    goals = [it.goal_m for it in found if abs(it.began_s - done.began_s) <= _SAME_S]
    return replace(done, goal_m=goals[-1]) if goals else done


def _held(found: list[Held]) -> list[tuple[float, int]]:
    docked: set[int] = set()
    counts: list[tuple[float, int]] = []
    for it in sorted(found, key=lambda it: it.at_s):
        (docked.add if it.is_held else docked.discard)(it.agent_id)
        counts.append((it.at_s, len(docked)))
    return counts
