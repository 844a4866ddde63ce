"""The process that publishes, whose place the test takes at the far end of its input."""

from __future__ import annotations

import json
import os
import socket
import struct
import subprocess
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import pytest

from apad_bridge.ros2 import ros2_process
from apad_bridge.ros2.ros2_process import Ros2Gone, Ros2Process, environment
from apad_bridge.ros2.topics import TopicMessage

TEXT, CLOCK = "std_msgs/String", "rosgraph_msgs/Clock"


class Started:
    """The process, as its starter sees it: it answers with `says`, and ends at its input's end, or when killed."""

    says = b"ready\n"
    newest: Started

    def __init__(self, words: list[str], stdin: int, stdout: int, **options: Any) -> None:
        Started.newest = self
        self.words, self.options, self.calls = words, options, list[str]()
        self.input = socket.socket(fileno=os.dup(stdin))
        self.input.settimeout(60)
        out, into = os.pipe()
        os.write(into, self.says)
        os.close(into)
        self.stdout = os.fdopen(out, "rb")

    def wait(self, timeout_s: float | None = None) -> None:
        self.calls.append("wait")
        if timeout_s is not None and "kill" not in self.calls and self.input.recv(1 << 16):
            raise subprocess.TimeoutExpired("publisher", timeout_s)

    def kill(self) -> None:
        self.calls.append("kill")


@pytest.fixture(autouse=True)
def started(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Started]]:
    monkeypatch.setattr("apad_bridge.ros2.ros2_process.subprocess.Popen", Started)
    monkeypatch.setattr(Started, "says", b"ready\n")
    yield Started
    Started.newest.input.close()


def record(link: socket.socket) -> tuple[int, bytes]:
    number, length = struct.unpack("<II", link.recv(8))
    return number, link.recv(length)


def test_a_topic_is_announced_once_and_has_a_number() -> None:
    with closing(Ros2Process("musselbed_apad1")) as ros2:
        far = Started.newest.input
        ros2.publish(TopicMessage("/a", TEXT, b"first", 100))
        number, told = record(far)
        assert number == 0xFFFFFFFF
        assert json.loads(told) == {
            "number": 0,
            "topic": "/a",
            "kind": TEXT,
            "kept": 100,
            "hexadecimal": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
        }
        assert record(far) == (0, b"first")
        ros2.publish(TopicMessage("/b", CLOCK, b""))
        assert (json.loads(record(far)[1])["number"], far.recv(8)) == (1, bytes([1, 0, 0, 0, 0, 0, 0, 0]))
        ros2.publish(TopicMessage("/a", TEXT, b"second", 100))
        assert record(far) == (0, b"second")


def test_it_is_the_program_of_the_other_environment_in_a_session_of_its_own() -> None:
    with closing(Ros2Process("musselbed_apad1")):
        python, isolated, program, node = Started.newest.words
        assert python == str(ros2_process.ENVIRONMENT / "bin" / "python")
        assert (isolated, program.rpartition("/")[2], node) == ("-I", "publisher.py", "musselbed_apad1")
        assert Started.newest.options["start_new_session"] is True
        assert Started.newest.options["env"]["RMW_IMPLEMENTATION"] == "rmw_fastrtps_cpp"


def test_it_ends_with_its_input_and_is_waited_for() -> None:
    Ros2Process("node").close()
    assert Started.newest.calls == ["wait", "kill", "wait"] and Started.newest.stdout.closed


@pytest.mark.parametrize("says", [b"", b"Traceback\n"])
def test_one_that_does_not_come_up_is_ended(says: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Started, "says", says)
    with pytest.raises(Ros2Gone, match="ROS 2 does not start"):
        Ros2Process("node")
    assert Started.newest.calls == ["wait", "kill", "wait"]


@pytest.mark.parametrize(
    ("has_ended", "why"), [(True, r".*Broken pipe"), (False, "timed out")], ids=["ended", "stands still"]
)
def test_one_that_takes_nothing_holds_nobody_up_for_ever(
    monkeypatch: pytest.MonkeyPatch, has_ended: bool, why: str
) -> None:
    monkeypatch.setattr(ros2_process, "_TAKES_S", 60 if has_ended else 0.01)
    with closing(Ros2Process("node")) as ros2:
        if has_ended:
            Started.newest.input.shutdown(socket.SHUT_RD)
        with pytest.raises(Ros2Gone, match=rf"takes nothing any more: {why}"):
            ros2.publish(TopicMessage("/a", TEXT, bytes(1 << 24)))


FAST = {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}
JAZZY = {"LD_LIBRARY_PATH": "/opt/ros/jazzy/lib", "AMENT_PREFIX_PATH": "/opt/ros/jazzy"}
HERE = {"PATH": "/bin", "ROS_DOMAIN_ID": "7"}


@pytest.mark.parametrize(
    ("outer", "inner"),
    [
        # Another ROS and another middleware stay outside.
        (
            HERE | JAZZY | {"RMW_IMPLEMENTATION": "rmw_zenoh_cpp"},
            HERE | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        ),
        # A person chooses who sees it.
        *(
            (asked, asked)
            for asked in (
                {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
                {"ROS_LOCALHOST_ONLY": "0"},
                {"ROS_STATIC_PEERS": "192.0.2.1"},
            )
        ),
    ],
)
def test_its_environment(outer: dict[str, str], inner: dict[str, str]) -> None:
    assert environment(outer) == inner | FAST
