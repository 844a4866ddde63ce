"""The stack of generation A: one action server for go-to, perch and release."""

from __future__ import annotations

from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.capabilities import Capabilities, published_docks
from apad_bridge.vehicle.stack import Stack


def capabilities(docks: int) -> Capabilities:
    """Goals name aMussels and no docks, so that any number of docks fits the messages."""
    return Capabilities(
        published_docks(docks),
        sees_amussels=False,
        can_hold=False,
        reports_contact=True,
        obeys_speed=False,
        moves_arms=False,
    )


STACK = Stack(
    Generation.A,
    "an action_server",
    capabilities,
    recognised_actions={"action_server": "apad/aPadAction"},
    topic_types={
        "action_server/result": "apad/aPadActionResult",
        "action_server/feedback": "apad/aPadActionFeedback",
        "position": "auv_msgs/NavSts",
    },
    service_types={
        "check_docking_availability": "misc_msgs/GetDockingInfo",
        "change_docking_status": "misc_msgs/ChangeDockingStatus",
        "get_battery_level": "misc_msgs/GetChargeInfo",
    },
    off_services=("VelCon_enable", "FADP_enable"),
    drifts_between_orders=False,
)
