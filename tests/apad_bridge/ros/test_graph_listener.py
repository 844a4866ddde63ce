"""What a listener hands on of a graph whose simulated clock begins late, without a graph."""

from __future__ import annotations

import pytest
import rospy
from rosgraph_msgs.msg import Clock

from apad_bridge.ros import graph_listener
from apad_bridge.ros.graph_listener import GraphListener


def message(publisher: str, data: bytes, *, is_latched: bool) -> rospy.AnyMsg:
    made = rospy.AnyMsg()
    made._buff = data
    made._connection_header = {
        "callerid": publisher,
        "md5sum": "992ce8a1687cec8c8bd883ec73ca41d1",
        "type": "std_msgs/String",
        "message_definition": "string data",
        "latching": "1" if is_latched else "0",
    }
    return made


@pytest.fixture
def now_s(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The graph's time, as the only element."""
    time = [0]
    monkeypatch.setattr(graph_listener, "start_node", lambda *_, **__: None)
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(time[0]))
    return time


def test_what_comes_once_and_before_the_clock_is_handed_on_with_its_first_time(now_s: list[int]) -> None:
    """Of each publisher of a topic: /tf_static has several. What comes again is dropped until the clock is there."""
    listener = GraphListener((), "listener")
    for publisher, data in (("/one", b"old"), ("/one", b"new"), ("/two", b"its own")):
        listener._put(message(publisher, data, is_latched=True), "/tf_static")
    listener._put(message("/one", b"lost", is_latched=False), "/pose")
    assert listener.take(0.0) == []
    now_s[0] = 7
    for data in (b"first", b"second"):
        listener._put(message("/one", data, is_latched=False), "/pose")
    assert [(it.connection.topic, it.data, it.stamp_ns) for it in listener.take(1.0)] == [
        ("/tf_static", b"new", 7 * 10**9),
        ("/tf_static", b"its own", 7 * 10**9),
        ("/pose", b"first", 7 * 10**9),
        ("/pose", b"second", 7 * 10**9),
    ]


def test_a_topic_that_rospy_itself_reads_by_its_class_is_handed_on_as_bytes(now_s: list[int]) -> None:
    """/clock under use_sim_time: rospy has one connection a topic, and gives each subscriber the first one's class."""
    now_s[0] = 7
    listener, clock = GraphListener((), "listener"), Clock(rospy.Time(1, 2))
    clock._connection_header = {
        "callerid": "/clock_node",
        "md5sum": Clock._md5sum,
        "type": Clock._type,
        "message_definition": Clock._full_text,
        "latching": "0",
    }
    listener._put(clock, "/clock")
    (heard,) = listener.take(1.0)
    assert heard.data == (1).to_bytes(4, "little") + (2).to_bytes(4, "little")
    assert (heard.connection.kind, heard.connection.md5) == ("rosgraph_msgs/msg/Clock", Clock._md5sum)
