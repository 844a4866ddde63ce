"""The link to an aPad that freezes, lies or whose docks jam."""

from __future__ import annotations

import pytest
from stack_benches import cleared

from apad_bridge.vehicle.commands import (
    CloseDock,
    CommandFailed,
    GoTo,
    OpenDock,
    PoseReported,
    VehicleCommand,
)
from apad_bridge.vehicle.vehicle_link import Carried, Cleared, LinkFact
from apad_bridge.world.faulty_link import FaultyLink


class Vehicle:
    """Reports its place and a contact each time it is asked, and keeps the commands that reach it."""

    def __init__(self) -> None:
        self.commands: list[VehicleCommand] = []
        self.link = FaultyLink(self)

    def advance(self, now_ms: int) -> list[LinkFact]:
        return [PoseReported(now_ms, 1.0, 2.0, 0.0), Carried(now_ms, 3, 1.0, 2.0)]

    def command(self, cleared: Cleared[VehicleCommand], now_ms: int) -> None:
        self.commands.append(cleared.order)

    def close(self) -> None:
        pass


GO = GoTo(1, 5.0, 5.0, 0.5, 1.0)


@pytest.fixture
def vehicle() -> Vehicle:
    return Vehicle()


def test_a_frozen_vehicle_says_and_does_nothing_until_it_heals_and_loses_nothing(vehicle: Vehicle) -> None:
    link = vehicle.link
    link.is_frozen = True
    link.command(cleared(GO), 1000)
    assert [type(it) for it in link.advance(1000)] == [Carried]  # the docks hold all the same
    assert vehicle.commands == []
    link.is_frozen = False
    facts = link.advance(2000)
    assert vehicle.commands == [GO]
    assert [it.at_ms for it in facts if isinstance(it, PoseReported)] == [1000, 2000]
    assert len(link.advance(3000)) == 2


@pytest.mark.parametrize("error_m", [0.0, 5.0])
def test_a_vehicle_lies_about_its_place_and_about_nothing_else(vehicle: Vehicle, error_m: float) -> None:
    vehicle.link.north_error_m = error_m
    vehicle.link.command(cleared(GO), 0)
    assert vehicle.link.advance(0) == [PoseReported(0, 1.0 + error_m, 2.0, 0.0), Carried(0, 3, 1.0, 2.0)]
    assert vehicle.commands == [GO]


def test_a_jammed_dock_fails_its_orders_and_the_others_move(vehicle: Vehicle) -> None:
    vehicle.link.jammed_docks = frozenset([2])
    for order in (CloseDock(7, 2, 3), OpenDock(8, 1, 4)):
        vehicle.link.command(cleared(order), 0)
    assert CommandFailed(0, 7, "dock 3 is jammed") in vehicle.link.advance(0)
    assert vehicle.commands == [OpenDock(8, 1, 4)]
