"""Strategies that look ahead: the energy model, the projection of a mission, rollouts, groups and triage."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE

from apad_bridge.assembly.scenario_energy_model import energy_model
from apad_bridge.planning import registry
from apad_bridge.planning.candidates import Candidate, Situation
from apad_bridge.planning.costs import CostScales
from apad_bridge.planning.dispatch_rule import Dispatch, Places
from apad_bridge.planning.projection import Projection
from apad_bridge.planning.solution import StepKind, check_solution
from apad_bridge.planning.strategies.by_route import Blend
from apad_bridge.planning.strategies.paper_strategies import Cautious
from apad_bridge.planning.strategies.rollout import HORIZON_DISCHARGES, MOST_PROJECTED, Rollout
from apad_bridge.planning.strategies.triage import ByLoad, Core, Triage, is_overloaded
from apad_bridge.scenario.loader import load
from firmware_model.power.charge import FULL, Battery, ChargeModel, Flow, grains

POOL = load(POOL_FILE)
MODEL = energy_model(POOL)
PAPER = ChargeModel.from_minutes(0.0010427134, ((0.16197, 0.001045), (0.5634, 0.00223), (1.0, 0.002911)))
LOOKING_AHEAD = ("rollout", "rollout-fair", "charge-groups", "triage", "by-load")
RATE_AT_0_7 = 0.002911 / 60 * POOL.theta
"""Charge a second in a dock, of the paper's equation (2)."""
charges = st.floats(0, 1)
metres = st.floats(-60, 60)


def swimming(
    agent_id: int, north_m: float, east_m: float, charge: float, unserved_s: float = 0.0
) -> Candidate:
    return Candidate(agent_id, north_m, east_m, charge, 1.0, north_m, east_m, unserved_s=unserved_s)


@st.composite
def fleets(draw: st.DrawFn) -> Situation:
    """Candidates at or below the threshold, others above it and docked ones, and a model with either rule of dispatch.

    The docked one stays, or leaves by exchanging places.
    """
    low = [
        swimming(k, draw(metres), draw(metres), draw(st.floats(0, 0.8)))
        for k in range(1, draw(st.integers(1, 9)))
    ]
    high = [swimming(k, draw(metres), draw(metres), draw(st.floats(0.81, 1))) for k in (21, 22)]
    held = replace(swimming(31, draw(metres), draw(metres), draw(charges)), dock_index=3)
    others, leaving = draw(st.sampled_from((((), ()), ((held,), ()), ((), (held,)))))
    free = (0, 1, 2) if others else (0, 1, 2, 3)
    model = replace(
        MODEL, dispatch=draw(st.sampled_from(Dispatch)), motor_run=draw(st.sampled_from((0.0, 0.045)))
    )
    model = replace(
        model,
        charge_lead=draw(st.none() | st.floats(0.05, 1)),
        places=Places.EXCHANGED if leaving else draw(st.sampled_from(Places)),
    )
    return Situation(draw(metres), draw(metres), tuple(low), free, (*high, *others), model, leaving)


@given(charges, st.integers(0, 40_000), charges)
def test_the_model_charges_as_the_paper_s_equation_does_and_back(
    charge: float, minutes: int, to: float
) -> None:
    battery = Battery(0, grains(charge), Flow.CHARGING)
    after = PAPER.charge_at(battery, minutes * 60_000) / FULL
    assert MODEL.charged(charge, minutes * 60 / POOL.theta) == pytest.approx(after, abs=1e-6)
    assert MODEL.charged(charge, MODEL.charging_s(charge, to)) == pytest.approx(max(charge, to), abs=1e-9)


