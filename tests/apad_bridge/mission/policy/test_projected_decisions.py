"""The mission and its projection decide alike: whom to release now, whom to collect, and who exchanges places."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace

from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from agents.time_scale import MissionMs
from apad_bridge.assembly.scenario_energy_model import energy_model
from apad_bridge.beliefs.belief import Belief
from apad_bridge.events.mission_events import MissionState, Phase
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.policy.planner import PlanRules
from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.dispatch_rule import Dispatch, Places
from apad_bridge.planning.projection import Projection
from apad_bridge.planning.solution import StepKind
from apad_bridge.scenario.blocks.mission_options import Mission
from apad_bridge.scenario.loader import load
from firmware_model.states import State

POOL = load(POOL_FILE)
DOCKS = 4
LEVELS = 100
"""Charges and leads are hundredths, and thresholds lie between: a projection passes one in no time."""
Tour = tuple[list[int], set[int], list[tuple[int, int]]]
"""Who is collected, in order; who is released; and the pairs (released, collected) that exchange places."""


class Told(dict[int, Belief]):
    def all(self) -> list[Belief]:
        return [self[agent_id] for agent_id in sorted(self)]


@dataclass(frozen=True)
class Case:
    mission: Mission
    docked: dict[int, float]
    swimming: dict[int, float]
    places: dict[int, tuple[float, float]]


hundredths = st.integers(0, LEVELS).map(lambda it: it / LEVELS)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    threshold = draw(st.sampled_from((30.5, 50.5, 80.5, 95.5)))
    mission = replace(
        POOL.mission,
        collection="greedy",
        dispatch=draw(st.sampled_from(Dispatch)),
        places=draw(st.sampled_from(Places)),
        batch=draw(st.integers(1, DOCKS)),
        pool_threshold=threshold / LEVELS,
        full_threshold=0.985,
        charge_to=draw(st.none() | st.integers(int(threshold) + 1, 97).map(lambda it: (it + 0.5) / LEVELS)),
        charge_lead=draw(st.none() | st.integers(5, 90).map(lambda it: it / LEVELS)),
    )
    docked = draw(st.lists(hundredths, min_size=1, max_size=DOCKS))
    swimming = draw(st.lists(hundredths, max_size=6))
    ids = range(1, len(docked) + len(swimming) + 1)
    # Places on a parabola: no two ways are equal.
    numbers = draw(st.permutations(list(ids)))
    places = {agent_id: (3.1 * n, 1.7 * n * n) for agent_id, n in zip(ids, numbers, strict=True)}
    return Case(
        mission,
        dict(zip(ids, docked, strict=False)),
        dict(zip(ids[len(docked) :], swimming, strict=True)),
        places,
    )


def decided_by_mission(case: Case) -> Tour:
    told = Told(
        {
            agent_id: Belief(agent_id, MissionMs(0), state, charge, 1.0, *case.places[agent_id])
            for state, group in ((State.CHARGING, case.docked), (State.ACTIVE, case.swimming))
            for agent_id, charge in group.items()
        }
    )
    homes = tuple((agent_id, *place) for agent_id, place in case.places.items())
    mission = EnergyExchange(
        PlanRules(case.mission, registry.collection("greedy"), registry.redeployment("greedy-redeploy")),
        told,
        MissionState(phase=Phase.CHARGE, docked=tuple(enumerate(case.docked)), homes=homes),
    )
    mission.moved(0.0, 0.0)
    mission.advance(0)
    steps = mission.state.plan
    collected = [it.agent_id for it in steps if it.kind is StepKind.COLLECT]
    released = [it.agent_id for it in steps if it.kind is StepKind.DEPLOY]
    exchanges = collected and released
    return collected, set(released), list(zip(released, collected, strict=False)) if exchanges else []


class _Decided(Exception):
    pass


class _First(Projection):
    """Ends at the first tour that is not empty."""

    tour: Tour = [], set(), []

    def _fly_tour(self, collected: Iterable[int], leaving: Iterable[int] = ()) -> None:
        out, back = [], []
        for index in collected:
            out.append(self._agents[index].agent_id)
            self._place_m = self._places[index]
        back = [self._agents[index].agent_id for index in leaving]
        if out or back:
            if self.now_s == 0:
                self.tour = out, set(back), list(zip(back, out, strict=False))
            raise _Decided


def decided_by_projection(case: Case) -> Tour:
    agents = [
        Candidate(agent_id, *case.places[agent_id], charge, 1.0, *case.places[agent_id], dock_index)
        for agent_id, charge, dock_index in (
            *((agent_id, charge, index) for index, (agent_id, charge) in enumerate(case.docked.items())),
            *((agent_id, charge, None) for agent_id, charge in case.swimming.items()),
        )
    ]
    free = tuple(range(len(case.docked), DOCKS))
    model = energy_model(replace(POOL, mission=case.mission))
    first = _First(Situation(0.0, 0.0, (), free, tuple(agents), model), model, 1e9, 0.0)
    with suppress(_Decided):
        first.of(())
    return first.tour


@settings(max_examples=400, deadline=None)
@given(cases())
def test_a_projection_decides_as_the_mission_does(case: Case) -> None:
    assert decided_by_projection(case) == decided_by_mission(case)
