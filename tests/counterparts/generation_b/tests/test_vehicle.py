"""The vehicle against a real master. Times are vehicle seconds divided by SPEED."""

from __future__ import annotations

import threading
import time

import actionlib
import pytest
import rospy
from conftest import SPEED, until
from geometry_msgs.msg import Point
from std_msgs.msg import Float32, Float32MultiArray
from std_srvs.srv import Trigger


def go(bench, north, east, speed=0.5, radius=1.0, actuated=True):
    from misc_msgs.srv import Go2pointPrimitiveService

    return bench.call(
        "primitive/go2point",
        Go2pointPrimitiveService,
        fully_actuated_enable=actuated,
        point=Point(north, east, 0),
        speed=speed,
        victory_radius=radius,
        north_enable=True,
        east_enable=True,
    ).status


def hold(bench, north, east, heading=0.0):
    from misc_msgs.srv import DynamicPositioningPrimitiveService

    return bench.call(
        "primitive/dynamic_positioning",
        DynamicPositioningPrimitiveService,
        north=north,
        east=east,
        heading=heading,
        north_enable=True,
        east_enable=True,
        heading_enable=True,
    ).status


def dock(bench, action, slot):
    from misc_msgs.srv import DockingPrimitiveService

    return bench.call(
        "primitive/docking",
        DockingPrimitiveService,
        docking_action=action,
        docking_slot=slot,
        search_yaw_rate=0.2,
        max_yaw_rate=0.3,
        max_surge_speed=0.2,
        surge_stdev=0.2,
    ).status


def camera(bench, horizontal, vertical):
    """Publish detections at 20 Hz until the returned event is set."""
    over = threading.Event()
    pubs = [
        rospy.Publisher(f"/{bench.name}/docking_{axis}", Float32, queue_size=1)
        for axis in ("horizontal", "vertical")
    ]

    def show():
        while not over.wait(0.05):
            for pub, value in zip(pubs, (horizontal, vertical), strict=True):
                pub.publish(value)

    threading.Thread(target=show, daemon=True).start()
    return over


def test_comes_up_and_does_not_move(vehicle):
    bench = vehicle("--noise", "0", "--gust", "0", "--start", "3", "-4", "--yaw", "1")
    time.sleep(2)
    nav = bench.last("position")
    assert bench.distance(3, -4) < 0.3 and abs(nav.orientation.yaw - 1) < 0.3
    assert nav.header.frame_id == "local" and nav.status == nav.STATUS_ALL_OK
    assert bench.last("goto_status") == 0 and bench.last("docking_status") == 0
    assert rospy.get_param(f"/{bench.name}/LocalOriginLat") == pytest.approx(43.9330937)
    count = len(bench.seen["position"])
    time.sleep(2)
    assert 15 <= len(bench.seen["position"]) - count <= 23


@pytest.mark.parametrize("actuated", [True, False])
def test_goes_to_a_point_and_holds_in_a_current(vehicle, actuated):
    bench = vehicle("--current", "0.1", "-0.1")
    assert go(bench, 10, -6, actuated=actuated)
    until(lambda: bench.last("goto_status") == 1, 3)
    until(lambda: bench.last("goto_status") == 3, 90 / SPEED)
    until(lambda: bench.seen["eventString"], 2)
    assert bench.last("eventString") == "/PRIMITIVE_FINISHED" and bench.distance(10, -6) < 1.5
    assert hold(bench, 10, -6, heading=1.5)
    time.sleep(30 / SPEED)
    for _ in range(20):
        assert bench.distance(10, -6) < 0.8
        time.sleep(0.1)
    assert abs(bench.last("position").orientation.yaw - 1.5) < 0.2 and bench.last("goto_status") == 3


def test_drifts_after_a_primitive_and_after_a_stop(vehicle):
    bench = vehicle("--current", "0.2", "0", "--noise", "0")
    assert hold(bench, 0, 0)
    time.sleep(30 / SPEED)
    assert bench.distance(0, 0) < 1.0
    assert bench.call("stop_mission", Trigger).success
    time.sleep(30 / SPEED)
    assert bench.last("position").position.north > 3.0


@pytest.mark.parametrize("speed, radius", [(0.0, 1.0), (0.5, 0.0)])
def test_senseless_orders_are_accepted_and_abort(vehicle, speed, radius):
    bench = vehicle()
    assert go(bench, 10, 0, speed, radius)
    until(lambda: bench.last("goto_status") == 2, 3)


