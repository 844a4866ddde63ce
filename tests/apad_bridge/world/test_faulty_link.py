"""The link to an aPad that freezes, lies or whose docks jam."""

from __future__ import annotations

from dataclasses import replace

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


NOTHING: dict[str, object] = {"is_frozen": False, "north_error_m": 0.0, "jammed_docks": frozenset()}
PLACE, HOLDS = PoseReported(0, 1.0, 2.0, 0.0), Carried(0, 3, 1.0, 2.0)
Steps = list[tuple[dict[str, object], list[VehicleCommand], list[LinkFact], list[VehicleCommand]]]
SCENES: dict[str, Steps] = {
    # The docks hold all the same.
    "a frozen vehicle says and does nothing until it heals and loses nothing": [
        ({"is_frozen": True}, [GO], [HOLDS], []),
        ({}, [], [PLACE, replace(PLACE, at_ms=1000), replace(HOLDS, at_ms=1000)], [GO]),
        ({}, [], [replace(PLACE, at_ms=2000), replace(HOLDS, at_ms=2000)], [GO]),
    ],
    **{
        f"a vehicle lies about its place by {error_m} m and about nothing else": [
            ({"north_error_m": error_m}, [GO], [PoseReported(0, 1.0 + error_m, 2.0, 0.0), HOLDS], [GO])
        ]
        for error_m in (0.0, 5.0)
    },
    "a jammed dock fails its orders and the others move": [
        (
            {"jammed_docks": frozenset([2])},
            [CloseDock(7, 2, 3), OpenDock(8, 1, 4)],
            [CommandFailed(0, 7, "dock 3 is jammed"), PLACE, HOLDS],
            [OpenDock(8, 1, 4)],
        )
    ],
}
"""What is wrong, orders, what the link says, and the commands that have reached the vehicle, each second."""


@pytest.mark.parametrize("steps", SCENES.values(), ids=SCENES)
def test_scene(steps: Steps) -> None:
    vehicle = Vehicle()
    for now_ms, (changes, orders, facts, commands) in zip((0, 1000, 2000), steps, strict=False):
        for name, value in {**NOTHING, **changes}.items():
            setattr(vehicle.link, name, value)
        for order in orders:
            vehicle.link.command(cleared(order), now_ms)
        assert (vehicle.link.advance(now_ms), vehicle.commands) == (facts, commands)
