"""Collection, waiting and the advice to sink, in every state that a whole board knows."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scenario_files import WHOLE_FILE

from apad_bridge.beliefs.belief import Belief, Suspicion
from apad_bridge.events.mission_events import MissionState
from apad_bridge.mission.believed_dispatch import BelievedDispatch
from apad_bridge.mission.charging_watch import ChargingWatch
from apad_bridge.mission.energy_exchange import EnergyExchange
from apad_bridge.mission.planner import PlanRules
from apad_bridge.mission.pool import ChargingPool, situation_of
from apad_bridge.mission.sink_reminders import SinkReminders
from apad_bridge.planning import registry
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Dispatch, FullWhen, Mission, Suspects
from firmware_model.packets import Reported
from firmware_model.states import TABLE, State, Trigger

MISSION = load(WHOLE_FILE).mission
DEAF = {State.TRANSMITTING, State.CALLING}
"""In these states a board receives no permission now, but will in a moment."""


class Told(dict[int, Belief]):
    def all(self) -> list[Belief]:
        return list(self.values())


def told(*states: State, primary: float = 0.5, secondary: float = 1.0) -> Told:
    return Told(
        {
            agent_id: Belief(agent_id, 0, state, primary, secondary, 1.0 * agent_id, 0.0)
            for agent_id, state in enumerate(states, 1)
        }
    )


@pytest.mark.parametrize("state", State)
def test_who_can_be_made_to_come_up_is_a_candidate(state: State) -> None:
    beliefs = told(state)
    candidates = ChargingPool(MISSION, beliefs).candidates(0)
    # By the firmware's own table; an aMussel on its way down or being let go is not fetched.
    comes_up = (state, Trigger.PERMISSION_HEARD) in TABLE and state is not State.SINKING
    is_up = state in (State.SURFACING, State.FLOATING)
    assert [it.agent_id for it in candidates] == ([1] if comes_up or is_up or state in DEAF else [])


def test_the_lost_are_not_waited_for() -> None:
    lost = [State.LOST] * 3
    pool = ChargingPool(MISSION, told(State.SLEEPING, State.SAMPLING, *lost))
    assert MISSION.batch == 4
    assert pool.batch_of(pool.candidates(0)) == 2
    pool = ChargingPool(MISSION, told(*[State.SLEEPING] * 3, State.REPORTING))
    assert pool.batch_of(pool.candidates(0)) == 0
    assert ChargingPool(MISSION, told(*lost)).batch_of([]) == 0


@pytest.mark.parametrize(("lowest", "in_pool"), [(0.3, [1, 3]), (0.05, [1, 2, 3, 4])])
def test_those_that_were_served_wait_until_one_is_nearly_empty(lowest: float, in_pool: list[int]) -> None:
    beliefs = told(*[State.SLEEPING] * 5)
    beliefs[4] = replace(beliefs[4], primary=lowest)
    beliefs[5] = replace(beliefs[5], primary=0.9)
    pool = ChargingPool(replace(MISSION, again_threshold=0.1), beliefs)
    assert [it.agent_id for it in pool.candidates(0, served={2, 4, 5})] == in_pool
    assert [it.agent_id for it in ChargingPool(MISSION, beliefs).candidates(0, served={2})] == [1, 2, 3, 4]


def test_a_planner_is_told_who_was_served_and_when_and_what_each_reports() -> None:
    beliefs = told(*[State.SLEEPING] * 3)
    beliefs[2] = replace(beliefs[2], reported=Reported(9.5))
    state = MissionState(released=((2, 40_000),))
    situation = situation_of(state, (0.0, 0.0), [beliefs[1], beliefs[2]], 100_000, [beliefs[3]])
    agents = (*situation.candidates, *situation.others)
    assert [(it.is_served, it.unserved_s) for it in agents] == [(False, 100), (True, 60), (False, 100)]
    assert [it.reported.depth_m for it in agents] == [None, 9.5, None]


def test_one_that_was_served_and_floats_does_not_wait() -> None:
    beliefs = told(State.SLEEPING, State.FLOATING, State.SLEEPING)
    pool = ChargingPool(replace(MISSION, again_threshold=0.1), beliefs)
    assert [it.agent_id for it in pool.candidates(0, served={1, 2, 3})] == [2]


@pytest.mark.parametrize("charge", [0.0, 0.3])
def test_one_that_floats_is_fetched_without_a_batch(charge: float) -> None:
    beliefs = told(*[State.SLEEPING] * 5)
    beliefs[1] = replace(beliefs[1], state=State.FLOATING, primary=charge, secondary=0.2)
    for agent_id in (3, 4, 5):
        beliefs[agent_id] = replace(beliefs[agent_id], primary=0.9)
    pool = ChargingPool(MISSION, beliefs)
    assert pool.batch_of(pool.candidates(0)) == 2
    beliefs[1] = replace(beliefs[1], state=State.EMPTY)
    assert pool.batch_of(pool.candidates(0)) == 0


def test_it_is_not_told_to_sink_and_others_are() -> None:
    beliefs = told(State.FLOATING, State.RELEASED, State.FLOATING, State.REPORTING, State.SLEEPING)
    beliefs[3] = replace(beliefs[3], primary=0.0)
    reminders = SinkReminders(repeat_ms=10_000)
    assert reminders.take_due(beliefs.all(), set(), set(), 0) == [1, 2]
    assert reminders.take_due(beliefs.all(), set(), set(), 0) == []
    # One that was called up would last longer below.
    assert reminders.take_due(beliefs.all(), set(), {3}, 0) == [3]


@pytest.mark.parametrize(("state", "is_home"), [(State.SLEEPING, True), (State.REPORTING, False)])
def test_a_dock_is_nobody_s_home(state: State, is_home: bool) -> None:
    mission = EnergyExchange(
        PlanRules(MISSION, registry.collection("cautious"), registry.redeployment("greedy-redeploy")),
        told(state),
    )
    mission.advance(0)
    assert mission.state.homes == (((1, 1.0, 0.0),) if is_home else ())


def is_released(config: Mission, watch: ChargingWatch, docked: Told) -> set[int]:
    """The aMussels that both rules of dispatch release; fails if they differ."""
    released = {
        frozenset(
            BelievedDispatch(replace(config, dispatch=rule), watch, docked, 0, list, len).due().released
        )
        for rule in Dispatch
    }
    (only,) = released
    return set(only)


@pytest.mark.parametrize(
    ("full_when", "primary", "secondary", "full"),
    [
        (FullWhen.PRIMARY, 0.995, 0.2, True),
        (FullWhen.PRIMARY, 0.99, 1.0, False),
        (FullWhen.BOTH, 0.995, 0.2, False),
        (FullWhen.BOTH, 0.995, 0.99, False),
        (FullWhen.BOTH, 0.995, 0.995, True),
    ],
)
def test_full_is_what_the_scenario_says(
    full_when: FullWhen, primary: float, secondary: float, full: bool
) -> None:
    config = replace(MISSION, full_threshold=0.99, full_when=full_when)
    watch = ChargingWatch(config)
    docked = told(State.REPORTING, primary=primary, secondary=secondary)
    assert watch.give_up_stalled(docked, 0) == []
    assert (is_released(config, watch, docked) == {1}) is full


def test_who_gains_in_the_battery_that_is_waited_for_is_not_given_up() -> None:
    config = replace(MISSION, full_threshold=0.99, full_when=FullWhen.BOTH, silence_timeout_s=1.0)
    watch = ChargingWatch(config)
    for now_ms in range(0, 5001, 1000):
        docked = told(State.CHARGING, primary=1.0, secondary=0.5 + now_ms / 20_000)
        assert watch.give_up_stalled(docked, now_ms) == []
    assert watch.give_up_stalled(docked, 6500) == [(1, "its believed charge does not rise")]
    assert is_released(config, watch, docked) == {1}


@pytest.mark.parametrize(
    ("suspects", "was_docked", "in_pool"),
    [
        (Suspects.TOLD, False, []),
        (Suspects.ASKED, False, []),
        (Suspects.FETCHED, False, [1]),
        (Suspects.FETCHED, True, []),
    ],
)
def test_a_suspect_with_charge_is_fetched_for_one_look_where_the_scenario_says_so(
    suspects: Suspects, was_docked: bool, in_pool: list[int]
) -> None:
    beliefs = told(State.SLEEPING, State.SLEEPING, primary=0.9)
    beliefs[1] = replace(beliefs[1], suspicion=Suspicion("its charge jumps", was_docked))
    pool = ChargingPool(replace(MISSION, suspects=suspects), beliefs)
    assert [it.agent_id for it in pool.candidates(0)] == in_pool