def test_a_rollout_in_a_large_pool_projects_so_many_plans_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    chance, projected, of = Random(1), [], Projection.of
    monkeypatch.setattr(Projection, "of", lambda self, plan: (projected.append(plan), of(self, plan))[1])
    places = ((60 * chance.random(), 60 * chance.random(), 0.8 * chance.random()) for _ in range(59))
    low = tuple(swimming(k, *it) for k, it in enumerate(places, 1))
    plan = Rollout(CostScales(1.0, 100.0)).plan(Situation(0.0, 0.0, low, (0, 1, 2, 3), (), MODEL), batch=4)
    assert len(plan.steps) == 4 and 10 < len(projected) <= MOST_PROJECTED


@settings(max_examples=100, deadline=None)
@given(fleets(), st.integers(1, 4), st.sampled_from((*LOOKING_AHEAD, "core")))
def test_every_plan_can_be_flown_and_fills_the_batch(situation: Situation, batch: int, name: str) -> None:
    """The core, in the overload of one dock, may leave some out."""
    if name == "core":
        situation = replace(situation, model=replace(MODEL, docks=1))
    plan = registry.collection(name, CostScales(1.0, 100.0)).plan(situation, batch)
    check_solution(plan, situation, StepKind.COLLECT)
    most = min(batch, len(situation.candidates), len(situation.free_docks))
    assert len(plan.steps) == most or (name == "core" and len(plan.steps) < most)


@settings(max_examples=60, deadline=None)
@given(fleets(), st.floats(1, 4000))
def test_a_projection_makes_no_energy_and_no_time(situation: Situation, horizon_s: float) -> None:
    model = situation.model
    outcome = Projection(situation, model, horizon_s, 60.0).of(range(min(2, len(situation.candidates))))
    agents = (*situation.candidates, *situation.others, *situation.leaving)
    fastest = max(per_s for _, per_s in model.curve)
    for agent, active_s, left in zip(agents, outcome.active_s, outcome.charges, strict=True):
        assert 0 <= active_s <= horizon_s + 1e-6 and -1e-9 <= left <= 1 + 1e-9
        gained = left + model.drain_per_s * active_s - agent.charge
        assert gained <= fastest * (horizon_s - active_s) + 1e-6
    assert 0 <= outcome.metres <= model.speed_m_s * horizon_s + 200  # the leg on which it ends counts whole


def test_a_projection_of_nobody_low_lets_the_fleet_drain() -> None:
    situation = Situation(0, 0, (), (0, 1, 2, 3), (swimming(1, 9, 9, 1.0), swimming(2, 5, 5, 0.9)), MODEL)
    outcome = Projection(situation, MODEL, 100.0, 60.0).of(())
    assert outcome.active_s == (100.0, 100.0) and outcome.metres == 0.0
    assert outcome.charges == pytest.approx((1 - 100 * MODEL.drain_per_s, 0.9 - 100 * MODEL.drain_per_s))


@pytest.mark.parametrize("dispatch", Dispatch)
@pytest.mark.parametrize(
    ("rules", "other", "waits_s"),
    [
        pytest.param({"charge_to": 0.6}, 0.4, 0.0, id="another waits, so it is released at once"),
        pytest.param(
            {"charge_to": 0.6}, 1.0, None, id="nobody waits, so it is not released before it is full"
        ),
        pytest.param({"charge_lead": 0.25}, 0.4, 0.0, id="it leads the waiting one by enough"),
        # One rises while the other falls.
        pytest.param(
            {"charge_lead": 0.4},
            0.4,
            0.1 / (RATE_AT_0_7 + MODEL.drain_per_s),
            id="it leads by enough a little later",
        ),
    ],
)
def test_a_charged_one_makes_room_in_a_projection(
    dispatch: Dispatch, rules: dict[str, float], other: float, waits_s: float | None
) -> None:
    """It has 0.7 in the dock at its own home, and the other one is in the water."""
    rules = {"charge_to": MODEL.full, "pool_threshold": 0.5, **rules}
    model = replace(MODEL, docks=1, batch=1, dispatch=dispatch, **rules)
    others = replace(swimming(1, 0, 0, 0.7), dock_index=0), swimming(2, 0, 0, other)
    docked_s, released_s = MODEL.charging_s(0.7, MODEL.full), 2.5 + MODEL.undock_s
    outcome = Projection(Situation(0, 0, (), (), others, model), model, docked_s, 60.0).of(())
    active_s = 0.0 if waits_s is None else docked_s - released_s - waits_s
    assert outcome.active_s[0] == pytest.approx(active_s, abs=docked_s / 200 if waits_s else None)


