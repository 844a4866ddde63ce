"""Names of a supervisor that is one of several on a master: what is of its own stands below musselbed/NAME, its aPad.

Alone, a supervisor has it below musselbed. Claims stay common to all, for they are how supervisors know of each other; so
do the packets of real aMussels, which carry their id.
"""

from __future__ import annotations

from apad_bridge.ros_names.table import OURS
from apad_bridge.scenario.schema import Scenario


def beside_others(apad: str) -> list[str]:
    """ROS's remappings, FROM:=TO, for the supervisor of the aPad of this name."""
    return [f"{row.name}:={below_apad(row.name, apad)}" for row in OURS.rows if not row.is_common]


def is_one_of_several(scenario: Scenario) -> bool:
    """Whether the scenario's aPad, or the one that a share is for, is beside others on its master."""
    return bool(scenario.apads or scenario.fleet.share)


def below_apad(name: str, apad: str) -> str:
    """What a name of the bench becomes for the supervisor of this aPad."""
    return f"musselbed/{apad}/{name.removeprefix('musselbed/')}"
