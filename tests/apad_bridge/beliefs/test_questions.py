from __future__ import annotations

from dataclasses import replace

import pytest

from apad_bridge.beliefs.belief import Belief, Suspicion
from apad_bridge.beliefs.hold_last import LastPacket
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.pings import PingForCharge, PingForPlace, PingSuspects, ids_to_ping
from apad_bridge.beliefs.questions import candidate_below, full_above, lost, probability_at, sure_at_ms
from firmware_model.states import State

HOUR = 3_600_000
IN_THE_WATER = (0.0, 1.0, *(0.0,) * 7)


class Draining:
    """An estimator that drains a tenth of a battery an hour, with some uncertainty."""

    def predict(self, belief: Belief, to_ms: int) -> Belief:
        return believed(belief.agent_id, 1.0 - 0.1 * to_ms / HOUR, 0.05, to_ms)

    def update(self, belief: Belief | None, measurement: object, at_ms: int) -> Belief | None:
        return belief


def believed(
    agent_id: int, charge: float, sd: float, at_ms: int, modes: tuple[float, ...] = IN_THE_WATER
) -> Belief:
    cov = (sd**2, 0.0, 0.0)
    return Belief(agent_id, 0, State.ACTIVE, charge, 1.0, 0.0, 0.0, at_ms, cov, mode_probabilities=modes)


def test_when_a_planner_will_be_nine_tenths_sure() -> None:
    start = believed(1, 1.0, 0.05, 0)
    low, estimator = candidate_below(0.5), Draining()
    probabilities = [low(start), probability_at(estimator, start, low, 5 * HOUR)]
    assert probabilities == pytest.approx([0, 0.5], abs=1e-6)
    # The 0.9 quantile of a Gaussian lies at 1.2816 deviations: 0.064 of a battery, 38.4 minutes after it is at 0.5.
    asked = (low, 10 * HOUR), (low, 5 * HOUR), (full_above(0.5), HOUR)
    found_ms = [sure_at_ms(estimator, start, what, 0.9, until_ms, HOUR) for what, until_ms in asked]
    assert found_ms == [pytest.approx(5 * HOUR + 0.6408 * HOUR, abs=2000), None, 0]
    with pytest.raises(ValueError):
        sure_at_ms(estimator, start, low, 0.9, HOUR, 0)


def test_an_estimator_that_stands_still_is_never_surer() -> None:
    held = Belief(1, 0, State.ACTIVE, 0.9, 1.0, 0.0, 0.0)
    assert sure_at_ms(LastPacket(), held, candidate_below(0.5), 0.9, 10 * HOUR, HOUR) is None


def test_one_that_is_docked_or_lost_is_no_candidate() -> None:
    docked = tuple(float(mode is Mode.CHARGING_PRIMARY) for mode in Mode)
    gone = tuple(0.7 if mode is Mode.LOST else 0.3 if mode is Mode.ASLEEP else 0.0 for mode in Mode)
    assert candidate_below(0.5)(believed(1, 0.1, 0.0, 0, docked)) == 0.0
    assert candidate_below(0.5)(believed(1, 0.0, 0.0, 0, gone)) == pytest.approx(0.3)
    assert lost(believed(1, 0.0, 0.0, 0, gone)) == 0.7


def test_a_ping_must_be_worth_its_energy() -> None:
    policy = PingForCharge(
        candidate_below(0.5),
        wrong_plan_charge=0.06,
        answer_charge=0.005,
        not_before_ms=HOUR,
        spare_charge=0.05,
        answer_deviation=0.02,
    )
    # At 0.505 the chance of an error grows with the uncertainty; an answer is no more accurate than 0.02.
    rows = (0.52, 0.1), (0.9, 0.1), (0.0, 0.01), (0.5, 0.3), (0.505, 0.019), (0.505, 0.021)
    unsure, *others = beliefs = [believed(n, *it, 2 * HOUR) for n, it in enumerate(rows, 1)]
    worth = [policy.is_worth(it, 2 * HOUR) for it in beliefs]
    assert worth == [True, False, False, True, False, True] and not policy.is_worth(unsure, HOUR // 2)
    assert ids_to_ping(policy, [unsure, *others[:3]], 2 * HOUR) == [4, 1]


def test_a_ping_must_be_worth_the_way_that_a_search_would_cost() -> None:
    policy = PingForPlace(candidate_below(0.5), answer_m=2.0)

    def placed(agent_id: int, charge: float, north_m2: float, east_m2: float) -> Belief:
        return replace(believed(agent_id, charge, 0.001, 0), place_cov=(north_m2, 0.0, east_m2))

    # 5 m off (a 3, 4, 5 triangle) and certain to be fetched; the same distance and certain to stay; a small distance.
    lost_sight_of, not_wanted = placed(1, 0.2, 9.0, 16.0), placed(2, 0.9, 9.0, 16.0)
    near, farther = placed(3, 0.2, 1.0, 2.0), placed(4, 0.2, 36.0, 64.0)
    assert policy.urgency(lost_sight_of) == pytest.approx(5.0)
    assert ids_to_ping(policy, [lost_sight_of, not_wanted, near, farther], 0) == [4, 1]


def test_suspects_are_pinged_first_and_not_again_at_once() -> None:
    sure = Belief(1, 0, State.SLEEPING, 0.9, 1.0, 0.0, 0.0)
    suspect = Belief(2, 50_000, State.SLEEPING, 0.9, 1.0, 0.0, 0.0, suspicion=Suspicion("it jumps", False))
    lying = Belief(3, 0, State.SLEEPING, 0.4, 1.0, 0.0, 0.0, place_cov=(9.0, 0.0, 16.0))
    places = PingForPlace(candidate_below(0.5), answer_m=2.0)
    for others, at_ms, pinged in ((places, 60_000, [3]), (places, 70_000, [2, 3]), (None, 70_000, [2])):
        assert ids_to_ping(PingSuspects(others, 20_000), [sure, suspect, lying], at_ms) == pinged
