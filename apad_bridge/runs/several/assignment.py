"""Who serves whom while several aPads fly: planned again when one of them stands down. Pure; built from beliefs.

Every aMussel is in exactly one share at any time. Nobody is moved while a dock holds it, while an aPad comes for it, or on
its way up or down. One that a failed aPad called up is moved once it is down again, or lies empty at the surface; one in
a dock of it stays with it.

What the planner of several aPads sees of one of them: what its supervisor believes, and nothing else.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.modes import LIKELY, SUBMERGED, Mode
from apad_bridge.mission.pool import floats
from apad_bridge.mission.state import Phase
from apad_bridge.planning.shares import Point, shares
from apad_bridge.supervisor.core import Supervisor
from firmware_model.state_groups import AT_WORK, BEYOND_HELP, STRANDED


@dataclass(frozen=True, slots=True)
class Seen:
    """An aPad and those that it serves, as they are believed to be; metres."""

    name: str
    is_down: bool
    place_m: Point
    places_m: Mapping[int, Point] = field(default_factory=dict)
    """Of those that may need somebody: believed in, and not lost."""
    movable: frozenset[int] = frozenset()
    """Of these, who may be moved."""


@dataclass(frozen=True, slots=True)
class Move:
    agent_id: int
    giver: str
    taker: str


class Sharing:
    """Keeps the book. `look` says who shall be moved, `moved` that one was."""

    def __init__(self, served: Mapping[str, Iterable[int]]) -> None:
        """ValueError when two serve the same."""
        self._of = {name: frozenset(ids) for name, ids in served.items()}
        everybody = [agent_id for ids in self._of.values() for agent_id in ids]
        if len(set(everybody)) < len(everybody):
            raise ValueError("an aMussel is in two shares")
        self._planned_without: frozenset[str] = frozenset()

    @property
    def shares(self) -> Mapping[str, frozenset[int]]:
        return dict(self._of)

    def look(self, seen: Sequence[Seen]) -> list[Move]:
        """By id. All who can be moved are planned anew when an aPad has stood down; later, only who it still had."""
        up = [it for it in seen if not it.is_down]
        stranded = {it.name: self._stranded(it) for it in seen if it.is_down}
        if not up or not any(stranded.values()):
            return []
        down = frozenset(stranded)
        is_new = not down <= self._planned_without
        self._planned_without |= down
        owners = {agent_id: it.name for it in seen for agent_id in self._of[it.name] & it.places_m.keys()}
        places_m = {
            agent_id: it.places_m[agent_id] for it in seen for agent_id in it.places_m.keys() & owners
        }
        index = {it.name: n for n, it in enumerate(up)}
        free = {agent_id for ids in stranded.values() for agent_id in ids}
        if is_new:
            free |= {agent_id for it in up for agent_id in it.movable}
        asked = {i: at for i, at in places_m.items() if owners[i] in index or i in free}
        stays = {i: index[owners[i]] for i in asked.keys() - free}
        planned = shares([_centre(it, self._of[it.name]) for it in up], asked, stays)
        return sorted(
            (
                Move(agent_id, owners[agent_id], it.name)
                for it, allocation in zip(up, planned, strict=True)
                for agent_id in allocation
                if owners[agent_id] != it.name
            ),
            key=lambda move: move.agent_id,
        )

    def moved(self, move: Move) -> None:
        """ValueError, and nothing changed, when the giver does not serve it."""
        if move.agent_id not in self._of[move.giver]:
            raise ValueError(f"{move.giver} does not serve aMussel {move.agent_id}")
        self._of[move.giver] -= {move.agent_id}
        self._of[move.taker] |= {move.agent_id}

    def _stranded(self, seen: Seen) -> Collection[int]:
        return seen.movable & self._of[seen.name]


def _centre(seen: Seen, served: frozenset[int]) -> Point:
    """The middle of those that it serves, so that shares change no more than they must; where it is, if it serves none."""
    places_m = [at for agent_id, at in seen.places_m.items() if agent_id in served]
    if not places_m:
        return seen.place_m
    return (
        sum(north_m for north_m, _ in places_m) / len(places_m),
        sum(east_m for _, east_m in places_m) / len(places_m),
    )


def seen_of(name: str, start_m: tuple[float, float], supervisor: Supervisor) -> Seen:
    """`start_m` is where it is taken to be before it was ever heard."""
    state, pose = supervisor.mission.state, supervisor.pose
    is_down = state.phase is Phase.STANDS_DOWN
    busy = {step.agent_id for step in state.plan.steps} | set(dict(state.docked).values())
    served = [it for it in supervisor.allocation.all() if not _is_lost(it)]
    return Seen(
        name,
        is_down,
        start_m if pose is None else (pose.north_m, pose.east_m),
        {it.agent_id: (it.north_m, it.east_m) for it in served},
        frozenset(it.agent_id for it in served if it.agent_id not in busy and _is_free(it, is_down)),
    )


def _is_lost(belief: Belief) -> bool:
    if belief.is_carried:
        return belief.probability_of(Mode.LOST) >= LIKELY
    return belief.state in BEYOND_HELP


def _is_free(belief: Belief, is_down: bool) -> bool:
    """It rests below. One that floats is told to sink if nobody comes for it, unless it is empty, and cannot (`Strays`)."""
    if is_down and belief.primary <= 0 and floats(belief):
        return True
    if belief.is_carried:
        return belief.probability_of(*SUBMERGED) >= LIKELY
    return belief.state in AT_WORK | STRANDED
