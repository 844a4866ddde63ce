"""Tests that answered pings become places and ranges that the beliefs learn, and notes for the journal."""

from __future__ import annotations

from math import dist

import pytest

from agents.time_scale import TimeScale
from apad_bridge.acoustics.locator import Locator
from apad_bridge.acoustics.ranging import RangingService
from apad_bridge.acoustics.schedule import AcousticScheduler, ScheduleConfig
from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.fleet_beliefs import FleetBeliefs
from apad_bridge.beliefs.measurement import Fixed, Measurement, Ranged
from apad_bridge.beliefs.modes import Mode
from apad_bridge.events.sound_events import Asked, PlaceFixed
from apad_bridge.mission.facts import Ping, RangeHeard, Send
from apad_bridge.scenario.water.water_options import Localisation, Talk, Water
from apad_bridge.vehicle.commands import PoseReported
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State

LOCALISATION = Localisation(deviation_m=0.2, memory_s=600.0, apart_m=5.0)
MUSSEL_M, KEEL_M = (30.0, 40.0, 10.0), 0.5
WAY = ((0.0, 0.0), (60.0, 0.0), (60.0, 80.0), (0.0, 80.0))


class Learner:
    """An estimator that lists the measurements it learns, and believes the last packet."""

    def __init__(self) -> None:
        self.learned: list[Measurement] = []

    def predict(self, belief: Belief, to_ms: int) -> Belief:
        return belief

    def update(self, belief: Belief | None, measurement: Measurement, at_ms: int) -> Belief | None:
        if isinstance(measurement, StatusPacket):
            packet = measurement
            return Belief(7, at_ms, packet.state, 0.9, 1.0, packet.north_m, packet.east_m)
        self.learned.append(measurement)
        return belief


def ranging(locator: Locator | None) -> RangingService:
    scheduler = AcousticScheduler(
        ScheduleConfig(TimeScale(1), Water(talk=Talk(ping_period_s=5.0)), 100), MusselbedCodec(), None, [7]
    )
    return RangingService(scheduler, locator, KEEL_M, MUSSEL_M[2], deviation_m=0.2)


def fleet_with(state: State = State.SLEEPING) -> tuple[FleetBeliefs, Learner]:
    learner = Learner()
    beliefs = FleetBeliefs(learner, [7])
    beliefs.hear(StatusPacket(7, 0, state, 0.9, 1.0, 29.0, 41.0, 10.0, 0), 0)
    return beliefs, learner


def taken(service: RangingService, beliefs: FleetBeliefs, n: int) -> list[object]:
    north_m, east_m = WAY[n]
    fact = RangeHeard(1000 * n, 7, dist((north_m, east_m, KEEL_M), MUSSEL_M))
    return [*service.hear(fact, PoseReported(1000 * n, north_m, east_m, 0.0), beliefs, 1000 * n)]


def test_ranges_become_a_place_that_the_beliefs_learn_and_the_journal_keeps() -> None:
    locator = Locator(LOCALISATION, MUSSEL_M[2])
    service, (beliefs, learner) = ranging(locator), fleet_with()
    assert taken(service, beliefs, 0) == [] and taken(service, beliefs, 1) == []
    (told,) = taken(service, beliefs, 2)
    assert isinstance(told, PlaceFixed) and (told.id, told.ranges) == (7, 3)
    assert (told.north_m, told.east_m) == pytest.approx((30, 40), abs=1e-3)
    # Until there is a fix the beliefs learn the range itself, along the bottom: 50 m from each of the corners.
    first, second, fixed = learner.learned
    assert isinstance(first, Ranged) and isinstance(second, Ranged) and isinstance(fixed, Fixed)
    assert (first.range_m, first.variance_m2) == pytest.approx((50.0, 0.04))
    assert (fixed.north_m, fixed.east_m) == pytest.approx((30, 40), abs=1e-3)
    assert fixed.variance_m2 == pytest.approx((told.covariance[0] + told.covariance[2]) / 2, abs=1e-5)


