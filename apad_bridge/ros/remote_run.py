"""Reads the run of a supervisor on another machine, and gives it orders, by the services of `gateway/run_services.py`."""

from __future__ import annotations

import rospy

from apad_bridge.doctor.network import Unreachable, call
from apad_bridge.ros.gateway.run_services import MOST_BYTES
from apad_bridge.ros.system.lost_links import bound_calls
from apad_bridge.ros.system.route import somebodys_master
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import ours_of_apad, plain
from apad_bridge.vehicle.link_errors import PeerFailed

use_generated_messages()

from musselbed_msgs.srv import GiveOrder, ReadRun  # noqa: E402

_FAILURES = (rospy.ServiceException, rospy.ROSException, OSError)


class Unheard(Exception):
    """The supervisor's machine did not answer; the text is one line. An order may have been carried out all the same."""


class RemoteRun:
    """A client of the two services. It is no node: nobody has to reach this machine by name."""

    def __init__(self, apad: str) -> None:
        self._read = rospy.ServiceProxy(ours_of_apad(apad, "read_run"), ReadRun)
        self._order = rospy.ServiceProxy(ours_of_apad(apad, "give_order"), GiveOrder)

    def read(self, file: str, offset: int) -> bytes | None:
        """All of the file's bytes from `offset` on; None for no such file. Unheard without an answer."""
        whole = b""
        while True:
            try:
                answer = self._read(file, offset + len(whole))
            except _FAILURES as error:
                raise Unheard(f"the supervisor's machine does not answer: {error}") from error
            if not answer.exists:
                return None
            whole += bytes(answer.data)
            if len(answer.data) < MOST_BYTES:
                return whole

    def order(self, request: bytes) -> bytes:
        """The supervisor's answer to a request's line. Unheard without one."""
        try:
            return str(self._order(request.decode()).answer).encode()
        except _FAILURES as error:
            raise Unheard(
                f"no answer came, and the order may have been carried out all the same: {error}"
            ) from error


def find_run(apad: str | None) -> RemoteRun:
    """The run on the master at ROS_MASTER_URI, of this aPad or of the only one. PeerFailed with the mend."""
    uri = somebodys_master()
    try:
        _, _, services = call(uri, "getSystemState")
    except Unreachable as error:
        raise PeerFailed(str(error)) from error
    ending = "/read_run"
    full = {name.removesuffix(ending) for name, _ in services if name.endswith(ending)}
    offered = {
        it.rpartition("/")[2]: it
        for it in full
        if it == rospy.resolve_name(ours_of_apad(it.rpartition("/")[2], "read_run")).removesuffix(ending)
    }
    if not offered:
        raise PeerFailed(
            f"no run is on the master at {uri}: start `musselbed mission` or `musselbed run`, or name the directory RUN"
        )
    name = plain(apad) if apad is not None else next(iter(offered))
    if name not in offered or (apad is None and len(offered) > 1):
        raise PeerFailed(
            f"the master at {uri} has the runs of {', '.join(sorted(offered))}: choose by --apad"
        )
    bound_calls()
    return RemoteRun(name)
