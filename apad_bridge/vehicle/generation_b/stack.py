"""The stack of generation B: services for mission primitives, which answer at once."""

from __future__ import annotations

import math

from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.capabilities import Capabilities, DockPlaces
from apad_bridge.vehicle.generation_b.messages import (
    PULL_BACK_M_S,
    PULL_BACK_MS,
    SERVO_MS,
    dock_direction_rad,
)
from apad_bridge.vehicle.stack import Stack

DOCK_M = 0.4
"""From the aPad's middle to an aMussel in a dock: assumed, a little more than half the hull."""


def dock_places(docks: int) -> DockPlaces:
    """The first `docks` of the four slots that the docking primitive can name, a quarter of a turn apart."""
    bearings_rad = map(dock_direction_rad, range(docks))
    offsets_m = tuple((DOCK_M * math.cos(it), DOCK_M * math.sin(it)) for it in bearings_rad)
    return DockPlaces(offsets_m, turn_with_hull=True)


def capabilities(docks: int) -> Capabilities:
    return Capabilities(
        dock_places(docks),
        sees_amussels=True,
        can_hold=True,
        reports_contact=False,
        obeys_speed=True,
        moves_arms=True,
    )


STACK = Stack(
    Generation.B,
    "commander/primitive services",
    capabilities,
    recognised_services=("commander/primitive/go2point",),
    topic_types={"position": "auv_msgs/NavSts"},
    service_types={
        "commander/primitive/go2point": "misc_msgs/Go2pointPrimitiveService",
        "commander/primitive/dynamic_positioning": "misc_msgs/DynamicPositioningPrimitiveService",
        "commander/primitive/docking": "misc_msgs/DockingPrimitiveService",
    },
    off_services=("commander/stop_mission",),
    unused_types={
        "commander/go2point": "misc_msgs/Go2pointService",
        "commander/docking": "misc_msgs/DockingService",
        "go2point/result": "navcon_msgs/GoToPointActionResult",
        "go2point/feedback": "navcon_msgs/GoToPointActionFeedback",
    },
    hears_pilot=True,
    adrift_in_docking_ms=SERVO_MS,
    pulls_back_m=PULL_BACK_M_S * PULL_BACK_MS / 1000,
)
