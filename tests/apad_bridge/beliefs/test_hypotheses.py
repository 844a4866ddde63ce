"""Several hypotheses of one charge: their reduction, their weighing, and the state after a doubted reading."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from scenario_files import POOL_FILE

from apad_bridge.assembly.flight_config import flight_config
from apad_bridge.beliefs import charge_filter as charge
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.charge_filter import PRIMARY, SIZE, Anchor
from apad_bridge.beliefs.modes import Mode
from apad_bridge.beliefs.packet_weighing import HypothesisWeigher, Reading
from apad_bridge.beliefs.twin import Twin
from apad_bridge.beliefs.twin_parameters import UNKNOWN
from apad_bridge.beliefs.twin_state import TwinState
from apad_bridge.scenario.blocks.estimator_options import Beliefs, EstimatorKind, TwinModel
from apad_bridge.scenario.loader import load
from firmware_model.packets import StatusPacket
from firmware_model.states import State

MODEL = TwinModel(
    drain_deviation=0.1,
    sensor_noise=0.015,
    bias_deviation=0.01,
    unscheduled=0.03,
    fix_deviation_m=1.0,
    current_deviation_m_s=0.02,
)
POOL = load(POOL_FILE)
TWINS = flight_config(replace(POOL, beliefs=Beliefs(estimator=EstimatorKind.TWIN, twin=MODEL))).twin
assert TWINS is not None
KNOWLEDGE = TWINS.parameters


def anchor(weight: float, primary: float, sd: float = 0.02) -> Anchor:
    mean, cov = np.array([primary, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]), np.zeros((SIZE, SIZE))
    cov[PRIMARY, PRIMARY] = sd**2
    return Anchor(weight, mean, cov)


def heard(at_ms: int, primary: float) -> Belief:
    found = Twin(KNOWLEDGE, {}).update(
        None,
        StatusPacket(1, 0, State.ACTIVE, primary, 1.0, 3.0, 4.0, 3.0, POOL.theta * at_ms),
        at_ms,
    )
    assert found is not None
    return found


def state_of(belief: Belief) -> TwinState:
    return belief.estimator_state


def test_four_are_kept_the_most_probable_first_and_the_rest_become_one() -> None:
    """0.7 and 0.9 at 2 to 1 have the mean 0.7667; 4e-4 is the variance within, 2/3 * 0.0667^2 + 1/3 * 0.1333^2 between."""
    rows = [anchor(0.05, 0.9), anchor(0.3, 0.3), anchor(0.1, 0.7), anchor(0.4, 0.1), anchor(0.15, 0.5)]
    kept = charge.reduced(rows)
    assert [row.weight for row in kept] == pytest.approx([0.4, 0.3, 0.15, 0.15])
    assert [row.mean[PRIMARY] for row in kept] == pytest.approx([0.1, 0.3, 0.5, 0.7 + 0.2 / 3])
    assert [sqrt(row.cov[PRIMARY, PRIMARY]) for row in kept[:3]] == pytest.approx([0.02] * 3)
    assert kept[3].cov[PRIMARY, PRIMARY] == pytest.approx(4e-4 + 2 / 3 * (0.2 / 3) ** 2 + (0.4 / 3) ** 2 / 3)


def test_the_negligible_is_not_weighed_wherever_it_stands_while_the_likely_explains_what_is_heard() -> None:
    twin_state, reading = state_of(heard(0, 0.6)), Reading.stated(State.ACTIVE, 0.62, 1.0)
    likely, negligible = anchor(0.9995, 0.6), anchor(0.0005, 0.64)
    found = [
        HypothesisWeigher(KNOWLEDGE).corrected(twin_state, UNKNOWN, rows, reading).mean[PRIMARY]
        for rows in ([likely], [likely, negligible], [negligible, likely])
    ]
    assert found[0] == found[1] == found[2]
    contradicted = Reading.stated(State.ACTIVE, 0.7, 1.0)
    alone, weighed = (
        HypothesisWeigher(KNOWLEDGE).corrected(twin_state, UNKNOWN, rows, contradicted).mean[PRIMARY]
        for rows in ([likely], [likely, negligible])
    )
    assert weighed > alone + 1e-4


def test_a_lost_one_s_last_words_are_read_as_a_sleeper_s() -> None:
    """A lost aMussel draws nothing but the load of its clock."""
    row = anchor(1.0, 0.05)
    row.cov[charge.ASLEEP, charge.ASLEEP] = 1e-4
    both = [
        charge.measured(row.mean, row.cov, KNOWLEDGE.sensor, mode, (0.02, 0.9))
        for mode in (Mode.LOST, Mode.ASLEEP)
    ]
    assert both[0][0] == pytest.approx(both[1][0]) and both[0][0][charge.ASLEEP] < 0


@pytest.mark.parametrize(
    ("bias", "first", "second", "believed"),
    [(0.0, 0.2, 0.2, 0.2), (0.0, 0.2, 0.35, 0.35), (0.0, 0.2, 0.8, 0.8), (-0.4, 0.8, 0.8, 1.0)],
)
def test_after_a_doubted_reading_the_next_one_decides_whatever_it_says(
    bias: float, first: float, second: float, believed: float
) -> None:
    """The deviation becomes half of the doubted reading's distance: five of these reach farther than that reading.

    A sensor with a bias that states the believed charge is as far off as its bias.
    """
    twin_state = state_of(heard(0, 0.8))
    weigher, expected = HypothesisWeigher(KNOWLEDGE), anchor(1.0, 0.8)
    expected.mean[charge.SENSOR] = bias
    doubted = weigher.corrected(twin_state, UNKNOWN, [expected], Reading.stated(State.ACTIVE, first, 1.0))
    assert doubted.gated == 1 and doubted.mean[PRIMARY] == pytest.approx(0.8, abs=0.05)
    assert doubted.cov[PRIMARY, PRIMARY] > 0.1**2
    after = weigher.corrected(
        doubted, UNKNOWN, list(doubted.anchors), Reading.stated(State.ACTIVE, second, 1.0)
    )
    assert after.gated == 1 and after.mean[PRIMARY] == pytest.approx(believed, abs=0.02)
