"""The event-driven model against the mission of `--time asap`, run by run, and its aPad against the simulated one."""

from __future__ import annotations

import copy
from dataclasses import asdict
from functools import cache, reduce
from typing import Any
from unittest.mock import Mock

import pytest
from flying import journaled
from hypothesis import given, settings
from hypothesis import strategies as st
from scenario_files import POOL_FILE, WHOLE_FILE
from stack_benches import cleared

from agents.mussel.body import drift_step_um
from agents.time_scale import TICK_MS, MissionMs
from apad_bridge.assembly import flight_parts
from apad_bridge.assembly.division import members
from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.events.event import Event
from apad_bridge.events.mission_events import Phase, PlanMade, StepGivenUp
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.orders import Order
from apad_bridge.mission.policy.plan_checks import StrategyFailed
from apad_bridge.planning.dispatch_rule import Horizon
from apad_bridge.runs.in_memory import open_lockstep
from apad_bridge.scenario.loader import from_data, load, resolve
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scenario.starts import starts_of
from apad_bridge.studies.cruising_apad import CruisingAPad
from apad_bridge.studies.event_driven import (
    EventRecorder,
    Ticks,
    drift_sums,
    fly_event_driven,
    model_gap,
)
from apad_bridge.studies.mission_figures import Figures
from apad_bridge.studies.models import Model, fly, fly_each_tick
from apad_bridge.supervisor.loop import Flight
from apad_bridge.supervisor.run_spec import ResumePoint, RunSpec
from apad_bridge.supervisor.supervisor import LearnedState
from apad_bridge.vehicle.commands import Arrived, CloseDock, GoTo, OpenDock
from apad_bridge.world.apad.simulated_apad import SimulatedAPad

POOL = load(POOL_FILE)


def changed(**changes: Any) -> Scenario:
    """The pool with random starts and the changes, whose keys join the blocks' names by two underscores."""
    data = copy.deepcopy(resolve(POOL))
    data["fleet"]["start"] = {"charge": [0.6, 1.0]}
    for path, value in changes.items():
        *blocks, key = path.split("__")
        reduce(dict.__getitem__, blocks, data)[key] = value
    return from_data(data, "test")