@pytest.mark.parametrize("dispatch", Dispatch)
@pytest.mark.parametrize(("was_served", "again"), [(True, 0.02), (True, None), (False, 0.02)])
def test_one_that_was_served_waits_in_a_projection_until_it_is_nearly_empty(
    dispatch: Dispatch, was_served: bool, again: float | None
) -> None:
    """It lies below the aPad, and is not full again before the horizon."""
    model = replace(MODEL, docks=1, batch=1, dispatch=dispatch, again_threshold=again)
    waits_s, collected_s = (0.2 - 0.02) / MODEL.drain_per_s, 2.5 + MODEL.dock_s
    agent = replace(swimming(1, 0, 0, 0.2), is_served=was_served)
    outcome = Projection(Situation(0, 0, (), (0,), (agent,), model), model, waits_s + 60, 60.0).of(())
    waits = was_served and again is not None
    assert outcome.active_s[0] == pytest.approx(collected_s + (waits_s if waits else 0.0))


@pytest.mark.parametrize("dispatch", Dispatch)
@pytest.mark.parametrize(("is_planned", "charge"), [(True, 0.4), (False, 0.4), (False, 1.0)])
def test_a_released_one_takes_the_place_of_the_collected_one_in_a_projection(
    dispatch: Dispatch, is_planned: bool, charge: float
) -> None:
    """One is full in a dock, with its place 20 m to the south; one waits 30 m to the north. The horizon ends later.

    The charged one works from its release, after one way and both mechanisms. The way is the same whether the plan that is
    judged collects the other one, or the base policy does. If nobody waits, it goes to its own place.
    """
    model = replace(MODEL, docks=1, batch=1, dispatch=dispatch, places=Places.EXCHANGED)
    held, other = replace(swimming(1, -20, 0, 1.0), dock_index=0), swimming(2, 30, 0, charge)
    collected_s = 2.5 + 30 / model.speed_m_s + model.dock_s
    horizon_s = collected_s + model.undock_s + 50
    situation = (
        Situation(0, 0, (other,), (0,), (), model, (held,))
        if is_planned
        else Situation(0, 0, (), (), (other, held), model)
    )
    outcome = Projection(situation, model, horizon_s, 60.0).of([0] if is_planned else [])
    alone = (horizon_s, horizon_s - 2.5 - 20 / model.speed_m_s - model.undock_s)
    metres, active_s = (30.0, (collected_s, 50.0)) if charge < 1 else (20.0, alone)
    assert (outcome.metres, outcome.active_s) == (metres, pytest.approx(active_s))


def test_a_rollout_finds_the_best_plan_of_a_small_pool_by_its_own_model() -> None:
    """By trying every order of every choice, with the same worth."""
    agents = tuple(
        swimming(k, north, east, charge)
        for k, north, east, charge in ((1, 3, 20, 0.1), (2, 20, 2, 0.7), (3, 25, 18, 0.3), (4, 1, 1, 0.79))
    )
    situation = Situation(14, 10, agents, (0, 1), (), replace(MODEL, docks=2, batch=2))
    rollout = Rollout(CostScales(1.0, 100.0))
    horizon_s = HORIZON_DISCHARGES / MODEL.drain_per_s
    projection = Projection(situation, situation.model or MODEL, horizon_s, 60.0)
    costs = {
        plan: sum(rollout.parts_of(projection.of(plan), MODEL, horizon_s).values())
        for plan in permutations(range(4), 2)
    }
    chosen = [step.agent_id - 1 for step in rollout.plan(situation, 2).steps]
    assert costs[(chosen[0], chosen[1])] == pytest.approx(min(costs.values()), rel=0.01)