def test_a_dock_makes_what_was_measured_worthless() -> None:
    locator = Locator(LOCALISATION, MUSSEL_M[2])
    service, (beliefs, learner) = ranging(locator), fleet_with()
    taken(service, beliefs, 0)
    taken(service, beliefs, 1)
    service.moved(7, 2000)
    assert taken(service, beliefs, 2) == []
    assert isinstance(learner.learned[-1], Ranged)
    assert service.dropped["no fix: too few ranges from places apart"] == 3


HERE = PoseReported(0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("has_locator", "range_m", "pose"),
    [(True, None, HERE), (True, 50.0, None), (False, 50.0, HERE)],
    ids=["without an answer", "without a place", "without localisation"],
)
def test_nothing_is_learned(has_locator: bool, range_m: float | None, pose: PoseReported | None) -> None:
    beliefs, learner = fleet_with()
    service = ranging(Locator(LOCALISATION, MUSSEL_M[2]) if has_locator else None)
    assert [*service.hear(RangeHeard(0, 7, range_m), pose, beliefs, 0)] == learner.learned == []


@pytest.mark.parametrize(("state", "pings"), [(State.SLEEPING, 1), (State.FLOATING, 0), (State.CHARGING, 0)])
def test_only_who_is_believed_to_hear_is_pinged(state: State, pings: int) -> None:
    beliefs, _ = fleet_with(state)
    assert len(ranging(None).advance(beliefs.all(), 0)) == pings


class Always:
    """A policy to which every answer is worth a ping."""

    def is_worth(self, belief: Belief, now_ms: int) -> bool:
        return True

    def urgency(self, belief: Belief) -> float:
        return 1.0


def test_one_that_too_little_is_known_of_is_pinged_out_of_turn_and_not_again_before_it_could_answer() -> None:
    silent = ScheduleConfig(TimeScale(1), Water(), 100)  # without a policy it pings nobody
    beliefs, _ = fleet_with()
    service = RangingService(
        AcousticScheduler(silent, MusselbedCodec(), None, [7]), None, KEEL_M, MUSSEL_M[2], 0.2, Always()
    )
    actions = {now_ms: service.advance(beliefs.all(), now_ms) for now_ms in range(0, 1_900_000, 10_000)}
    assert all(
        isinstance(action, Ping) and action.agent_id == 7 for batch in actions.values() for action in batch
    )
    # Ten minutes of agent time apart, as for an aMussel that did not answer.
    assert [now_ms for now_ms, batch in actions.items() if batch] == [
        0,
        600_000,
        1_200_000,
        1_800_000,
    ]
    docked, _ = fleet_with(State.CHARGING)
    assert service.advance(docked.all(), 3_000_000) == []


def modes(mode: Mode, share: float) -> tuple[float, ...]:
    """Mode probabilities: `share` for one mode, the rest for asleep."""
    return tuple(share if it is mode else 1 - share if it is Mode.ASLEEP else 0.0 for it in Mode)


@pytest.mark.parametrize(
    ("state", "probabilities", "asked"),
    [
        # It last reported from the dock, but almost certainly sank since then, and so it can receive.
        (State.CHARGING, modes(Mode.FULL, 0.01), True),
        (State.SLEEPING, modes(Mode.FLOATING, 0.6), False),
        (State.SLEEPING, modes(Mode.CHARGING_PRIMARY, 0.9), False),
        (State.CHARGING, (), False),
    ],
)
def test_who_is_more_probably_deaf_than_not_is_not_asked(
    state: State, probabilities: tuple[float, ...], asked: bool
) -> None:
    quiet = ScheduleConfig(TimeScale(1), Water(), 100, answer_ms=893)
    scheduler = AcousticScheduler(quiet, MusselbedCodec(), None, [7])
    service = RangingService(scheduler, None, KEEL_M, MUSSEL_M[2], 0.2, None, Always())
    belief = Belief(7, 0, state, 0.5, 1.0, 0.0, 0.0, mode_probabilities=probabilities)
    actions = service.advance([belief], 0)
    assert [it.data for it in actions if isinstance(it, Asked)] == ([{"id": 7}] if asked else [])
    assert len([it for it in actions if isinstance(it, Send)]) == asked
    service.advance([], 60_000)
    assert service.dropped == ({"sound: asked how it was, and no answer came in time": 1} if asked else {})