# Each lasts until it has shown what it does twice, an aMussel that is served again among it.
CASES: dict[str, dict[str, Any]] = {
    "cautious": {"seed": 2, "duration_s": 1980.0},
    "greedy": {"seed": 3, "mission__collection": "greedy", "duration_s": 1140.0},
    "it decides anew after each docking": {"seed": 3, "mission__collection": "njnp", "duration_s": 1200.0},
    "nobody is charged": {"seed": 4, "mission__collection": "none", "duration_s": 300.0},
    "some are left alone": {
        "seed": 4,
        "apad__dock_miss_probability": 0.7,
        "mission__collection_attempts": 1,
        "duration_s": 1500.0,
    },
    "one at a time": {"seed": 5, "mission__batch": 1, "duration_s": 840.0},
    "asynchronous, the nearest, and dockings miss": {
        "seed": 6,
        "mission__dispatch": "asynchronous",
        "mission__collection": "greedy",
        "apad__dock_miss_probability": 0.3,
        "mission__collection_attempts": 2,
        "duration_s": 1200.0,
    },
    "asynchronous, with a partial charge": {
        "seed": 7,
        "mission__dispatch": "asynchronous",
        "mission__charge_to": 0.85,
        "board__motor_run_charge": 0.045,
        "duration_s": 720.0,
        "fleet__start": {"charge": [0.3, 0.9]},
    },
    "batches with a lead and a partial charge, and the served ones wait": {
        "seed": 19,
        "mission__collection": "rollout-fair",
        "mission__pool_threshold": 0.8,
        "mission__charge_lead": 0.3,
        "mission__charge_to": 0.85,
        "mission__again_threshold": 0.05,
        "duration_s": 2040.0,
    },
    "three exchange places with three": {
        "seed": 21,
        "mission__collection": "rollout-fair",
        "mission__costs": {"distance_per_m": 1.0, "energy_per_charge": 100.0},
        "mission__batch": 3,
        "mission__places": "exchanged",
        "mission__pool_threshold": 0.95,
        "mission__charge_lead": 0.25,
        "duration_s": 1800.0,
    },
    "one by one they exchange places, and dockings miss": {
        "seed": 22,
        "mission__collection": "blend",
        "mission__dispatch": "asynchronous",
        "mission__places": "exchanged",
        "mission__pool_threshold": 0.95,
        "mission__charge_lead": 0.45,
        "apad__dock_miss_probability": 0.3,
        "duration_s": 1200.0,
    },
    "one by one, and the served ones wait": {
        "seed": 17,
        "mission__dispatch": "asynchronous",
        "mission__again_threshold": 0.3,
        "duration_s": 2400.0,
        "fleet__start": {"charge": [0.6, 0.9]},
    },
    "charged until the mission's end": {
        "seed": 12,
        "mission__horizon": "end",
        "mission__charge_to": 0.85,
        "duration_s": 1500.0,
    },
    "one by one until the mission's end": {
        "seed": 23,
        "mission__collection": "core",
        "mission__dispatch": "asynchronous",
        "mission__places": "exchanged",
        "mission__horizon": "end",
        "mission__pool_threshold": 0.3,
        "mission__charge_to": 0.9,
        "duration_s": 3000.0,
        "fleet__start": {"charge": [0.2, 0.9]},
    },
    "a pool of empty ones is refused": {
        "seed": 24,
        "mission__collection": "core",
        "mission__dispatch": "asynchronous",
        "mission__places": "exchanged",
        "mission__pool_threshold": 0.3,
        "mission__batch": 1,
        "apad__docks": 1,
        "duration_s": 3000.0,
        "fleet__start": {"charge": [0.1, 0.9]},
    },
    "it looks ahead": {
        "seed": 9,
        "mission__dispatch": "asynchronous",
        "mission__collection": "rollout-fair",
        "mission__costs": {"distance_per_m": 1.0, "energy_per_charge": 100.0},
        "duration_s": 900.0,
    },
    "it goes home to be charged": {
        "seed": 14,
        "duration_s": 2400.0,
        "apad__battery": {**resolve(POOL)["apad"]["battery"], "capacity_wh": 25.0},
        "apad__home": {"charging_w": 300.0, "go_at": 0.6},
    },
    "it is unavailable for a while, and lets all go before": {
        "seed": 15,
        "duration_s": 1500.0,
        "mission__dispatch": "asynchronous",
        "apad__home": {"charging_w": 200.0, "go_at": 0.1, "docked": "released"},
        "apad__unavailable": [{"from_s": 500, "until_s": 900}],
    },
    "real time": {"seed": 6, "theta": 1, "duration_s": 1200.0, "fleet__start": {"charge": [0.7, 0.8]}},
    "nearly empty": {"seed": 8, "theta": 60, "duration_s": 900.0, "fleet__start": {"charge": [0.0, 0.2]}},
    "unlike aMussels": {
        "seed": 11,
        "duration_s": 1200.0,
        "fleet__spread": {"drain": 0.1, "capacity": 0.1, "secondary_start": 0.2},
    },
    "its battery runs out": {
        "seed": 10,
        "apad__battery": {**resolve(POOL)["apad"]["battery"], "capacity_wh": 6.0},
    },
    "they sink before it comes": {
        "seed": 13,
        "duration_s": 1200.0,
        "board__float_timeout_s": 240.0,
        "mission__speed_m_s": 0.15,
        "mission__surfacing_attempts": 2,
    },
}


@pytest.mark.parametrize("case", CASES)
def test_a_mission_s_figures_are_those_of_the_mission_flown_tick_by_tick(case: str) -> None:
    scenario = changed(**CASES[case])
    assert model_gap(scenario) is None
    ours, flown = asdict(fly_event_driven(scenario)), asdict(fly_each_tick(scenario))
    # Rounding apart these are equal; the promise to users is 0.1 points of uptime and 1 % of the way.
    # A mission with a known end counts its driven way at each second, as the mission does.
    rel = 1e-9 if scenario.mission.horizon is Horizon.END else 0.01
    assert ours.pop("driven_m") == pytest.approx(flown.pop("driven_m"), rel=rel)
    for name, value in flown.items():
        assert ours[name] == (pytest.approx(value, rel=1e-9) if isinstance(value, float) else value), name


