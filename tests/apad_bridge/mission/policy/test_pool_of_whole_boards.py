"""Collection, waiting and the advice to sink, in every state that a whole board knows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from scenario_files import WHOLE_FILE

from apad_bridge.beliefs.belief import Belief, Suspicion
from apad_bridge.events.mission_events import MissionState
from apad_bridge.mission.policy.believed_dispatch import BelievedDispatch
from apad_bridge.mission.policy.charging_watch import ChargingWatch
from apad_bridge.mission.policy.pool import ChargingPool
from apad_bridge.mission.policy.situation import situation_of
from apad_bridge.mission.sink_reminders import SinkReminders
from apad_bridge.planning.dispatch_rule import Dispatch, FullWhen
from apad_bridge.scenario.blocks.mission_options import Mission, Suspects
from apad_bridge.scenario.loader import load
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


LOST, SLEEPS, FLOATS = State.LOST, State.SLEEPING, State.FLOATING
AGAIN = {"again_threshold": 0.1}
SUSPECT = Suspicion("its charge jumps", False)
LOOKED_AT = Suspicion("its charge jumps", True)


@pytest.mark.parametrize(
    ("states", "changes", "rules", "served", "in_pool", "batch"),
    [
        # The batch is four.
        pytest.param(
            [SLEEPS, State.SAMPLING, LOST, LOST, LOST],
            {},
            {},
            (),
            [1, 2],
            2,
            id="the lost are not waited for",
        ),
        pytest.param([SLEEPS] * 3 + [State.REPORTING], {}, {}, (), [1, 2, 3], 0, id="one in a dock is"),
        pytest.param([LOST] * 3, {}, {}, (), [], 0, id="all are lost"),
        *(
            pytest.param(
                [SLEEPS] * 5,
                {4: {"primary": lowest}, 5: {"primary": 0.9}},
                AGAIN,
                (2, 4, 5),
                in_pool,
                batch,
                id=f"those that were served wait until one is nearly empty: {lowest}",
            )
            for lowest, in_pool, batch in ((0.3, [1, 3], 0), (0.05, [1, 2, 3, 4], 4))
        ),
        pytest.param(
            [SLEEPS] * 5, {5: {"primary": 0.9}}, {}, (2,), [1, 2, 3, 4], 4, id="else they do not wait"
        ),
        pytest.param(
            [SLEEPS, FLOATS, SLEEPS],
            {},
            AGAIN,
            (1, 2, 3),
            [2],
            1,
            id="one that was served and floats does not",
        ),
        *(
            pytest.param(
                [FLOATS] + [SLEEPS] * 4,
                {1: {"primary": charge, "secondary": 0.2}, **{n: {"primary": 0.9} for n in (3, 4, 5)}},
                {},
                (),
                [1, 2],
                2,
                id=f"one that floats is fetched without a batch: {charge}",
            )
            for charge in (0.0, 0.3)
        ),
        pytest.param(
            [State.EMPTY] + [SLEEPS] * 4,
            {1: {"primary": 0.0}, **{n: {"primary": 0.9} for n in (3, 4, 5)}},
            {},
            (),
            [1, 2],
            0,
            id="one that is empty below is not",
        ),
        *(
            pytest.param(
                [SLEEPS, SLEEPS],
                {1: {"primary": 0.9, "suspicion": suspicion}, 2: {"primary": 0.9}},
                {"suspects": rule, "batch": 1},
                (),
                in_pool,
                len(in_pool),
                id=f"a suspect with charge, {rule}, docked before: {suspicion.was_docked}",
            )
            for rule, suspicion, in_pool in (
                (Suspects.TOLD, SUSPECT, []),
                (Suspects.ASKED, SUSPECT, []),
                (Suspects.FETCHED, SUSPECT, [1]),
                (Suspects.FETCHED, LOOKED_AT, []),
            )
        ),
    ],
)
def test_who_is_in_the_pool_and_how_many_are_a_batch(
    states: list[State],
    changes: dict[int, dict[str, Any]],
    rules: dict[str, Any],
    served: tuple[int, ...],
    in_pool: list[int],
    batch: int,
) -> None:
    beliefs = told(*states)
    for agent_id, change in changes.items():
        beliefs[agent_id] = replace(beliefs[agent_id], **change)
    pool = ChargingPool(replace(MISSION, **rules), beliefs)
    candidates = pool.candidates(0, served=set(served))
    assert ([it.agent_id for it in candidates], pool.batch_of(candidates)) == (in_pool, batch)


def test_a_planner_is_told_who_was_served_and_when_and_what_each_reports() -> None:
    beliefs = told(*[State.SLEEPING] * 3)
    beliefs[2] = replace(beliefs[2], reported=Reported(9.5))
    state = MissionState(released=((2, 40_000),))
    situation = situation_of(state, (0.0, 0.0), [beliefs[1], beliefs[2]], 100_000, [beliefs[3]])
    agents = (*situation.candidates, *situation.others)
    assert [(it.is_served, it.unserved_s) for it in agents] == [(False, 100), (True, 60), (False, 100)]
    assert [it.reported.depth_m for it in agents] == [None, 9.5, None]


def test_it_is_not_told_to_sink_and_others_are() -> None:
    beliefs = told(State.FLOATING, State.RELEASED, State.FLOATING, State.REPORTING, State.SLEEPING)
    beliefs[3] = replace(beliefs[3], primary=0.0)
    reminders = SinkReminders(repeat_ms=10_000)
    assert reminders.take_due(beliefs.all(), set(), set(), 0) == [1, 2]
    assert reminders.take_due(beliefs.all(), set(), set(), 0) == []
    # One that was called up would last longer below.
    assert reminders.take_due(beliefs.all(), set(), {3}, 0) == [3]


def is_released(config: Mission, watch: ChargingWatch, docked: Told) -> set[int]:
    """The aMussels that both rules of dispatch release; fails if they differ."""
    released = {
        frozenset(
            BelievedDispatch(replace(config, dispatch=rule), watch, docked, 0, list, len).due(()).released
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
