"""Names of a supervisor that is one of several on a master: its own names lie below musselbed/NAME, after its aPad.

A single supervisor has them below musselbed. Claims stay common to all, because supervisors know of each other by them. The
packets of real aMussels stay common too, because they carry their id.
"""

from __future__ import annotations

from apad_bridge.ros_names.table import OURS
from apad_bridge.scenario.schema import Scenario


def beside_others(apad: str) -> list[str]:
    """Returns the ROS remappings, FROM:=TO, for the supervisor of the aPad with this name."""
    return [f"{row.name}:={below_apad(row.name, apad)}" for row in OURS.rows if not row.is_common]


def is_one_of_several(scenario: Scenario) -> bool:
    """True if the scenario's aPad, or the aPad that a share is for, is beside others on its master."""
    return bool(scenario.apads or scenario.fleet.share)


def below_apad(name: str, apad: str) -> str:
    """Returns a name of the bench as the supervisor of this aPad has it."""
    return f"musselbed/{apad}/{name.removeprefix('musselbed/')}"
