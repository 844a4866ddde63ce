"""Opens and closes each dock of a real aPad once.

    python -m apad_bridge.ros.prove_docks /apad1 4

By perches and releases of generation A, or by the arms that `dock_out` moves for generation B. It prints one
line; without docks to move it prints the reason to stderr and ends with exit code 3.
"""

from __future__ import annotations

import sys
import threading
from typing import Any

import rospy
from actionlib import SimpleActionClient
from std_msgs.msg import Float32MultiArray

from apad_bridge.ros.system.node import start_node
from apad_bridge.ros.types.messages import use_generated_messages
from apad_bridge.ros_names.names import of_apad
from apad_bridge.vehicle.generation_a.messages import ENDS, PERCH, RELEASE
from apad_bridge.vehicle.generation_b.messages import arms

use_generated_messages()

from apad.msg import aPadAction, aPadGoal  # noqa: E402
from misc_msgs.srv import GetDockingInfo  # noqa: E402

STANDS_OPEN_S = 1.0
_WAIT_S, _GOAL_S = 5.0, 30.0


class CannotMove(Exception):
    """The text is the reason."""


def by_perches(apad: str, docks: int) -> str:
    """Generation A: a perch closes the first free dock, so all are closed one after another, and then opened by name."""
    ask = rospy.ServiceProxy(of_apad(apad, "check_docking_availability"), GetDockingInfo)

    def held() -> list[str]:
        return [it for it in ask().slots if it.strip("/")]

    if names := held():
        raise CannotMove(f"its docks hold {', '.join(names)}: release them first")
    server = SimpleActionClient(of_apad(apad, "action_server"), aPadAction)
    if not server.wait_for_server(rospy.Duration(_WAIT_S)):
        raise CannotMove("no action server takes goals")
    # Letters, because a number in a name is an aMussel's
    names = [f"musselbed_proof_{chr(ord('a') + n)}" for n in range(docks)]
    for number, name in enumerate(names, 1):
        _order(server, PERCH, name)
        if len(held()) < number:
            raise CannotMove(f"{number - 1} docks close, and the scenario has {docks} (apad.docks)")
    for number, name in enumerate(names, 1):
        _order(server, RELEASE, name)
        if len(held()) > docks - number:
            raise CannotMove(f"{number - 1} of {docks} docks open again: see the vehicle's docks")
    return f"{docks} docks closed and opened"


def _order(server: Any, kind: int, name: str) -> None:
    server.send_goal(aPadGoal(id=kind, object=name))
    # It is asked again and again: actionlib loses the end of a goal that comes before `send_goal` has returned.
    pause = threading.Event()
    for _ in range(int(_GOAL_S / 0.1)):
        if server.get_state() in ENDS:
            break
        pause.wait(0.1)
    else:
        what = "perch" if kind == PERCH else "release (the published server dies of it: start it again)"
        raise CannotMove(f"no end of a {what} within {_GOAL_S:g} s")
    threading.Event().wait(STANDS_OPEN_S)


def by_arms(apad: str, docks: int) -> str:
    """Generation B: an arm stands open for a while, one after another."""
    topic = rospy.Publisher(of_apad(apad, "dock_out"), Float32MultiArray, queue_size=4)
    pause = threading.Event()
    for _ in range(int(_WAIT_S / 0.1)):
        if topic.get_num_connections():
            break
        pause.wait(0.1)
    else:
        raise CannotMove(f"nobody listens to {topic.resolved_name}: no arm can be moved")
    for dock_index in range(docks):
        topic.publish(Float32MultiArray(data=[float(it) for it in arms(dock_index).is_open]))
        pause.wait(STANDS_OPEN_S)
        topic.publish(Float32MultiArray(data=[float(it) for it in arms(None).is_open]))
        pause.wait(STANDS_OPEN_S)
    return f"{docks} arms opened and closed"


def main() -> int:
    apad, docks = sys.argv[1], int(sys.argv[2])
    start_node("musselbed_prove_docks", is_anonymous=True)
    try:
        try:
            rospy.wait_for_service(of_apad(apad, "check_docking_availability"), 1.0)
        except rospy.ROSException:
            print(by_arms(apad, docks))
        else:
            print(by_perches(apad, docks))
    except (CannotMove, rospy.ServiceException, rospy.ROSException) as error:
        print(error, file=sys.stderr)
        return 3
    finally:
        rospy.signal_shutdown("done")
    return 0


if __name__ == "__main__":
    sys.exit(main())
