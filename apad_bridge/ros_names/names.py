"""Builds every ROS name that the bench uses, from one table. All publishers, subscribers, servers and clients use it.

    ours("beliefs")                     "musselbed/beliefs"
    ours_of_apad("apad1", "dock")       "musselbed/apad1/dock"
    of_apad("apad1", "position")        "apad1/position"
    of_amussel(7, "battery_level")      "amussel7/battery_level"

Names are relative: the node's namespace comes before them (`<group ns="...">`, ROS_NAMESPACE, `__ns:=`), and without one
they are the names of the legacy stack. Names that ROS, its tools or that stack have at one fixed place are global, and the
table gives the reason. Code that asks the graph for a name resolves it first (`rospy.resolve_name`). A name that is not in
the table is a KeyError.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from apad_bridge.ros_names.names_table import (
    BATTERY_ALERT,
    CLOCK,
    CLOCK_REACHED,
    DIAGNOSTICS,
    OURS,
    SECTIONS,
    TF,
    TF_STATIC,
    USE_SIM_TIME,
)

if TYPE_CHECKING:  # the doctor loads these names where another package shadows one of ours
    from apad_bridge.scenario.schema import Scenario


# Names of a supervisor that is one of several on a master: its own names lie below musselbed/NAME, after its aPad.
#
# A single supervisor has them below musselbed. Claims stay common to all, because supervisors know of each other by them.
# The packets of real aMussels stay common too, because they carry their id.
def beside_others(apad: str) -> list[str]:
    """Returns the ROS remappings, FROM:=TO, for the supervisor of the aPad with this name."""
    return [f"{row.name}:={below_apad(row.name, apad)}" for row in OURS.rows if not row.is_common]


def is_one_of_several(scenario: Scenario) -> bool:
    """True if the scenario's aPad, or the aPad that a share is for, is beside others on its master."""
    return bool(scenario.apads or scenario.fleet.share)


def below_apad(name: str, apad: str) -> str:
    """Returns a name of the bench as the supervisor of this aPad has it."""
    return f"musselbed/{apad}/{name.removeprefix('musselbed/')}"


__all__ = [
    "AMUSSEL",
    "BATTERY_ALERT",
    "CLOCK",
    "CLOCK_REACHED",
    "DIAGNOSTICS",
    "TF",
    "TF_STATIC",
    "USE_SIM_TIME",
    "amussel_in_full",
    "in_full",
    "of_amussel",
    "of_apad",
    "ours",
    "ours_of_apad",
    "plain",
]

AMUSSEL = "amussel"
"""The prefix of an aMussel's id in its namespace, and in its name in a goal of generation A."""
_KNOWN = frozenset(row.name for section in SECTIONS for row in section.rows)


def ours(leaf: str) -> str:
    return _known(f"musselbed/{leaf}")


def ours_of_apad(apad: str, leaf: str) -> str:
    """Returns a name of the supervisor whose aPad has this namespace."""
    return _known(f"musselbed/{{apad}}/{leaf}").format(apad=apad.strip("/"))


def of_apad(apad: str, leaf: str) -> str:
    """Returns a name below the aPad's own namespace, which has no slash at its end, and one before it if it is global."""
    return _known(f"{{apad}}/{leaf}").format(apad=apad)


def of_amussel(agent_id: int, leaf: str) -> str:
    return _known(f"{AMUSSEL}{{id}}/{leaf}").format(id=agent_id)


def plain(apad: str) -> str:
    """Returns an aPad's namespace as one word, for nodes and files."""
    return apad.strip("/").replace("/", "_")


def in_full(namespace: str, name: str) -> str:
    """Returns the name on the graph of a node in this namespace; a global name stays."""
    if name.startswith("/"):
        return name
    return f"/{namespace}/{name}" if namespace else f"/{name}"


def amussel_in_full(namespace: str, agent_id: int) -> str:
    """Returns an aMussel's own namespace on the graph, without a slash at its end."""
    return in_full(namespace, f"{AMUSSEL}{agent_id}")


def _known(template: str) -> str:
    if template not in _KNOWN:
        raise KeyError(f"{template} is not in the table of names")
    return template
