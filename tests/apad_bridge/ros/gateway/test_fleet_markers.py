"""Markers on a screen that keeps them until their deletion, as RViz does, and that misses messages."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from visualization_msgs.msg import Marker

from apad_bridge.beliefs.belief import Belief
from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.beliefs.modes import Mode
from apad_bridge.mission.sources import Allocation
from apad_bridge.ros.gateway.standard_topics import fleet_markers
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.world.roster import PresenceRequest, Presences, PresenceTrigger
from firmware_model.packets import StatusPacket
from firmware_model.states import State


class Screen:
    """RViz's part: ADD draws or moves a marker, DELETEALL deletes all, and no other marker changes."""

    def __init__(self) -> None:
        self.markers: dict[tuple[str, int], Marker] = {}

    def take(self, markers: list[Marker]) -> None:
        for it in markers:
            assert it.action in (Marker.ADD, Marker.DELETEALL) and it.header.frame_id == "musselbed/enu"
            if it.action == Marker.ADD:
                assert (it.ns, it.id) not in self.markers, (
                    "drawn twice in one picture, or not taken off before"
                )
                self.markers[it.ns, it.id] = it
            else:
                self.markers.clear()

    def of(self, agent_id: int) -> set[str]:
        return {group for group, number in self.markers if number == agent_id}


class APad:
    """The part of a supervisor that its markers show, and a screen that shows them."""

    def __init__(self, *own: int) -> None:
        self.beliefs = HoldLast(own)
        self.allocation = Allocation(self.beliefs, own)
        self.pose = PoseReported(0, 1.0, 2.0, 0.0)
        self.mission = SimpleNamespace(docks=(None,) * 4)
        self.screen = Screen()
        self._own = own
        self.now_ms, self.presences = 0, Presences([7, 8], 3.0)

    def hear(self, agent_id: int, north_m: float = 10.0) -> None:
        packet = StatusPacket(agent_id, 0, State.ACTIVE, 0.75, 1.0, north_m, 20.0, 3.0, 30 * self.now_ms)
        assert self.beliefs.hear(packet, self.now_ms) is None

    def tick(self, *, is_connected: bool = True) -> dict[int, set[str]]:
        """What the screen shows of each aMussel after a second, and as 0 of the aPad."""
        self.now_ms += 1000
        picture = fleet_markers(self, self._own, "musselbed/enu", 0.5, self.now_ms)  # type: ignore[arg-type]
        if is_connected:
            self.screen.take(picture)
        return {number: self.screen.of(number) for _, number in self.screen.markers}

    def move(self, agent_id: int, trigger: PresenceTrigger) -> None:
        coordinator: Any = SimpleNamespace(mute=lambda agent_id: None, unmute=lambda agent_id, at_ms: None)
        asked = PresenceRequest(agent_id, trigger, "a test")
        done = self.presences.do(asked, coordinator, self.beliefs, self.now_ms)
        assert not isinstance(done, str), done


BOTH, ALONE = {"amussels", "labels"}, {0: {"apad"}}


@pytest.fixture
def apad() -> APad:
    """It shows 7 and 8."""
    apad = APad(7, 8)
    apad.hear(7)
    apad.hear(8)
    assert apad.tick() == ALONE | {7: BOTH, 8: BOTH}
    return apad


def test_who_is_retired_or_handed_over_leaves_the_screen_and_comes_back(apad: APad) -> None:
    apad.move(7, PresenceTrigger.RETIRE)
    apad.move(8, PresenceTrigger.HAND_OVER)
    assert [apad.tick(), apad.tick()] == [ALONE, ALONE]
    apad.move(7, PresenceTrigger.SPAWN)
    apad.hear(7, north_m=15.0)
    apad.hear(8)  # the real one, by its own packet
    assert apad.tick() == ALONE | {7: BOTH, 8: BOTH}
    assert apad.screen.markers["amussels", 7].pose.position.y == 15.0


def test_a_screen_that_missed_messages_keeps_no_ghost(apad: APad) -> None:
    apad.move(7, PresenceTrigger.RETIRE)
    assert apad.tick(is_connected=False)[7] == BOTH, "it was not told"
    assert apad.tick() == ALONE | {8: BOTH}


def test_one_that_is_handed_on_is_drawn_by_who_serves_it() -> None:
    """Its own fleet's supervisor goes on receiving its packets, for its records."""
    giver, taker = APad(7), APad(8)
    giver.hear(7)
    taker.hear(8)
    taker.beliefs.admit(7, giver.beliefs.get(7))
    not_served_there_yet = [giver.tick(), taker.tick()]
    assert not_served_there_yet == [ALONE | {7: BOTH}, ALONE | {8: BOTH}]
    giver.allocation.give(7)
    taker.allocation.take(7)
    giver.hear(7)
    taker.hear(7)
    assert [giver.tick(), taker.tick()] == [ALONE, ALONE | {7: BOTH, 8: BOTH}]
    taker.allocation.give(7)
    taker.beliefs.dismiss(7)
    giver.allocation.take(7)
    assert [giver.tick(), taker.tick()] == not_served_there_yet


def test_an_ellipse_leaves_with_its_ball_and_without_it() -> None:
    modes = tuple(float(mode is Mode.ASLEEP) for mode in Mode)
    sure = Belief(
        7,
        1000,
        State.ACTIVE,
        0.6,
        1.0,
        10.0,
        20.0,
        place_cov=(4.0, 0.5, 9.0),
        mode_probabilities=modes,
    )
    known: list[Belief] = []
    apad = APad(7)
    apad.allocation = Allocation(SimpleNamespace(all=lambda: list(known), get=lambda agent_id: None), [7])
    unsure = replace(sure, mode_probabilities=())
    for known[:], shown in (
        ([sure], BOTH | {"place_95"}),
        ([unsure], BOTH),
        ([sure], BOTH | {"place_95"}),
        ([], set()),
    ):
        assert apad.tick().get(7, set()) == shown
