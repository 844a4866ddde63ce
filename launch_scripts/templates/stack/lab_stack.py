"""A boat that takes goals as geometry_msgs/PoseStamped, and an end of its thrust as std_srvs/Trigger.

All names are below its own. The first three are fixed: the guards, the preflight and the doctor know them by these names.

    position        auv_msgs/NavSts, from the boat: its place, with the variance and the origin that preflight compares
    battery_level   std_msgs/Float64, from the boat: percent
    manual          std_msgs/Bool, from the boat: a pilot steers
    helm/goal       geometry_msgs/PoseStamped, to the boat: x north, y east, in metres; it goes there and stays
    is_under_way    std_msgs/Bool, from the boat
    helm/off        std_srvs/Trigger: no thrust, until the next goal

The doctor loads this module without ROS.
"""

from typing import Any

from apad_bridge.scenario.choices import Generation
from apad_bridge.vehicle.capabilities import Capabilities, published_docks
from apad_bridge.vehicle.stack import Stack


def capabilities(docks: int) -> Capabilities:
    return Capabilities(
        published_docks(docks),
        sees_amussels=False,
        can_hold=True,
        reports_contact=False,  # musselbed keeps account of the docks
        obeys_speed=False,
        moves_arms=False,
    )


STACK = Stack(
    Generation("lab"),
    "the service helm/off",
    capabilities,
    recognised_services=("helm/off",),
    topic_types={"position": "auv_msgs/NavSts", "is_under_way": "std_msgs/Bool"},
    service_types={"helm/off": "std_srvs/Trigger"},
    off_services=("helm/off",),
    hears_pilot=True,
    drifts_between_orders=False,
)


def open_link(*arguments: Any, **options: Any) -> Any:
    from lab_link import opened

    return opened(*arguments, **options)
