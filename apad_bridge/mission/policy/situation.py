"""The planner's input, from the mission's state and its beliefs: whom it may serve, and which docks are free."""

from __future__ import annotations

from collections.abc import Iterable

from agents.time_scale import MissionMs
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import MissionState
from apad_bridge.planning.candidates import Candidate, LegCosts, Situation
from apad_bridge.planning.energy_model import EnergyModel
from firmware_model.state_groups import BEYOND_HELP
from firmware_model.states import State


def placeholder_belief(agent_id: int, place_m: tuple[float, float]) -> Belief:
    """A placeholder for a docked, never heard aMussel: it is let go at the aPad's place, which frees its dock."""
    return Belief(agent_id, MissionMs(0), State.CHARGING, 0.0, 0.0, *place_m)


def situation_of(
    state: MissionState,
    place_m: tuple[float, float],
    beliefs: Iterable[Belief],
    now_ms: MissionMs,
    others: Iterable[Belief] = (),
    model: EnergyModel | None = None,
    leaving: Iterable[Belief] = (),
    sea: LegCosts | None = None,
) -> Situation:
    """The planner's input: `beliefs` as candidates with homes, and docked ones with their docks.

    The docks of those who are `leaving` count as free. `others` are the rest of the fleet, as far as it can be served.
    An aMussel without a known home is let go at the aPad's place. `sea` is None in calm water.
    """
    homes = {agent_id: (north_m, east_m) for agent_id, north_m, east_m in state.homes}
    released_ms = dict(state.released)
    held = {agent_id: dock_index for dock_index, agent_id in state.docked}

    def candidate(it: Belief) -> Candidate:
        home_m = homes.get(it.agent_id, place_m)
        unserved_s = (now_ms - released_ms.get(it.agent_id, 0)) / 1000
        return Candidate(
            it.agent_id,
            it.north_m,
            it.east_m,
            it.primary,
            it.secondary,
            *home_m,
            dock_index=held.get(it.agent_id),
            unserved_s=unserved_s,
            is_served=it.agent_id in released_ms,
            reported=it.reported,
        )

    leaving = tuple(leaving)
    taken = set(held.values()) - {held[it.agent_id] for it in leaving}
    return Situation(
        *place_m,
        candidates=tuple(map(candidate, beliefs)),
        free_docks=tuple(dock_index for dock_index in range(state.dock_count) if dock_index not in taken),
        others=tuple(candidate(it) for it in others if it.state not in BEYOND_HELP),
        model=model,
        leaving=tuple(map(candidate, leaving)),
        sea=sea,
    )
