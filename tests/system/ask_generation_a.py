"""Uses every service and topic of the simulated aPad of generation A beside its action, and prints the answers as JSON.

Use: ask_generation_a.py, on the master at ROS_MASTER_URI, where the aPad's node runs and nobody else publishes /clock.
"""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import rospy
from actionlib.action_client import ActionClient, CommState
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from apad_bridge.ros.system.ros_time import to_ros
from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from apad.msg import aPadAction, aPadGoal  # noqa: E402
from misc_msgs.srv import ChangeDockingStatus, GetChargeInfo, GetDockingInfo, SendEnergy  # noqa: E402
from navcon_msgs.srv import ConfigureVelocityController, EnableControl  # noqa: E402

PATIENCE_S = 180.0
PERCH = 1


def ask(name: str, kind: Any, **request: Any) -> Any:
    rospy.wait_for_service(f"/apad1/{name}")
    return rospy.ServiceProxy(f"/apad1/{name}", kind)(**request)


def perch(name: str) -> None:
    client = ActionClient("/apad1/action_server", aPadAction)
    assert client.wait_for_server()
    done = threading.Event()
    handle = client.send_goal(
        aPadGoal(id=PERCH, object=name),
        lambda it: done.set() if it.get_comm_state() == CommState.DONE else None,
    )
    assert done.wait(PATIENCE_S) and handle is not None


def battery_after(publisher: rospy.Publisher, percent_points: float) -> float:
    """Publishes the change and polls the charge until it shows: topics and services keep no order."""
    before = ask("get_battery_level", GetChargeInfo).battery_level
    publisher.publish(Float64(percent_points))
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        now: float = ask("get_battery_level", GetChargeInfo).battery_level
        if now != before:
            return now
    raise AssertionError(f"{publisher.resolved_name} changed nothing")


def connected_publisher(topic: str) -> rospy.Publisher:
    connected = threading.Event()

    class Listener(rospy.SubscribeListener):  # type: ignore[misc]
        def peer_subscribe(self, *_: Any) -> None:
            connected.set()

    publisher = rospy.Publisher(topic, Float64, Listener(), queue_size=1)
    assert connected.wait(PATIENCE_S)
    return publisher


def start_clock() -> None:
    """Publishes one time until the node confirms it: its first answer may leave before we are connected."""
    state = threading.Event()
    rospy.Subscriber("/apad1/stateRef", rospy.AnyMsg, lambda _: state.set())
    clock = rospy.Publisher("/clock", Clock, queue_size=1, latch=True)
    until_s = time.monotonic() + PATIENCE_S
    while not state.is_set():
        assert time.monotonic() < until_s, "the aPad's node does not follow /clock"
        clock.publish(Clock(to_ros(1_000)))
        state.wait(0.1)


def main() -> None:
    rospy.init_node("asker", disable_signals=True)
    start_clock()
    answers: dict[str, Any] = {}
    enabled = [ask(it, EnableControl, enable=True) for it in ("FADP_enable", "VelCon_enable", "DEPTH_enable")]
    answers["enabled"] = len(enabled)
    ask(
        "ConfigureVelocityController",
        ConfigureVelocityController,
        ControllerName="FADP",
        desired_mode=[2] * 6,
    )
    answers["anchored"] = ask("anchor", Trigger).success
    answers["coils_free"] = [ask("send_energy", SendEnergy, coil=it).done for it in range(5)]
    perch("amussel7")
    answers["coils_held"] = [ask("send_energy", SendEnergy, coil=it).done for it in range(5)]
    docks = ask("check_docking_availability", GetDockingInfo)
    answers["docks"] = [list(docks.available_slots), list(docks.slots)]
    answers["charge_info"] = [
        ask("charge_info", GetChargeInfo).type,
        *ask("charge_info", GetChargeInfo).consumers,
    ]
    answers["result_of_change"] = ask(
        "change_docking_status", ChangeDockingStatus, slot=0, status=False
    ).result
    try:
        ask("change_docking_status", ChangeDockingStatus, slot=0, status=False)
    except rospy.ServiceException as refused:
        answers["refused"] = str(refused)
    charging, draining = connected_publisher("/apad1/charging"), connected_publisher("/apad1/draining")
    answers["battery"] = [
        ask("get_battery_level", GetChargeInfo).battery_level,
        battery_after(draining, 30.0),
        battery_after(charging, 10.0),
    ]
    print(json.dumps(answers))


if __name__ == "__main__":
    main()