@pytest.mark.parametrize(
    "case",
    [
        "asynchronous, the nearest, and dockings miss",
        "a pool of empty ones is refused",
        "batches with a lead and a partial charge, and the served ones wait",
        "one by one until the mission's end",
        "it goes home to be charged",
        "real time",
        "they sink before it comes",
    ],
)
def test_a_mission_that_is_not_due_does_nothing_at_a_tick(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, advance = [], EnergyExchange.advance

    def watched(self: EnergyExchange, now_ms: int) -> list[Order]:
        before, is_due = dict(vars(self)), self.is_due(now_ms)
        assert vars(self) == before
        orders = advance(self, now_ms)
        stalls = any(isinstance(it, StepGivenUp) and it.what == "charge" for it in orders)
        assert is_due or stalls or not orders, now_ms
        asked.append(is_due)
        return orders

    monkeypatch.setattr(EnergyExchange, "advance", watched)
    monkeypatch.setattr(Ticks, "next_tick_ms", lambda self, now_ms, due_ms: step_of(self, now_ms))

    def step_of(ticks: Ticks, now_ms: int) -> int:
        return ticks._vehicle.advance_until(now_ms + TICK_MS, 0.0)

    fly_event_driven(changed(**CASES[case]))
    assert asked.count(False) > asked.count(True) > 0


class Killed:
    """Replaces the mission and its port by those that a resumed run makes of the journaled state, at the first tick from
    `at_ms` on."""

    def __init__(self, scenario: Scenario, at_ms: int) -> None:
        self.phase: Phase | None = None
        self.decisions: list[tuple[int, str, list[int]]] = []
        """The time of each plan, its kind, and its aMussels."""
        self._scenario, self._at_ms = scenario, at_ms

    def fly(self) -> Figures:
        next_tick_ms, event = Ticks.next_tick_ms, EventRecorder.event

        def killed(ticks: Ticks, now_ms: MissionMs, due_ms: int | None) -> int:
            next_ms = next_tick_ms(ticks, now_ms, due_ms)
            if self.phase is None and next_ms >= self._at_ms:
                self._kill(ticks)
            return next_ms

        def noted(recorder: EventRecorder, at_ms: int, it: Event) -> None:
            if isinstance(it, PlanMade):
                self.decisions.append((at_ms, it.what, [step["agent"] for step in it.steps]))
            event(recorder, at_ms, it)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Ticks, "next_tick_ms", killed)
            patch.setattr(EventRecorder, "event", noted)
            return fly_event_driven(self._scenario)

    def _kill(self, ticks: Ticks) -> None:
        supervisor = ticks._supervisor
        state = supervisor.mission.state
        self.phase = state.phase
        learned = LearnedState(supervisor.beliefs, None, supervisor.allocation)
        resumed = flight_parts.supervisor(
            flight_config(self._scenario),
            RunSpec(ResumePoint(MissionMs(0), journaled(state), 1, None), learned),
        )
        resumed.port._distance_m = supervisor.port._distance_m
        supervisor.mission = ticks._mission = resumed.mission
        supervisor.port = resumed.port


@cache
def killed_at(at_ms: int, case: str) -> tuple[Killed, Figures]:
    """The mission, and the figures that it comes to."""
    mission = Killed(changed(**CASES[case]), at_ms)
    return mission, mission.fly()


@settings(max_examples=15, deadline=None)
@given(
    case=st.sampled_from(
        ["it looks ahead", "it goes home to be charged", "three exchange places with three"]
    ),
    at_s=st.integers(3, 1_199),
)
def test_a_mission_that_is_killed_at_any_tick_and_resumed_decides_the_same_next(case: str, at_s: int) -> None:
    """A mechanism that was under way is begun anew. That takes time, in which another aMussel may become due."""
    (never, flown), (killed, resumed) = (killed_at(at_ms, case) for at_ms in (1 << 60, 1_000 * at_s))
    assert abs(resumed.services - flown.services) <= 1 and resumed.amussels_lost == flown.amussels_lost
    if killed.phase in (Phase.DOCK, Phase.UNDOCK):
        return
    after, expected = (
        next((plan for at_ms, *plan in it.decisions if at_ms >= 1_000 * at_s), None) for it in (killed, never)
    )
    assert after == expected


@pytest.mark.parametrize(
    ("changes", "phases", "most"),
    [
        # At theta 1 an aMussel takes half a minute to come up; and each docking misses, so each step is given up.
        pytest.param(
            {
                "theta": 1,
                "duration_s": 1800.0,
                "fleet__start": {"charge": [0.7, 0.8]},
                "apad__dock_miss_probability": 1.0,
                "board__float_timeout_s": 60.0,
            },
            set(Phase),
            300,
            id="an aMussel comes up, and a step was given up",
        ),
        # From 20 to 100 % of 25 Wh takes 15 min or more with 100 W, of which the hotel load takes a quarter.
        pytest.param(
            {
                "seed": 14,
                "apad__battery": {
                    **resolve(POOL)["apad"]["battery"],
                    "capacity_wh": 25.0,
                    "start_fraction": 0.2,
                },
                "apad__home": {"charging_w": 100.0, "go_at": 0.3},
            },
            {Phase.AT_HOME},
            120,
            id="a charge at home",
        ),
    ],
)
def test_seconds_in_which_nothing_is_due_are_skipped(
    changes: dict[str, Any], phases: set[Phase], most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    ticked, tick = [], Flight.tick

    def counted(self: Flight, now_ms: int) -> None:
        ticked.append(self.supervisor.mission.state.phase)
        tick(self, now_ms)

    monkeypatch.setattr(Flight, "tick", counted)
    fly_event_driven(changed(**changes))
    assert 0 < sum(it in phases for it in ticked) < most


def test_shares_flown_one_by_one_are_those_of_the_apads_in_step() -> None:
    scenario = changed(
        seed=5,
        duration_s=900.0,
        mission__dispatch="asynchronous",
        apads=[{"name": "apad2", "start_m": [20.0, 4.0]}],
    )
    opened = open_lockstep(members(scenario, starts_of(scenario)), scenario.sharing)
    opened.runner.run()
    ours = {it.name: fly_event_driven(it.scenario) for it in members(scenario, starts_of(scenario))}
    for name, flown in opened.figures().items():
        found = ours[name].services, ours[name].metres, ours[name].uptime_paper_mean
        assert found == pytest.approx((flown["services"], flown["planned_m"], flown["uptime_paper"]["mean"]))
        assert flown["services"] > 0


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"hearing__positioning": "gps"}, "hearing.positioning"),
        (
            {"mission__docking": {**resolve(POOL)["mission"]["docking"], "catch_radius_m": 0.5}},
            "mission.docking",
        ),
        ({"guards": {}}, "guards"),
        ({"board": resolve(load(WHOLE_FILE))["board"]}, "board.whole"),
    ],
)
def test_what_a_skipped_tick_would_hide_is_a_gap(changes: dict[str, Any], key: str) -> None:
    assert model_gap(changed(**changes)).startswith(key)


