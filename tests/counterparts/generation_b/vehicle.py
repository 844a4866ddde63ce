#!/usr/bin/python3
"""An aPad of generation B as a small ROS 1 vehicle: surface boat, mission primitives, four docks, battery.

It never moves unless ordered. README.md lists its names on the graph, OPEN.md its author's choices.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import signal
import sys
import threading
import time


def arguments(argv: list[str]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    add = parser.add_argument
    add("--namespace", default="/apad1", help="namespace of all its names")
    add("--start", nargs=2, type=float, default=(0.0, 0.0), metavar=("NORTH", "EAST"), help="first place, m")
    add("--yaw", type=float, default=0.0, help="first heading, rad clockwise from north")
    add(
        "--origin",
        nargs=2,
        type=float,
        default=(43.9330937, 15.4443468),
        metavar=("LAT", "LON"),
        help="origin of the local frame, degrees, unless LocalOriginLat and LocalOriginLon are set already",
    )
    add(
        "--current",
        nargs=2,
        type=float,
        default=(0.0, 0.0),
        metavar=("NORTH", "EAST"),
        help="water current, m/s",
    )
    add("--gust", type=float, default=1.0, help="standard deviation of wind and wave forces, N")
    add("--noise", type=float, default=0.15, help="standard deviation of the position error, m")
    add("--battery", type=float, default=95.0, help="battery at start, percent")
    add("--idle-hours", type=float, default=8.0, help="hours in which idling empties a full battery")
    add(
        "--dock-failures",
        type=float,
        default=0.0,
        help="probability that closing an empty dock fails, 0 to 1",
    )
    add(
        "--dock-failure-kind",
        choices=("jam", "miss"),
        default="jam",
        help="jam: the arm stalls and the docking does not succeed; miss: it succeeds by camera and holds nothing",
    )
    add("--servo-block", type=float, default=27.0, help="seconds the camera servo blocks before (un)docking")
    add(
        "--search-wait-after",
        action="store_true",
        help="wait 15.5-23.6 s by slot after the servo block and not within it",
    )
    add("--service-time", type=float, default=0.05, help="seconds each callback takes at least")
    add("--clock-offset", type=float, default=0.0, help="seconds by which the vehicle's clock is wrong")
    add("--speed", type=float, default=1.0, help="vehicle seconds for each second of the wall clock")
    add("--truth", metavar="TOPIC", help="for a judge alone: the true position on this topic, without noise")
    add("--seed", type=int, default=None, help="seed of all its randomness")
    options = parser.parse_args([word for word in argv if ":=" not in word])  # FROM:=TO is for rospy
    if not (options.speed > 0 and options.idle_hours > 0 and 0 <= options.dock_failures <= 1):
        parser.error("--speed and --idle-hours must be positive, --dock-failures within 0 and 1")
    return options


OPTIONS = arguments(sys.argv[1:]) if __name__ == "__main__" else arguments([])
os.environ["ROS_NAMESPACE"] = OPTIONS.namespace  # before rospy is imported: rospy reads it then

import graph_types  # noqa: E402,F401  makes the three message packages
import rospy  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402
from commander import Commander  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue  # noqa: E402
from equipment import Battery, Camera, Docks  # noqa: E402
from motion import Boat, Nav  # noqa: E402
from primitives import Ports  # noqa: E402
from std_msgs.msg import Bool, Float32, Float32MultiArray, Float64, Int32MultiArray  # noqa: E402
from worker import Clock, Stopped, Worker  # noqa: E402

MOTION_STEP = 0.05  # vehicle seconds
CONTROL_PERIOD = 0.1  # vehicle seconds
EARTH = 6378137.0  # m
NAV_HZ, SWITCH_HZ, SLOW_HZ = 10, 2, 1  # facts: position 10 Hz, battery_level 1 Hz


class Vehicle:
    """Wires boat, equipment, worker and commander to the graph."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options, rng = options, random.Random(options.seed)
        self.clock = Clock(options.speed)
        self.origin = self._origin()
        self.boat = Boat(options.start, options.yaw, options.current, options.noise, options.gust, rng)
        self.camera = Camera()
        self.battery = Battery(options.battery, options.idle_hours)
        self.docks = Docks(self.camera, options.dock_failures, options.dock_failure_kind, rng, self.clock.now)
        self.dock_pub = rospy.Publisher("dock_out", Float32MultiArray, queue_size=10)
        self.kinect_pub = rospy.Publisher("kinect_out", Float32, queue_size=10)
        self.nav_pub = rospy.Publisher("position", NavSts, queue_size=10)
        self.battery_pub = rospy.Publisher("battery_level", Float64, queue_size=10)
        self.switch_pub = rospy.Publisher("dock_switch", Int32MultiArray, queue_size=10)
        self.diagnostic_pub = rospy.Publisher("diagnostics", DiagnosticArray, queue_size=10)
        self.truth_pub = rospy.Publisher(options.truth, NavSts, queue_size=10) if options.truth else None
        ports = Ports(
            self.boat,
            self.camera,
            self.docks,
            lambda values: self.dock_pub.publish(Float32MultiArray(data=values)),
            self.kinect_pub.publish,
        )
        self.worker = Worker(self.clock, lambda: self.commander.tick(), CONTROL_PERIOD, options.service_time)
        self.commander = Commander(
            self.worker,
            ports,
            lambda: self.battery.percent > 0,
            options.servo_block,
            options.search_wait_after,
        )

    def _origin(self) -> tuple[float, float]:
        """LocalOriginLat and LocalOriginLon (facts, conventions): read where set, else set in the namespace."""
        names, values = ("LocalOriginLat", "LocalOriginLon"), []
        for name, mine in zip(names, self.options.origin, strict=True):
            found = rospy.search_param(name)
            if found is None:
                rospy.set_param(name, mine)
            values.append(float(rospy.get_param(found)) if found else mine)
        return values[0], values[1]

    def _listen(self) -> None:
        """Facts B: what the docking primitive hears; and the arm driver's own ear on dock_out."""
        for topic, kind in (
            ("docking_vertical", Float32),
            ("docking_horizontal", Float32),
            ("size", Float32),
            ("manual", Bool),
        ):
            rospy.Subscriber(
                topic, kind, lambda m, t=topic: self.camera.receive(t, float(m.data)), queue_size=1
            )
        rospy.Subscriber(
            "dock_out", Float32MultiArray, lambda m: self.docks.command(list(m.data)), queue_size=10
        )

    def run(self) -> None:
        """Come up, live until told to stop, and go."""
        self._listen()
        threads = [
            threading.Thread(target=self._move, name="motion", daemon=True),
            self.worker,
            threading.Thread(target=self._report, name="telemetry", daemon=True),
        ]
        for thread in threads:
            thread.start()
        self.commander.open()
        print("ready", flush=True)
        while not self.clock.stopping.wait(0.2):
            if rospy.is_shutdown():
                self.clock.stopping.set()
        for thread in threads:
            thread.join(1.0)
        rospy.signal_shutdown("switched off")

    def _move(self) -> None:
        """The physics: catches up with vehicle time in equal steps."""
        done = 0.0
        try:
            while True:
                while done < self.clock.now():
                    self.boat.powered = self.battery.percent > 0
                    self.boat.step(MOTION_STEP)
                    self.docks.step(MOTION_STEP)
                    self.battery.step(MOTION_STEP, self.boat.load, self.docks.coils())
                    done += MOTION_STEP
                self.clock.sleep(MOTION_STEP)
        except Stopped:
            return

    def _report(self) -> None:
        """Publish at wall-clock rates whatever the worker is doing: navigation and telemetry are nodes of their own."""
        beat, start = 0, time.monotonic()
        while not self.clock.stopping.wait(max(0.0, start + beat / NAV_HZ - time.monotonic())):
            try:
                self.nav_pub.publish(self._nav_message(self.boat.nav()))
                if self.truth_pub is not None:
                    self.truth_pub.publish(self._nav_message(self.boat.truth()))
                if beat % (NAV_HZ // SWITCH_HZ) == 0:
                    self.switch_pub.publish(
                        Int32MultiArray(data=[int(arm.switch) for arm in self.docks.arms])
                    )
                if beat % (NAV_HZ // SLOW_HZ) == 0:
                    self.battery_pub.publish(self.battery.percent)
                    self.commander.repeat_statuses()
                    self.diagnostic_pub.publish(self._diagnostics())
            except rospy.ROSException:  # the node is going down
                return
            beat += 1

    def _stamp(self) -> rospy.Time:
        """The vehicle's own clock (facts: "the vehicle's clock may be seconds off")."""
        return rospy.Time.from_sec(time.time() + self.options.clock_offset)

    def _nav_message(self, nav: Nav) -> NavSts:
        """NavSts: local NED, m and rad; body_velocity through water, gbody_velocity over ground, body axes, m/s."""
        message = NavSts()
        message.header.stamp, message.header.frame_id = self._stamp(), "local"
        message.origin.latitude, message.origin.longitude = self.origin
        message.global_position.latitude = self.origin[0] + math.degrees(nav.north / EARTH)
        around = EARTH * math.cos(math.radians(self.origin[0]))
        message.global_position.longitude = self.origin[1] + math.degrees(nav.east / around)
        message.position.north, message.position.east = nav.north, nav.east
        message.body_velocity.x, message.body_velocity.y = nav.water
        message.gbody_velocity.x, message.gbody_velocity.y = nav.ground
        message.orientation.yaw, message.orientation_rate.yaw = nav.yaw, nav.yaw_rate
        variance = self.options.noise**2
        message.position_variance.north = message.position_variance.east = variance
        message.orientation_variance.yaw = 1e-4
        message.status = NavSts.STATUS_ALL_OK
        return message

    def _diagnostics(self) -> DiagnosticArray:
        """Battery in V, and each dock's arm, switch and coil."""
        array = DiagnosticArray()
        array.header.stamp = self._stamp()
        percent = self.battery.percent
        level = DiagnosticStatus.OK if percent > 20 else DiagnosticStatus.WARN
        volt = KeyValue("voltage", f"{self.battery.volt():.2f}")
        array.status.append(DiagnosticStatus(level, "battery", f"{percent:.1f} %", "battery", [volt]))
        for slot, arm in enumerate(self.docks.arms):
            place = "closed" if arm.opening == 0 else "open" if arm.opening == 1 else "between"
            coil = arm.switch and arm.opening == 0
            values = [
                KeyValue("arm", place),
                KeyValue("switch", str(int(arm.switch))),
                KeyValue("coil", str(int(coil))),
            ]
            level = DiagnosticStatus.ERROR if arm.jammed else DiagnosticStatus.OK
            array.status.append(
                DiagnosticStatus(level, f"dock {slot}", "jammed" if arm.jammed else place, "dock", values)
            )
        return array


def main() -> int:
    """Start the node and end it cleanly on SIGTERM or SIGINT."""
    rospy.init_node("vehicle", argv=sys.argv, disable_signals=True)
    vehicle = Vehicle(OPTIONS)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: vehicle.clock.stopping.set())
    vehicle.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
