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


def alerted(threshold: float, *heard: tuple[int, float] | ShortStatus | int) -> list[list[int]]:
    """Who alerts after each report of (aMussel, charge), of 7 and 8, or by sound, or after one is forgotten."""
    beliefs, falls, found = HoldLast([7, 8]), Falls(threshold), []
    for second, it in enumerate(heard, start=1):
        if isinstance(it, int):
            beliefs.forget(it)
        elif isinstance(it, ShortStatus):
            assert beliefs.hear_short(it, 1000 * second) is None
        else:
            packet = StatusPacket(it[0], second, State.ACTIVE, it[1], 1.0, 10.0, 20.0, 3.0, 30_000 * second)
            assert beliefs.hear(packet, 1000 * second) is None
        found.append([belief.agent_id for belief in falls.hear(beliefs.all())])
    return found


@pytest.mark.parametrize(
    ("threshold", "charges", "alerted_at"),
    [
        # At the threshold, 0.8, one alerts, because the mission collects it: once for a fall, and again after a charge.
        (0.8, (0.9, 0.81, 0.8, 0.79, 0.75, 0.81, 1.0, 0.8), [2, 7]),
        # One that sways about the threshold fell once.
        (0.8, (0.81, 0.79, 0.81, 0.79, 0.84, 0.8, 0.849, 0.7), [1]),
        (0.8, (0.79, 0.86, 0.81, 0.79, 0.81, 0.79), [0, 3]),
        # A level that no battery reaches would end its alerts.
        (0.98, (0.98, 0.985, 0.97, 1.0, 0.97), [0, 4]),
    ],
)
def test_one_alerts_once_for_a_fall(
    threshold: float, charges: tuple[float, ...], alerted_at: list[int]
) -> None:
    assert [
        n for n, it in enumerate(alerted(threshold, *((7, charge) for charge in charges))) if it
    ] == alerted_at


def test_one_is_low_when_it_is_first_heard_so_each_for_itself_and_one_that_was_spawned_low() -> None:
    assert alerted(0.8, (8, 0.5), (7, 0.5), 7, (7, 0.5)) == [[8], [7], [], [7]]


def test_an_answer_by_sound_is_heard_too() -> None:
    assert alerted(0.8, (7, 0.9), ShortStatus(7, State.ACTIVE, 0.7, 1.0)) == [[], [7]]


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
