"""Tests a script's forecasts: on twins against a calculation by hand, and on an estimator that forecasts nothing."""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import NormalDist

import pytest

from apad_bridge.beliefs.belief import Belief
from apad_bridge.mission.script_values import Refused
from apad_bridge.scenario.blocks.estimator_options import Beliefs, EstimatorKind, TwinModel
from apad_bridge.scenario.schema import Scenario
from apad_bridge.scripting.api import Api
from tests.apad_bridge.scripting.test_api import flies, flown

DRAIN_DEVIATION = CAPACITY_DEVIATION = 0.1
"""What a twin assumes of the batteries; the charge sinks as much faster as they hold less."""
A_SECOND = 0.0010427134 / 60 * 30  # equation (1), at theta = 30
LOW = 0.8


@pytest.fixture(scope="module")
def twins(pool: Scenario) -> Scenario:
    model = TwinModel(
        drain_deviation=DRAIN_DEVIATION,
        sensor_noise=0.005,
        bias_deviation=0.01,
        unscheduled=0.03,
        fix_deviation_m=1.0,
        current_deviation_m_s=0.02,
    )
    return replace(pool, beliefs=Beliefs(estimator=EstimatorKind.TWIN, twin=model))


def expected_chance(belief: Belief, elapsed_s: float) -> float:
    """P(charge <= LOW) of a Gaussian that sinks by equation (1) and widens, as drain and capacity are known to a tenth."""
    spent = A_SECOND * elapsed_s
    sd = math.sqrt(belief.charge_cov[0] + (math.hypot(DRAIN_DEVIATION, CAPACITY_DEVIATION) * spent) ** 2)
    return NormalDist(belief.primary - spent, sd).cdf(LOW)


def test_a_chance_is_that_of_the_equation_and_its_doubts(twins: Scenario) -> None:
    def script(api: Api) -> None:
        api.sleep(2)
        fullest = max(api.agents(), key=api.battery)
        now_s, belief = api.now(), api.belief(fullest)
        crossing_s = (belief.primary - LOW) / A_SECOND
        assert crossing_s > 120, "a start that is too low for this test"
        assert api.chance(fullest, "low", now_s + crossing_s) == pytest.approx(0.5, abs=0.01)
        for share in (0.5, 0.8, 1.0, 1.1, 1.4):
            expected = expected_chance(belief, share * crossing_s)
            assert api.chance(fullest, "low", now_s + share * crossing_s) == pytest.approx(expected, abs=0.01)
        sure_s = api.sure_at(fullest, "low", share=0.95, within=2 * crossing_s)
        assert expected_chance(belief, sure_s - now_s) == pytest.approx(0.95, abs=0.01)
        assert api.sure_at(fullest, "low", share=0.95, within=crossing_s) is None
        assert api.now() == now_s, "a forecast takes no mission time"

    flies(twins, script)


def test_what_is_so_now_is_sure_now_and_a_function_is_a_question_too(twins: Scenario) -> None:
    def script(api: Api) -> None:
        api.sleep(2)
        neediest = min(api.agents(), key=api.battery)
        assert api.battery(neediest) < LOW - 0.07 and api.sure_at(neediest, "low") == api.now()
        questions = ("low", "full", "lost", lambda belief: belief.probability_at_most(1.0))
        asked = [api.chance(neediest, it) for it in questions]
        assert asked == [pytest.approx(1.0, abs=1e-6), pytest.approx(0.0, abs=1e-6), 0.0, 1.0]

    flies(twins, script)


@flown
def test_who_holds_the_last_packet_says_what_is_now_and_refuses_the_rest(api: Api) -> None:
    api.sleep(2)
    assert all(api.chance(agent, "low") == float(api.battery(agent) <= LOW) for agent in (1, 4, 7))
    with pytest.raises(Refused, match=r"predicts nothing.*estimator: twin"):
        api.chance(1, "low", api.now() + 60)
    with pytest.raises(Refused, match="predicts nothing"):
        api.sure_at(1, "low")


def test_what_cannot_be_asked_is_refused_in_one_line(twins: Scenario) -> None:
    def script(api: Api) -> None:
        api.sleep(10)
        for call, message in (
            (lambda: api.chance(1, "hungry"), "no question 'hungry': ask low, full, lost"),
            (lambda: api.chance(1, "low", 3), "3 s are over: it is 10 s"),
            (lambda: api.chance(1, "low", math.nan), "nan s cannot be foretold"),
            (lambda: api.sure_at(1, "low", within=math.inf), "inf s cannot be foretold"),
            (lambda: api.sure_at(1, "low", share=1.5), "a share of 1.5"),
            (lambda: api.chance(99, "low"), "not of this scenario"),
        ):
            with pytest.raises(Refused, match=message):
                call()

    flies(twins, script)