def test_charge_groups_do_not_let_the_nearly_full_wait_for_the_empty() -> None:
    agents = [swimming(k, 10, 10 + k, 0.0 if k == 1 else 0.6) for k in range(1, 6)]
    situation = Situation(10, 10, tuple(agents), (0, 1, 2, 3), (), MODEL)
    plan = registry.collection("charge-groups", CostScales(0.0, 1.0)).plan(situation, 4)
    assert sorted(step.agent_id for step in plan.steps) == [2, 3, 4, 5]


def fleet_of(count: int, unserved_s: float = 0.0) -> Situation:
    agents = [
        swimming(k, 10, 10, 0.0 if k % 2 else 0.6, unserved_s if k == 1 else 0.0) for k in range(1, count + 1)
    ]
    return Situation(10, 10, tuple(agents), (0, 1, 2, 3), (), MODEL)


def test_triage_is_cautious_without_overload_and_passes_the_empty_over_with_it() -> None:
    assert not is_overloaded(12, MODEL) and is_overloaded(24, MODEL)
    assert Triage().plan(fleet_of(12), 4) == Cautious().plan(fleet_of(12), 4)
    assert all(step.agent_id % 2 == 0 for step in Triage().plan(fleet_of(24), 4).steps)


def test_by_load_is_a_blend_without_overload_and_spares_metres_with_it() -> None:
    scales = CostScales(distance_per_m=1.0, energy_per_charge=50.0)
    far = replace(fleet_of(12), candidates=tuple(swimming(k, 130 - 10 * k, 10, 0.5) for k in range(1, 13)))
    assert ByLoad(scales).plan(far, 4) == Blend(scales).plan(far, 4) != Cautious().plan(far, 4)
    # The second gives a tenth more charge for the aPad's time. That is worth a metre, and 28 m are too far for it.
    near, low = swimming(1, 10, 12, 0.0), swimming(2, 10, 40, 0.6)
    crowd = replace(fleet_of(24), candidates=(near, low), others=fleet_of(24).candidates[2:])
    assert [it.plan(crowd, 1).steps[0].agent_id for it in (Triage(), ByLoad(scales))] == [2, 1]


@pytest.mark.parametrize(("strategy", "discharges"), [(Triage(), 4.0), (ByLoad(CostScales()), 8.0)])
def test_triage_passes_nobody_over_for_longer_than_its_floor(strategy: Triage, discharges: float) -> None:
    floor_s = discharges / MODEL.drain_per_s
    fleets = fleet_of(24, floor_s - 1), fleet_of(24, floor_s + 1)
    assert [strategy.plan(it, 4).steps[0].agent_id for it in fleets] == [2, 1]


CORE = Core(CostScales(distance_per_m=1.0, energy_per_charge=50.0))
ONE_DOCK = replace(MODEL, docks=1)
"""It sustains three aMussels."""


def collected(candidates: list[Candidate], others: list[Candidate], count: int = 1) -> list[int]:
    situation = Situation(0, 0, tuple(candidates), (0,), tuple(others), ONE_DOCK)
    return [step.agent_id for step in CORE.plan(situation, count).steps]


@pytest.mark.parametrize(("count", "is_heavy"), [(12, False), (28, False), (29, True)])
def test_the_core_is_by_load_without_heavy_overload(count: int, is_heavy: bool) -> None:
    by_load = ByLoad(CostScales(distance_per_m=1.0, energy_per_charge=50.0))
    far = tuple(swimming(k, 300 - 10 * k, 10, 0.5 if k % 2 else 0.0) for k in range(1, count + 1))
    situation = replace(fleet_of(12), candidates=far)
    assert (CORE.plan(situation, 4) != by_load.plan(situation, 4)) is is_heavy