places = st.tuples(st.floats(0, 60), st.floats(0, 60))


@settings(max_examples=40, deadline=None)
@given(
    goals=st.lists(places, min_size=1, max_size=3), speed_m_s=st.floats(0.1, 1.5), radius_m=st.floats(0.2, 3)
)
def test_the_cruising_apad_arrives_when_and_where_the_simulated_one_does(
    goals: list[tuple[float, float]], speed_m_s: float, radius_m: float
) -> None:
    config = POOL.apad
    stepped, cruising = SimulatedAPad(config), CruisingAPad(config, flight_parts.misses(POOL))
    now_ms = 0
    for apad in (cruising, stepped):
        apad.advance(0)
    for number, goal in enumerate(goals, start=1):
        command = GoTo(number, *goal, speed_m_s, radius_m)
        stepped.receive(command, now_ms)
        cruising.command(cleared(command), now_ms)
        now_ms = cruising.advance_until(now_ms + 900_000, 0.0)
        ours, theirs = (
            [it for it in apad.advance(now_ms) if isinstance(it, Arrived)] for apad in (cruising, stepped)
        )
        assert ours == theirs and ours
    for apad in (cruising, stepped):
        apad.advance(now_ms + 60_000)
    used_wh = stepped.battery.used_fraction * config.battery.capacity_wh
    assert stepped.battery.ledger.used_wh == pytest.approx(used_wh, rel=1e-9)
    assert asdict(cruising.battery.ledger) == pytest.approx(asdict(stepped.battery.ledger), rel=1e-6)


def test_a_dock_lets_an_amussel_go_where_the_apad_is() -> None:
    apad = CruisingAPad(POOL.apad, flight_parts.misses(POOL))
    apad.advance(0)
    apad.command(cleared(CloseDock(1, 2, 7)), 0)
    closed = apad.advance(0)
    apad.command(cleared(OpenDock(2, 2, 7)), 0)
    assert [type(fact).__name__ for fact in closed] == ["DockClosed", "Carried"]
    assert [type(fact).__name__ for fact in apad.advance(0)] == ["Carried", "DockOpened", "LetGo"]


@given(st.integers(0, 2**64 - 1), st.integers(1, 1000), st.integers(1, 10**6))
def test_drift_is_the_sum_of_the_body_s_own_steps(seed: int, agent_id: int, amplitude_um: int) -> None:
    sum_to = drift_sums(seed, agent_id, amplitude_um)
    north = east = 0
    assert sum_to(0) == (0, 0)
    for n in range(1, 40):
        step = drift_step_um(seed, agent_id, n, amplitude_um)
        north, east = north + step[0], east + step[1]
        assert sum_to(n) == (north, east)


def test_a_strategy_that_fails_fails_the_study(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = "apad_bridge.planning.strategies.paper_strategies.Cautious.plan"
    monkeypatch.setattr(plan, Mock(side_effect=RuntimeError("no idea")))
    with pytest.raises(StrategyFailed, match="no idea"):
        fly(changed(seed=1), Model.EVENT_DRIVEN)


def test_a_plain_string_names_its_model_or_raises() -> None:
    scenario = changed(duration_s=60.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.delattr("apad_bridge.studies.models.fly_each_tick")
        assert fly(scenario, "event-driven") == fly(scenario, Model.EVENT_DRIVEN)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="event driven"):
        fly(scenario, "event driven")  # type: ignore[arg-type]
