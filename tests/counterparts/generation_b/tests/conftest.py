"""A real rosmaster on a free port, one client node, and vehicles started as processes."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).resolve().parent.parent
PYTHON = "/usr/bin/python3"
sys.path.insert(0, str(HERE))
SPEED = 10.0


def free_port() -> int:
    """A TCP port nobody listens on."""
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@pytest.fixture(scope="session", autouse=True)
def master() -> Iterator[None]:
    """A ROS master and this process' own node."""
    port = free_port()
    os.environ.update(ROS_MASTER_URI=f"http://127.0.0.1:{port}", ROS_IP="127.0.0.1")
    process = subprocess.Popen(
        ["nice", "-n", "15", PYTHON, "/usr/bin/rosmaster", "--core", "-p", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    for _ in range(100):
        with socket.socket() as s:
            if s.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.1)
    import graph_types  # noqa: F401
    import rospy

    rospy.init_node("tester", disable_signals=True)
    yield
    rospy.signal_shutdown("tests are over")
    process.send_signal(signal.SIGTERM)
    process.wait(10)


def until(condition: Callable[[], Any], seconds: float) -> Any:
    """Wait for a condition on the wall clock; its value, or an error."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.02)
    raise AssertionError(f"not within {seconds} s")


class Bench:
    """A client of one vehicle: keeps the newest message and the history of each topic."""

    def __init__(self, name: str, *options: str) -> None:
        import rospy
        from auv_msgs.msg import NavSts
        from std_msgs.msg import Float32MultiArray, Float64, Int32, Int32MultiArray, String

        self.name, self.seen, subscribers = name, {}, []
        for topic, kind in (
            ("position", NavSts),
            ("battery_level", Float64),
            ("goto_status", Int32),
            ("docking_status", Int32),
            ("eventString", String),
            ("dock_out", Float32MultiArray),
            ("dock_switch", Int32MultiArray),
        ):
            self.seen[topic] = []
            subscribers.append(rospy.Subscriber(f"/{name}/{topic}", kind, self.seen[topic].append))
        self.process = subprocess.Popen(
            [
                "nice",
                "-n",
                "15",
                PYTHON,
                str(HERE / "vehicle.py"),
                "--namespace",
                f"/{name}",
                "--seed",
                "1",
                "--speed",
                str(SPEED),
                *options,
            ]
        )
        rospy.wait_for_service(f"/{name}/commander/continue_mission", 20)
        until(lambda: all(s.get_num_connections() for s in subscribers), 15)
        until(lambda: all(self.seen[t] for t in self.seen if t not in ("eventString", "dock_out")), 15)

    def call(self, service: str, kind: Any, **fields: Any) -> Any:
        """Call one of the vehicle's services."""
        import rospy

        return rospy.ServiceProxy(f"/{self.name}/commander/{service}", kind)(**fields)

    def last(self, topic: str) -> Any:
        """The newest message's data, or the message."""
        message = self.seen[topic][-1]
        return getattr(message, "data", message)

    def distance(self, north: float, east: float) -> float:
        """Metres from the reported position."""
        p = self.last("position").position
        return float(((p.north - north) ** 2 + (p.east - east) ** 2) ** 0.5)


@pytest.fixture
def vehicle() -> Iterator[Callable[..., Bench]]:
    """Start vehicles; each is ended by SIGTERM and must end cleanly."""
    benches: list[Bench] = []

    def start(*options: str) -> Bench:
        benches.append(Bench(f"apad{int(time.time() * 1000) % 1000000}", *options))
        return benches[-1]

    yield start
    for bench in benches:
        bench.process.send_signal(signal.SIGTERM)
        assert bench.process.wait(10) == 0
