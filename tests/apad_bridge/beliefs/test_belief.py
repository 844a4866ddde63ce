from __future__ import annotations

import pytest

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.mixture import Gaussian
from apad_bridge.beliefs.modes import DOCKED, Mode, mode_of
from firmware_model.states import State


def test_every_state_has_a_mode() -> None:
    for state in State:
        assert mode_of(state, 0.5, 0.5) in Mode
    assert mode_of(State.CHARGING, 0.5, 0.5) is Mode.CHARGING_PRIMARY
    assert mode_of(State.CHARGING, 1.0, 0.5) is Mode.CHARGING_SECONDARY
    assert mode_of(State.REPORTING, 1.0, 1.0) is Mode.FULL


def test_a_belief_without_deviations_answers_yes_or_no() -> None:
    belief = Belief(3, 1000, State.ACTIVE, 0.5, 1.0, 2.0, 3.0)
    assert (belief.probability_at_most(0.49), belief.probability_at_most(0.5)) == (0.0, 1.0)
    assert belief.charge_interval() == pytest.approx((0.5, 0.5)) and belief.mode is Mode.IDLE
    assert (belief.probability_of(Mode.IDLE), belief.probability_of(*DOCKED)) == (1.0, 0.0)
    assert (belief.at_ms, belief.age_s(4000)) == (1000, 3.0)


def test_a_belief_with_deviations_answers_with_probabilities() -> None:
    modes = (0.25, 0.5, 0.0, 0.0, 0.0, 0.125, 0.125, 0.0, 0.0)
    belief = Belief(
        3, 1000, State.ACTIVE, 0.5, 1.0, 2.0, 3.0, 5000, (0.01, 0.0, 0.0), mode_probabilities=modes
    )
    assert belief.probability_at_most(0.5) == pytest.approx(0.5)
    assert belief.charge_interval(0.6827) == pytest.approx((0.4, 0.6), abs=1e-4)
    assert (belief.mode, belief.probability_of(*DOCKED), belief.at_ms) == (Mode.IDLE, 0.25, 6000)
    split = Belief(
        3, 0, State.ACTIVE, 0.5, 1.0, 0.0, 0.0, parts=(Gaussian(0.3, 0.2, 0.01), Gaussian(0.7, 0.6, 0.01))
    )
    assert split.probability_at_most(0.4) == pytest.approx(0.3)
