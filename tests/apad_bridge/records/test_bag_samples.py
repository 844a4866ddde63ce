"""Tests reading beliefs from bags of this version, and of a version that recorded the means alone."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from contextlib import closing, suppress
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.time_scale import TimeScale
from apad_bridge.beliefs.belief import Belief, ClockBelief, Source
from apad_bridge.beliefs.mixture import Gaussian
from apad_bridge.beliefs.modes import Mode
from apad_bridge.records.bag import BagWriter, repair_bag
from apad_bridge.records.bag_messages import typestore
from apad_bridge.records.bag_samples import BagUnreadable, instants, why_no_deviations
from apad_bridge.records.samples import TruthSample, belief_sample
from firmware_model.packets import QUANTITIES, Reported
from firmware_model.states import State

THETA = 30
TRUTH = TruthSample(7, int(State.ACTIVE), 0.5, 1.0, 1.5, -2.5, 3.0, False, 0)


def carried() -> Belief:
    probabilities = [0.0] * len(Mode)
    probabilities[Mode.IDLE], probabilities[Mode.LOST] = 0.75, 0.25
    return Belief(
        7,
        60_000,
        State.ACTIVE,
        0.5,
        0.875,
        10.0,
        20.0,
        1500,
        (0.0001, 0.00005, 0.0004),
        (4.0, 0.5, 9.0),
        tuple(probabilities),
        ClockBelief(250.0, 3.0, 90_000.0, 0.0, 1.0),
        Source.PACKET | Source.SILENCE,
        70_000,
        parts=(Gaussian(0.75, 0.5, 0.0), Gaussian(0.25, 1.125, 0.5)),
        reported=Reported(3.25),
    )


BELIEVED = {
    **{"agent_id": 7, "state": State.ACTIVE, "charge": 0.5, "secondary": 0.875},
    **{"north_m": 10.0, "east_m": 20.0, "age_s": 1.5},
    **{"charge_deviation": pytest.approx(0.01), "secondary_deviation": pytest.approx(0.02)},
    "charges_covariance": pytest.approx(0.00005),
    **{"north_deviation_m": 2.0, "east_deviation_m": 3.0, "place_covariance_m2": 0.5},
    **{"clock_offset_ms": 250.0, "clock_deviation_ms": 300.0},
    **{"silent_timeslots": 65_535, "learned_from": 3, "charge_parts": (0.75, 0.5, 0.0, 0.25, 1.125, 0.5)},
}


def write(path: Path, times_ms: Iterable[int]) -> Path:
    """A bag with a sample at each time."""
    with closing(BagWriter(path, TimeScale(THETA))) as bag:
        for at_ms in times_ms:
            bag.sample(at_ms, [TRUTH], [belief_sample(carried(), 61_500)], None)
    return path


def test_all_of_a_belief_comes_back(tmp_path: Path) -> None:
    write(tmp_path / "run.bag", [61_500])
    assert why_no_deviations(tmp_path / "run.bag") is None
    (instant,) = instants([tmp_path / "run.bag"], 500)
    (it,) = instant.beliefs
    assert (instant.at_ms, instant.agent_ms, instant.truths) == (61_500, THETA * 61_500, (TRUTH,))
    # A tenth of the quarter lies 1.2816 deviations below its mean; more than 0.025 lies above 1.
    expected = BELIEVED | {"charge_low": pytest.approx(1.125 - 1.2816 * 0.5, abs=1e-4), "charge_high": 1.0}
    assert {name: getattr(it, name) for name in expected} == expected
    modes = {mode: share for mode, share in enumerate(it.mode_probabilities) if share}
    assert (len(it.mode_probabilities), modes) == (len(Mode), {Mode.IDLE: 0.75, Mode.LOST: 0.25})
    assert dict(zip(QUANTITIES, it.reported, strict=True))["depth_m"] == 3.25


def test_who_claims_to_be_certain_knows_no_deviation() -> None:
    newest = Belief(7, 60_000, State.ACTIVE, 0.5, 0.875, 10.0, 20.0)
    sample = belief_sample(newest, 61_000)
    unknown = *sample[7:15], sample.clock_offset_ms, sample.clock_deviation_ms, *sample.reported
    assert sample[:7] == (7, State.ACTIVE, 0.5, 0.875, 10.0, 20.0, 1.0) and all(map(math.isnan, unknown))
    assert (sample.mode_probabilities, sample.silent_timeslots, sample.learned_from) == ((), 0, 1)


def test_the_definition_counts_modes_and_sources_as_beliefs_do() -> None:
    constants = {name: value for name, _, value in typestore().fielddefs["musselbed_msgs/msg/AgentBelief"][0]}
    assert constants == {f"MODE_{mode.name}": mode for mode in Mode} | {
        f"FROM_{source.name}": source for source in Source
    }


def test_samples_are_taken_a_period_apart_across_bags(tmp_path: Path) -> None:
    first, second = range(0, 25_000, 1000), range(33_000, 62_000, 1000)
    bags = [write(tmp_path / "run.bag", first), write(tmp_path / "run-2.bag", second)]
    assert [it.at_ms for it in instants(bags, 10_000)] == [0, 10_000, 20_000, 33_000, 40_000, 50_000, 60_000]


def test_a_bag_of_means_is_read_by_its_own_definitions(
    tmp_path: Path, bag_of_means: Callable[..., Path]
) -> None:
    path = bag_of_means(tmp_path / "run.bag", 31)
    assert why_no_deviations(path) == f"{path}: its beliefs have no deviations"
    _, second, *_ = found = list(instants([path], 10_000))
    (it,) = second.beliefs
    assert ([it.at_ms for it in found], second.truths) == ([0, 10_000, 20_000, 30_000], (TRUTH,))
    assert it[:7] == (7, State.ACTIVE, 0.75, 1.0, 1.0, -2.5, 4.5)
    assert math.isnan(it.charge_deviation) and math.isnan(it.charge_low) and it.mode_probabilities == ()


def test_an_unclosed_bag_of_means_is_repaired_and_stays_one(
    tmp_path: Path, bag_of_means: Callable[..., Path]
) -> None:
    path = bag_of_means(tmp_path / "run.bag", 5, closed=False)
    with pytest.raises(BagUnreadable, match=r"run\.bag: not a bag"):
        list(instants([path], 1000))
    assert str(why_no_deviations(path)).startswith(f"{path}: not a bag that can be read")
    path.write_bytes(path.read_bytes()[:-250])
    repair = repair_bag(path)
    assert repair is not None and (repair["messages"], repair["last_ms"]) == (9, 4000)
    assert [it.at_ms for it in instants([path], 1000)] == [0, 1000, 2000, 3000]


@given(st.binary(max_size=2000), st.booleans())
def test_random_bytes_are_a_bag_that_cannot_be_read(
    tmp_path_factory: pytest.TempPathFactory, noise: bytes, begins_as_a_bag: bool
) -> None:
    path = tmp_path_factory.mktemp("noise") / "run.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" * begins_as_a_bag + noise)
    with pytest.raises(BagUnreadable, match=re.escape(str(path))) as told:
        list(instants([path], 1000))
    assert "\n" not in str(told.value)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A bag of five seconds."""
    return write(tmp_path_factory.mktemp("whole") / "run.bag", range(0, 5000, 1000)).read_bytes()


@given(st.integers(4200, 10_000), st.binary(min_size=1, max_size=40))
@settings(max_examples=300)
def test_a_bag_with_noise_in_it_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, whole: bytes, at: int, noise: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "noisy.bag"
    path.write_bytes(whole[:at] + noise + whole[at + len(noise) :])
    with suppress(BagUnreadable):
        list(instants([path], 1000))
