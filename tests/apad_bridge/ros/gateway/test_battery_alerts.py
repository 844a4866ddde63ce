"""The falls that cause an alert of an aMussel, and the message's content."""

from __future__ import annotations

from dataclasses import replace

import pytest

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.beliefs.modes import Mode
from apad_bridge.ros.gateway.agent_topics import AgentReport, nav_sts
from apad_bridge.ros.gateway.battery_alerts import Falls, alert
from apad_bridge.scenario.area.local_frame import LocalFrame
from firmware_model.packets import Reported, ShortStatus, StatusPacket
from firmware_model.states import State

BIOGRAD = LocalFrame(43.9330937, 15.4443468)


class Fleet:
    """aMussels 7 and 8, believed as they report; `alerts` gives those that alert at a tick."""

    def __init__(self, threshold: float) -> None:
        self.beliefs = HoldLast([7, 8])
        self.falls = Falls(threshold)
        self.sequence = 0

    def report(self, agent_id: int, charge: float, at_ms: int) -> None:
        self.sequence += 1
        packet = StatusPacket(
            agent_id=agent_id,
            sequence=self.sequence,
            agent_ms=30 * at_ms,
            state=State.ACTIVE,
            north_m=10.0,
            east_m=20.0,
            depth_m=3.0,
            primary=charge,
            secondary=1.0,
        )
        assert self.beliefs.hear(packet, at_ms) is None

    def alerts(self) -> list[int]:
        return [belief.agent_id for belief in self.falls.hear(self.beliefs.all())]


def test_once_for_a_fall_and_again_after_a_charge() -> None:
    """An aMussel at the threshold, 0.8, alerts, because the mission collects it."""
    fleet, alerted = Fleet(0.8), []
    for second, charge in enumerate((0.9, 0.81, 0.8, 0.79, 0.75, 0.81, 1.0, 0.8), start=1):
        fleet.report(7, charge, 1000 * second)
        alerted.append(fleet.alerts())
    assert alerted == [[], [], [7], [], [], [], [], [7]]


@pytest.mark.parametrize(
    ("threshold", "charges", "alerted_at"),
    [
        (0.8, (0.81, 0.79, 0.81, 0.79, 0.84, 0.8, 0.849, 0.7), [1]),
        (0.8, (0.79, 0.86, 0.81, 0.79, 0.81, 0.79), [0, 3]),
        (
            0.98,
            (0.98, 0.985, 0.97, 1.0, 0.97),
            [0, 4],
        ),  # a level that no battery reaches would end its alerts
    ],
)
def test_one_that_sways_about_the_threshold_fell_once(
    threshold: float, charges: tuple[float, ...], alerted_at: list[int]
) -> None:
    fleet, alerted = Fleet(threshold), []
    for number, charge in enumerate(charges):
        fleet.report(7, charge, 1000 * (number + 1))
        if fleet.alerts():
            alerted.append(number)
    assert alerted == alerted_at


def test_one_is_low_when_it_is_first_heard_so() -> None:
    fleet = Fleet(0.8)
    fleet.report(8, 0.5, 1000)
    assert fleet.alerts() == [8]
    fleet.report(7, 0.5, 2000)
    assert fleet.alerts() == [7], "each for itself"
    fleet.beliefs.forget(7)
    assert fleet.alerts() == []
    fleet.report(7, 0.5, 3000)
    assert fleet.alerts() == [7], "another one, that was spawned low"


def test_an_answer_by_sound_is_heard_too() -> None:
    fleet = Fleet(0.8)
    fleet.report(7, 0.9, 1000)
    assert fleet.alerts() == []
    assert fleet.beliefs.hear_short(ShortStatus(7, State.ACTIVE, 0.7, 1.0), 2000) is None
    assert fleet.alerts() == [7]


def test_an_estimate_that_nobody_heard_alerts_nobody() -> None:
    """A model carries the belief from 0.9 to 0.5 in silence; only the next packet counts."""
    heard = Belief(7, 1000, State.ACTIVE, 0.9, 1.0, 10.0, 20.0)
    sleeping = tuple(float(mode is Mode.ASLEEP) for mode in Mode)
    carried = replace(
        heard, primary=0.5, predicted_ms=60_000, charge_cov=(1e-4, 0.0, 0.0), mode_probabilities=sleeping
    )
    falls = Falls(0.8)
    assert falls.hear([heard]) == [] and falls.hear([carried]) == []
    confirmed = replace(carried, heard_ms=61_000, predicted_ms=0)
    assert falls.hear([confirmed]) == [confirmed]


def test_who_was_low_before_a_supervisor_died_has_alerted() -> None:
    known = [Belief(it, 1000, State.ACTIVE, charge, 1.0, 0.0, 0.0) for it, charge in ((7, 0.7), (8, 0.9))]
    falls = Falls(0.8, known)
    later = [replace(it, heard_ms=5000, primary=it.primary - 0.15) for it in known]
    assert [it.agent_id for it in falls.hear(later)] == [8]


@pytest.mark.parametrize(
    ("namespace", "frame_id"), [("", "/amussel24/"), ("lab/harbour", "/lab/harbour/amussel24/")]
)
def test_an_alert_says_whose_it_is_and_where(namespace: str, frame_id: str) -> None:
    belief = Belief(24, 61_500, State.ACTIVE, 0.8, 1.0, 10.0, 20.0, reported=Reported(3.0))
    message = alert(belief, BIOGRAD, namespace)
    assert message.header.frame_id == frame_id and message.header.stamp.to_sec() == 61.5
    assert (message.position.north, message.position.east, message.position.depth) == (10.0, 20.0, 3.0)
    assert (message.origin.latitude, message.origin.longitude) == (43.9330937, 15.4443468)
    # A degree of latitude is 111 111 m within 0.5 % there; one of longitude that times cos 43.93 degrees, 0.7202.
    place = message.global_position
    assert place.latitude - 43.9330937 == pytest.approx(10 / 111_111, rel=0.005)
    assert place.longitude - 15.4443468 == pytest.approx(20 / (111_111 * 0.7202), rel=0.005)
    assert message.status == 59  # STATUS_ALL_OK


def test_a_position_without_an_origin_does_not_claim_a_global_frame() -> None:
    message = nav_sts(AgentReport(10.0, 20.0, 3.0, 0.5), 1000, None)
    assert (message.global_position.latitude, message.status, message.header.frame_id) == (
        0.0,
        57,
        "musselbed/ned",
    )
