"""Refuses to start a fleet whose aMussels are published on this master already."""

from __future__ import annotations

import xmlrpc.client
from collections.abc import Iterable
from http.client import HTTPException

import rospy

from apad_bridge.doctor.graph_checks import Graph
from apad_bridge.doctor.network import Timed, call_for_reply
from apad_bridge.ros_names.names import of_amussel

_CALLER = "/musselbed"
_NAMES = ("position", "battery_level", "get_battery_level", "charge_info")
_ALIVE_S = 2.0
"""A node that does not answer in this time is taken for dead, and its registrations for the remains of a kill -9."""


class SecondFleet(Exception):
    """One line: the node that has one of our names, and the mend."""


def refuse_second_fleet(node_name: str, agent_ids: Iterable[int], master_uri: str) -> None:
    """Raises SecondFleet when a living node has the name, in full, or topics or services of one of the aMussels.

    Unreachable when no master answers at `master_uri`. Names left behind by a dead node are no hindrance.
    """
    graph = Graph.read(master_uri)
    taken: dict[str, str] = {}
    ours = {rospy.resolve_name(of_amussel(it, leaf)) for it in agent_ids for leaf in _NAMES}
    for name, nodes in [*graph.publishers.items(), *graph.services.items()]:
        if name in ours:
            for node in nodes:
                taken.setdefault(node, name)
    for node, name in sorted(taken.items()):
        if node != node_name and _is_alive(master_uri, node):
            raise SecondFleet(
                f"node {node} already has {name}: two fleets on one master need disjoint ids (fleet.first_id, fleet.count) "
                "or a namespace each (ROS_NAMESPACE)"
            )
    if _is_alive(master_uri, node_name):
        raise SecondFleet(
            f"a node named {node_name} runs on this master already: another musselbed run? "
            f"End it, or give this fleet other ids (fleet.first_id)"
        )


def _is_alive(master_uri: str, node: str) -> bool:
    code, _, uri = call_for_reply(master_uri, "lookupNode", node)
    if code != 1:
        return False
    try:
        with xmlrpc.client.ServerProxy(str(uri), transport=Timed(_ALIVE_S)) as proxy:
            answer = proxy.getPid(_CALLER)
    except (OSError, HTTPException, xmlrpc.client.Error, ValueError):
        return False
    return isinstance(answer, list) and answer[:1] == [1]
