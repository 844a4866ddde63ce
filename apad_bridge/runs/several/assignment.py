"""Assigns aMussels to several aPads in flight, and plans anew when one aPad stands down. Pure; built from beliefs.

Every aMussel is in exactly one share at any time. It is not moved while a dock holds it, while an aPad comes for it, or
on its way up or down. An aMussel that a failed aPad called up is moved once it is submerged again, or lies empty at the
surface; an aMussel in a dock of the failed aPad stays with it.

The planner knows of each aPad what its supervisor believes, and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import fsum

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.modes import LIKELY, SUBMERGED, Mode
from apad_bridge.events.mission_events import MissionState, Phase
from apad_bridge.mission.policy.pool import floats
from apad_bridge.planning.fleet_shares import Point, allocate
from apad_bridge.runs.parent_protocol import APadView
from apad_bridge.supervisor.supervisor import Supervisor
from firmware_model.state_groups import AT_WORK, BEYOND_HELP, STRANDED


@dataclass(frozen=True, slots=True)
class Move:
    agent_id: int
    giver: str
    taker: str


class Assignment:
    """Records which aPad serves which aMussel. `plan_moves` proposes moves; `record_move` records one that was made."""

    def __init__(self, served: Mapping[str, Iterable[int]]) -> None:
        """ValueError when two aPads serve the same aMussel."""
        self._shares = {name: frozenset(ids) for name, ids in served.items()}
        everybody = [agent_id for ids in self._shares.values() for agent_id in ids]
        if len(set(everybody)) < len(everybody):
            raise ValueError("an aMussel is in two shares")
        self._planned_without: frozenset[str] = frozenset()

    @property
    def shares(self) -> Mapping[str, frozenset[int]]:
        return dict(self._shares)

    def plan_moves(self, views: Sequence[APadView]) -> list[Move]:
        """Returns the moves, sorted by id.

        When an aPad has stood down, all movable aMussels are planned anew; later, only those that it still serves.
        """
        up = [it for it in views if not it.is_down]
        stranded = {it.name: it.movable & self._shares[it.name] for it in views if it.is_down}
        if not up or not any(stranded.values()):
            return []
        down = frozenset(stranded)
        is_first_plan = not down <= self._planned_without
        self._planned_without |= down
        owners = {
            agent_id: it.name for it in views for agent_id in self._shares[it.name] & it.places_m.keys()
        }
        places_m = {
            agent_id: it.places_m[agent_id] for it in views for agent_id in it.places_m.keys() & owners
        }
        index = {it.name: n for n, it in enumerate(up)}
        free = {agent_id for ids in stranded.values() for agent_id in ids}
        if is_first_plan:
            free |= {agent_id for it in up for agent_id in it.movable}
        planned_m = {i: at for i, at in places_m.items() if owners[i] in index or i in free}
        stays = {i: index[owners[i]] for i in planned_m.keys() - free}
        planned = allocate([_centre(it, self._shares[it.name]) for it in up], planned_m, stays)
        return sorted(
            (
                Move(agent_id, owners[agent_id], it.name)
                for it, allocation in zip(up, planned, strict=True)
                for agent_id in allocation
                if owners[agent_id] != it.name
            ),
            key=lambda move: move.agent_id,
        )

    def record_move(self, move: Move) -> None:
        """ValueError, without a change, when the giver does not serve the aMussel."""
        if move.agent_id not in self._shares[move.giver]:
            raise ValueError(f"{move.giver} does not serve aMussel {move.agent_id}")
        self._shares[move.giver] -= {move.agent_id}
        self._shares[move.taker] |= {move.agent_id}


def _centre(view: APadView, served: frozenset[int]) -> Point:
    """The mean place of the aMussels served, so that shares change no more than they must; else the aPad's place."""
    places_m = [at for agent_id, at in view.places_m.items() if agent_id in served]
    if not places_m:
        return view.place_m
    return (
        fsum(north_m for north_m, _ in places_m) / len(places_m),
        fsum(east_m for _, east_m in places_m) / len(places_m),
    )


def view_of(name: str, start_m: tuple[float, float], supervisor: Supervisor) -> APadView:
    """`start_m` stands for the aPad's place until a pose was reported."""
    state, pose = supervisor.mission.state, supervisor.pose
    is_down = state.phase is Phase.STANDS_DOWN
    busy = busy_with(state)
    served = [it for it in supervisor.allocation.all() if not _is_lost(it)]
    return APadView(
        name,
        is_down,
        start_m if pose is None else pose.place_m,
        {it.agent_id: (it.north_m, it.east_m) for it in served},
        frozenset(it.agent_id for it in served if it.agent_id not in busy and _is_free(it, is_down)),
    )


def busy_with(state: MissionState) -> frozenset[int]:
    """The aMussels in a mission's plan and in its docks."""
    return frozenset(step.agent_id for step in state.plan) | frozenset(dict(state.docked).values())


def _is_lost(belief: Belief) -> bool:
    return belief.probability_of(Mode.LOST) >= LIKELY if belief.is_predicted else belief.state in BEYOND_HELP


def _is_free(belief: Belief, is_down: bool) -> bool:
    """True if the aMussel rests submerged, or floats empty while its aPad stands down.

    The mission orders a floating aMussel to sink if no aPad comes for it (`Strays`); an empty one cannot sink.
    """
    if is_down and belief.primary <= 0 and floats(belief):
        return True
    if belief.is_predicted:
        return belief.probability_of(*SUBMERGED) >= LIKELY
    return belief.state in AT_WORK | STRANDED
