"""Uses every service and topic of the simulated aPad of generation A beside its action, and prints the answers as JSON.

Use: ask_generation_a.py, on the master at ROS_MASTER_URI, where the aPad's node and a /clock run.
"""

from __future__ import annotations

import json
from typing import Any

import rospy
from actionlib import SimpleActionClient
from programs import wait_until
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from apad.msg import aPadAction, aPadGoal  # noqa: E402
from misc_msgs.srv import ChangeDockingStatus, GetChargeInfo, GetDockingInfo, SendEnergy  # noqa: E402
from navcon_msgs.srv import ConfigureVelocityController, EnableControl  # noqa: E402

PERCH = 1


def ask(name: str, kind: Any, **request: Any) -> Any:
    rospy.wait_for_service(f"/apad1/{name}")
    return rospy.ServiceProxy(f"/apad1/{name}", kind)(**request)


def battery() -> float:
    return float(ask("get_battery_level", GetChargeInfo).battery_level)


def battery_after(topic: str, percent_points: float) -> float:
    """Publishes the change and polls the charge until it shows: topics and services keep no order."""
    publisher, before = rospy.Publisher(topic, Float64, queue_size=1), battery()
    wait_until(publisher.get_num_connections)
    publisher.publish(Float64(percent_points))
    wait_until(lambda: abs(battery() - before) > 5, why=f"{topic} changed nothing")
    return battery() - before


def coils() -> list[bool]:
    return [ask("send_energy", SendEnergy, coil=it).done for it in range(5)]


def main() -> None:
    rospy.init_node("asker", disable_signals=True)
    for name in ("FADP_enable", "VelCon_enable", "DEPTH_enable"):
        ask(name, EnableControl, enable=True)
    velocity = {"ControllerName": "FADP", "desired_mode": [2] * 6}
    ask("ConfigureVelocityController", ConfigureVelocityController, **velocity)
    answers: dict[str, Any] = {"anchored": ask("anchor", Trigger).success, "coils_free": coils()}
    client = SimpleActionClient("/apad1/action_server", aPadAction)
    assert client.wait_for_server()
    client.send_goal(aPadGoal(id=PERCH, object="amussel7"))
    assert client.wait_for_result()
    docks, charge = ask("check_docking_availability", GetDockingInfo), ask("charge_info", GetChargeInfo)
    answers |= {"coils_held": coils(), "docks": [list(docks.available_slots), list(docks.slots)]}
    answers["charge_info"] = [charge.type, *charge.consumers]
    release = {"slot": 0, "status": False}
    answers["result_of_change"] = ask("change_docking_status", ChangeDockingStatus, **release).result
    try:
        ask("change_docking_status", ChangeDockingStatus, **release)
    except rospy.ServiceException as refused:
        answers["refused"] = str(refused)
    answers["battery"] = [battery_after("/apad1/draining", 30.0), battery_after("/apad1/charging", 10.0)]
    print(json.dumps(answers))


if __name__ == "__main__":
    main()
