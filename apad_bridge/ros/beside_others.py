"""Names of a supervisor that is one of several on a master: what is of its own stands below /musselbed/NAME, its aPad.

Alone, a supervisor has it below /musselbed. Claims stay common to all, for they are how supervisors know of each other; so
do the packets of real aMussels, which carry their id.
"""

from __future__ import annotations

_OF_ONE = (
    *("apad", "apad/battery_state", "apad/fix", "apad/path", "plan", "markers"),
    *("beliefs", "mission", "sound"),
    *("spawn", "retire", "hand_over", "take_back", "inject_fault"),
    *("dock", "dock_by_hand", "permit_surfacing", "tell_clear"),
)


def beside_others(apad: str) -> list[str]:
    """ROS's remappings, FROM:=TO, for the supervisor of the aPad of this name."""
    return [f"/musselbed/{name}:=/musselbed/{apad}/{name}" for name in _OF_ONE]