def test_docks_by_camera_and_undocks(vehicle):
    bench = vehicle("--noise", "0", "--gust", "0")
    over = camera(bench, 0.0, 0.5)
    assert dock(bench, True, 1)
    until(lambda: bench.last("docking_status") == 1, 3)
    until(lambda: bench.seen["dock_out"], 35 / SPEED)
    assert list(bench.last("dock_out")) == [0, 1, 0, 0]
    time.sleep(10 / SPEED)
    assert bench.last("position").position.east > 0.3  # slot 1 is to starboard
    over.set()
    over = camera(bench, 0.0, 0.85)
    until(lambda: bench.last("docking_status") == 3, 3)
    over.set()
    assert list(bench.last("dock_out")) == [0, 0, 0, 0]
    until(lambda: list(bench.last("dock_switch")) == [0, 1, 0, 0], 3)
    east = bench.last("position").position.east
    assert dock(bench, False, 1)
    until(lambda: bench.last("docking_status") == 1, 3)
    until(lambda: bench.last("docking_status") == 3, 45 / SPEED)
    until(lambda: list(bench.last("dock_switch")) == [0, 0, 0, 0], 3)
    assert bench.last("position").position.east < east - 1.0


def test_searches_for_ever_and_can_be_stopped(vehicle):
    bench = vehicle()
    assert dock(bench, True, 0)
    time.sleep(60 / SPEED)
    assert bench.last("docking_status") == 1 and bench.last("position").orientation_rate.yaw > 0.1
    assert bench.call("stop_mission", Trigger).success
    until(lambda: bench.last("docking_status") == 2 and list(bench.last("dock_out")) == [0, 0, 0, 0], 3)


@pytest.mark.parametrize("kind, status", [("jam", 2), ("miss", 3)])
def test_a_docking_fails(vehicle, kind, status):
    bench = vehicle("--dock-failures", "1", "--dock-failure-kind", kind, "--servo-block", "5")
    over = camera(bench, 0.0, 0.85)
    assert dock(bench, True, 2)
    until(lambda: bench.last("docking_status") == status, 4)
    over.set()
    time.sleep(1)
    assert list(bench.last("dock_switch")) == [0, 0, 0, 0]


def test_anyone_opens_and_closes_a_dock(vehicle):
    from diagnostic_msgs.msg import DiagnosticArray

    bench = vehicle()
    pub = rospy.Publisher(f"/{bench.name}/dock_out", Float32MultiArray, queue_size=1)
    until(lambda: pub.get_num_connections() >= 2, 5)
    for value, word in ((1.0, "open"), (0.0, "closed")):
        pub.publish(Float32MultiArray(data=[0, 0, 0, value]))
        time.sleep(1)
        array = rospy.wait_for_message(f"/{bench.name}/diagnostics", DiagnosticArray, 3)
        assert [s.message for s in array.status if s.name == "dock 3"] == [word]


def test_there_is_no_fifth_dock(vehicle):
    assert not dock(vehicle(), True, 4)


def test_a_slow_service_delays_the_next(vehicle):
    bench = vehicle()
    start = time.monotonic()
    assert dock(bench, True, 3)
    answered = time.monotonic() - start
    assert hold(bench, 0, 0)
    waited = time.monotonic() - start
    assert answered < 0.5 and waited > 27 / SPEED - 0.1
    until(lambda: bench.last("docking_status") == 2, 3)


def test_pause_and_continue(vehicle):
    bench = vehicle("--noise", "0")
    assert go(bench, 20, 0)
    time.sleep(10 / SPEED)
    assert bench.call("pause_mission", Trigger).success
    time.sleep(20 / SPEED)
    assert abs(bench.last("position").gbody_velocity.x) < 0.2 and bench.last("goto_status") == 2
    assert bench.call("continue_mission", Trigger).success
    until(lambda: bench.last("goto_status") == 3, 90 / SPEED)
    assert not bench.call("continue_mission", Trigger).success


def test_the_action_go2point(vehicle):
    from navcon_msgs.msg import GoToPointAction, GoToPointGoal

    bench = vehicle()
    client = actionlib.SimpleActionClient(f"/{bench.name}/go2point", GoToPointAction)
    assert client.wait_for_server(rospy.Duration(10))
    goal = GoToPointGoal(subtype=GoToPointGoal.GO2POINT_FA, speed=0.5, victory_radius=1.0)
    goal.T2.point.x = 5.0
    client.send_goal(goal)
    assert client.wait_for_result(rospy.Duration(60 / SPEED))
    assert client.get_state() == actionlib.GoalStatus.SUCCEEDED and client.get_result().distance < 1.0
    goal.T2.point.x = 50.0
    client.send_goal(goal)
    time.sleep(1)
    client.cancel_goal()
    assert client.wait_for_result(rospy.Duration(5)) and client.get_state() == actionlib.GoalStatus.PREEMPTED


def test_the_battery_falls_and_an_empty_one_ends_all(vehicle):
    bench = vehicle("--battery", "3", "--idle-hours", "0.5")
    first = bench.last("battery_level")
    assert hold(bench, 5, 0)
    until(lambda: bench.last("battery_level") < first - 1, 6)
    until(lambda: bench.last("battery_level") == 0, 10)
    assert not hold(bench, 0, 0)
