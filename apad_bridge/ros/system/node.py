"""Makes a process a ROS node, by the rules that all nodes of ours share."""

from __future__ import annotations

from collections.abc import Sequence

import rospy
from rospy.impl.paramserver import get_param_server_cache

from apad_bridge.ros.system.handshakes import bound_handshakes

_LOGS_WITHOUT_TOPICS = "/rosout_disable_topics_generation"


def start_node(
    name: str,
    remappings: Sequence[str] = (),
    *,
    xmlrpc_port: int = 0,
    log_level: int = rospy.INFO,
    is_anonymous: bool = False,
    logs_on_graph: bool = True,
) -> None:
    """Joins the graph of the master at ROS_MASTER_URI. rospy waits for ever for one, so a caller asks for it first.

    Handshakes are bounded (`handshakes.py`), signals stay the caller's, and a line of the node's log does not wait for the
    master. `is_anonymous` makes the name unique. Raises what `rospy.init_node` raises, and OSError if the master goes
    away meanwhile.
    """
    bound_handshakes()
    rospy.init_node(
        name,
        argv=list(remappings),
        anonymous=is_anonymous,
        log_level=log_level,
        disable_rosout=not logs_on_graph,
        disable_signals=True,
        xmlrpc_port=xmlrpc_port,
    )
    if logs_on_graph:
        # While it is not set, rospy asks the master for it at each line of a node's log, and waits where that stands still.
        get_param_server_cache().set(_LOGS_WITHOUT_TOPICS, rospy.get_param(_LOGS_WITHOUT_TOPICS, False))