EMPTY = [swimming(k, k, 0, 0.0) for k in range(1, 6)]
ALIVE = [swimming(k, k, 0, 0.9) for k in (11, 12, 13)]
SERVED = {"is_served": True}
NEAR = [replace(swimming(k, 50 + k, 50, 0.5), **SERVED) for k in (1, 2, 3)]
APART = [replace(swimming(10 + k, 40 * k, -40 * k, 0.5), **SERVED) for k in range(4)]
CHARGED = [replace(it, charge=0.9) for it in NEAR]
FRESH = [replace(it, charge=charge, is_served=False) for it, charge in zip(APART, (0.58, 0.57), strict=False)]
LATE_S = 20 / MODEL.drain_per_s


def left_out(count: int) -> list[Candidate]:
    """Empty ones, of which the first waits for long."""
    return [swimming(k, k, 0, 0.0, LATE_S if k == 1 else 0.0) for k in range(1, 1 + count)]


@pytest.mark.parametrize(
    ("candidates", "others", "chosen"),
    [
        pytest.param(EMPTY, ALIVE, [], id="the empty are refused while enough are alive"),
        pytest.param(EMPTY, ALIVE[:2], [5], id="else the nearest to those that are alive is collected"),
        pytest.param(
            EMPTY, [*ALIVE[:2], replace(ALIVE[2], dock_index=1)], [], id="one that is docked is alive, too"
        ),
        # And not aMussel 10, at the aPad's own place.
        pytest.param([*NEAR, *APART], [], [1], id="the core is those near to each other"),
        pytest.param(APART, CHARGED, [], id="nobody of the core waits"),
        # If it is on the fast part of the curve.
        pytest.param(FRESH, [*CHARGED, *APART[2:]], [11], id="one that was never served is collected"),
        pytest.param(left_out(4), ALIVE, [1], id="one that was left out for long is served"),
        pytest.param(left_out(9), ALIVE, [], id="after a time that grows with the overload"),
    ],
)
def test_whom_the_core_collects_in_heavy_overload(
    candidates: list[Candidate], others: list[Candidate], chosen: list[int]
) -> None:
    assert collected(candidates, others) == chosen


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 0.3), st.floats(0, 30_000)), min_size=1, max_size=12),
    st.lists(st.floats(0.1, 1), max_size=6),
    st.lists(st.floats(-50, 50), min_size=36, max_size=36),
)
def test_a_pool_that_the_core_refuses_for_a_while_gives_no_plan_wherever_they_drift(
    pool: list[tuple[float, float]], rest: list[float], places: list[float]
) -> None:
    candidates = [swimming(k, places[k], places[-1 - k], *it) for k, it in enumerate(pool)]
    others = [swimming(20 + k, places[12 + k], places[18 + k], charge) for k, charge in enumerate(rest)]
    if CORE.refuses(Situation(0, 0, tuple(candidates), (0,), tuple(others), ONE_DOCK)):
        assert collected(candidates, others) == []


@pytest.mark.parametrize(
    ("charges", "alive", "refused"),
    [([0.0] * 5, 3, True), ([0.0] * 5, 2, False), ([0.0] * 4 + [0.25], 3, False), ([0.0], 3, False)],
    ids=["all are empty", "too few are alive", "one is not empty", "one alone"],
)
def test_a_pool_is_refused_for_a_while_if_all_are_empty_and_enough_are_alive(
    charges: list[float], alive: int, refused: bool
) -> None:
    pool = tuple(swimming(k, k, 0, charge) for k, charge in enumerate(charges))
    assert CORE.refuses(Situation(0, 0, pool, (0,), tuple(ALIVE[:alive]), ONE_DOCK)) is refused


@pytest.mark.parametrize("name", (*LOOKING_AHEAD, "core"))
def test_without_a_model_a_strategy_that_looks_ahead_says_so(name: str) -> None:
    with pytest.raises(ValueError, match="energy model"):
        registry.collection(name).plan(Situation(0, 0, (swimming(1, 0, 0, 0.5),), (0,)), 1)
