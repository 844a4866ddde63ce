"""Makes a process a ROS node, by the rules that all nodes of ours share."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

import rospy
import rospy.core
from rospy.impl.paramserver import get_param_server_cache

from apad_bridge.ros.system.handshakes import bound_handshakes
from apad_bridge.ros_names.frames import Frames
from apad_bridge.vehicle.link_errors import PeerFailed

_HOLD_S = 30.0
"""The longest time for which an end of the node waits for the end of its flight, which takes a tick and its records."""
_LEAVE_S = 5.0
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
    master. `is_anonymous` makes the name unique. Raises what `rospy.init_node` raises, OSError if the master goes away
    meanwhile, and PeerFailed where rospy cannot write its log.
    """
    bound_handshakes()
    try:
        rospy.init_node(
            name,
            argv=list(remappings),
            anonymous=is_anonymous,
            log_level=log_level,
            disable_rosout=not logs_on_graph,
            disable_signals=True,
            xmlrpc_port=xmlrpc_port,
        )
    except OSError as error:
        if error.filename is None:  # of a connection
            raise
        mend = "set ROS_LOG_DIR to a folder that you may write"
        raise PeerFailed(f"rospy cannot write its log {error.filename} ({error.strerror}): {mend}") from error
    if logs_on_graph:
        # While it is not set, rospy asks the master for it at each line of a node's log, and waits where that stands still.
        get_param_server_cache().set(_LOGS_WITHOUT_TOPICS, rospy.get_param(_LOGS_WITHOUT_TOPICS, False))


def ned_frame() -> str:
    """The frame of all our messages in north, east and depth, by its name in TF: that of this node's namespace."""
    return Frames(rospy.get_namespace().strip("/")).ned


class OrderedEnd:
    """Lets the flight end in order when another tells the node to end: `rosnode kill`, or a node that takes its name.

    rospy would close all topics at once, and the flight could neither hold its vehicle nor say why. So the topics stay
    open until `close`. An end of the node by the thread that made this object waits for nothing.
    """

    def __init__(self, hold_s: float = _HOLD_S) -> None:
        self._owner = threading.current_thread()
        self._hold_s = hold_s
        self._lock = threading.Lock()
        self._stop: Callable[[str], None] | None = None
        self._why: str | None = None
        self._is_over, self._has_left = threading.Event(), threading.Event()
        rospy.core.add_preshutdown_hook(self._hold)

    def stop_by(self, stop: Callable[[str], None]) -> None:
        """Takes the function that stops the flight, with the reason; it is called at once if the node was told before."""
        with self._lock:
            self._stop = stop
            if self._why is not None:
                stop(self._why)

    def close(self) -> None:
        """The flight is over: the node leaves the graph, if it was told to."""
        self._is_over.set()
        if self._why is not None:
            self._has_left.wait(_LEAVE_S)

    def _hold(self, why: str) -> None:
        if threading.current_thread() is self._owner:
            return
        with self._lock:
            self._why = why
            if self._stop is not None:
                self._stop(why)
        self._is_over.wait(self._hold_s)
        # Behind rospy's own, which unregister the node.
        rospy.core.add_shutdown_hook(lambda _: self._has_left.set())
