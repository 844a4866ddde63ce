"""What a flight reads of publishers whose definitions are not ours."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import genpy.dynamic
import pytest
import rospy
from std_msgs.msg import Bool, Float32MultiArray, Float64, Int32, String

from apad_bridge.events.graph_events import MessagesDropped
from apad_bridge.ros.generation_a import link as link_a
from apad_bridge.ros.generation_b import link as link_b
from apad_bridge.ros.links.laboratory_topics import LaboratorySubscribers
from apad_bridge.ros.links.other_apads import OtherAPads
from apad_bridge.ros.links.vehicle_subscribers import POSE_FIELDS, NavSts, VehicleSubscribers
from apad_bridge.ros.system.inbox import Inbox
from apad_bridge.ros.types.any_message import why_unfit
from apad_bridge.scenario.lab_interface.lab_messages import MessageKind
from apad_bridge.scenario.lab_interface.lab_names import Names, Number, Subscription
from apad_bridge.vehicle.commands import PoseReported
from apad_bridge.vehicle.stack_messages import UNSTAMPED, BatteryReceived

Inboxed = tuple[VehicleSubscribers, Inbox[Any]]


@pytest.fixture(params=["a", "b"])
def subscribed(request: pytest.FixtureRequest) -> Iterator[Inboxed]:
    inbox: Inbox[Any] = Inbox()
    if request.param == "a":
        subscribers: VehicleSubscribers = link_a.Subscribers("apad1", [4], inbox, stamped=False)
    else:
        subscribers = link_b.Subscribers("apad1", inbox, stamped=False)
    yield subscribers, inbox
    subscribers.close()


def on_the_wire(message: Any, node: str = "/stranger") -> rospy.AnyMsg:
    """The message as rospy hands it to a subscriber of any type."""
    buffer, raw = io.BytesIO(), rospy.AnyMsg()
    message.serialize(buffer)
    raw.deserialize(buffer.getvalue())
    raw._connection_header = {
        "type": message._type,
        "md5sum": message._md5sum,
        "message_definition": message._full_text,
        "callerid": node,
    }
    return raw


def twisted(field: str, kind: str) -> Any:
    """A NavSts with one field declared otherwise, by a publisher whose definition it is."""
    fields = {"north": "float64", "east": "float64", "yaw": "float32", "stamp": "Header header"}
    fields[field] = kind
    text = (
        f"{fields['stamp']}\nNED position\nRPY orientation\nuint8 status\n"
        f"{'=' * 80}\nMSG: auv_msgs/NED\n{fields['north']} north\n{fields['east']} east\nfloat64 depth\n"
        f"{'=' * 80}\nMSG: auv_msgs/RPY\nfloat32 roll\nfloat32 pitch\n{fields['yaw']} yaw\n"
        f"{'=' * 80}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    )
    return genpy.dynamic.generate_dynamic("auv_msgs/NavSts", text)["auv_msgs/NavSts"]


@pytest.mark.parametrize("kind", [String, Int32, Float32MultiArray, NavSts], ids=lambda it: it._type)
def test_a_publisher_of_another_type_gives_a_flight_nothing_of_its_kind(
    subscribed: Inboxed, kind: Any
) -> None:
    """Every topic of both generations: `rostopic pub /apad1/battery_level std_msgs/String hello` ended a mission."""
    subscribers, inbox = subscribed
    message = kind(data="hello") if kind is String else kind()
    for subscriber in subscribers._subscribers:
        subscriber.callback(on_the_wire(message))
    for taken in inbox.take():
        # What is taken is of the declared kind, and so has not come from the text or the list.
        assert not isinstance(taken, BatteryReceived) or isinstance(taken.percent, int | float)
        assert not isinstance(taken, PoseReported) or isinstance(taken.north_m, float)
        assert kind is not String
    assert sum(inbox.dropped.values()) >= 1


def test_a_text_for_a_number_is_dropped_counted_and_told_once_with_its_node(subscribed: Inboxed) -> None:
    subscribers, inbox = subscribed
    battery = subscribers._subscribers[2].callback
    for node in ("/stranger", "/stranger", "/another"):
        battery(on_the_wire(String(data="hello"), node))
    battery(on_the_wire(Float64(data=55.0), "/apad"))
    why = "std_msgs/String has a text in data, where std_msgs/Float64 has a number"
    assert inbox.take() == [BatteryReceived(UNSTAMPED, 55.0)]
    assert inbox.dropped == {f"apad1/battery_level: {why}": 3}
    events = inbox.take_events()
    topic = "apad1/battery_level"
    assert events == [MessagesDropped(topic, "/stranger", why), MessagesDropped(topic, "/another", why)]
    assert inbox.take_events() == []


@pytest.mark.parametrize(
    ("field", "kind"),
    [
        ("north", "string"),
        ("east", "float64[]"),
        ("yaw", "time"),
        ("yaw", "bool"),
        ("stamp", "string header"),
    ],
)
def test_a_pose_with_a_field_of_another_kind_is_dropped(subscribed: Inboxed, field: str, kind: str) -> None:
    subscribers, inbox = subscribed
    subscribers._subscribers[0].callback(on_the_wire(twisted(field, kind)()))
    assert inbox.take() == [] and sum(inbox.dropped.values()) == 1
    (told,) = inbox.take_events()
    assert isinstance(told, MessagesDropped)
    assert told.node == "/stranger" and "auv_msgs/NavSts has" in told.why


def test_a_pose_whose_numbers_are_narrower_is_read() -> None:
    inbox: Inbox[Any] = Inbox()
    subscribers = link_b.Subscribers("apad1", inbox, stamped=False)
    narrow = twisted("north", "float32")()
    narrow.position.north, narrow.position.east, narrow.orientation.yaw = 1.5, 2.0, 0.5
    subscribers._subscribers[0].callback(on_the_wire(narrow))
    subscribers.close()
    (pose,) = inbox.take()
    assert replace(pose, heard_ms=None) == PoseReported(UNSTAMPED, 1.5, 2.0, 0.5, publisher="/stranger")


def test_the_guards_of_several_aPads_keep_the_last_place_of_one_with_a_strangers_messages() -> None:
    others = OtherAPads(["apad2"])
    position = others._subscribers[0].callback
    own = NavSts()
    own.position.north, own.position.east = 3.0, 4.0
    position(on_the_wire(own, "/apad2"))
    position(on_the_wire(twisted("north", "string")()))
    position(on_the_wire(String(data="hello")))
    assert [it.place_m for it in others.bodies()] == [(3.0, 4.0)]
    assert [it.node for it in others.take_events()] == ["/stranger"]
    others.close()


@pytest.mark.parametrize(
    ("theirs", "ours", "fields", "why"),
    [
        (Int32, Bool, ("data",), None),
        (Bool, Int32, ("data",), "std_msgs/Bool has a boolean in data, where std_msgs/Int32 has a number"),
        (String, Bool, ("data",), "std_msgs/String has a text in data, where std_msgs/Bool has a boolean"),
        (NavSts, NavSts, POSE_FIELDS, None),
        (
            Float64,
            Float32MultiArray,
            ("data",),
            "std_msgs/Float64 has a number in data, where std_msgs/Float32MultiArray has a list of numbers",
        ),
        (Float64, NavSts, POSE_FIELDS, "std_msgs/Float64 has no header.stamp"),
    ],
)
def test_what_may_be_read_from_what(theirs: Any, ours: Any, fields: tuple[str, ...], why: str | None) -> None:
    assert why_unfit(theirs, ours, fields) == why


def test_a_laboratorys_message_of_another_type_is_dropped_counted_and_told_once() -> None:
    """A large number where bytes are read would be as many zeros, and an infinite one is no id."""
    heard = (
        Subscription(what=MessageKind.PACKET, topic="/modem", bytes="data"),
        Subscription(what=MessageKind.PERMISSION, topic="/permit", id=Number(field="data")),
    )
    subscribers = LaboratorySubscribers(Names(hear=heard), "apad1", [4])
    packets, permissions = (it.callback for it in subscribers._subscribers)
    for _ in range(2):
        packets(on_the_wire(Int32(data=2_000_000_000)), (heard[0], None))
    packets(on_the_wire(String(data="hello")), (heard[0], None))
    permissions(on_the_wire(Float64(data=float("inf"))), (heard[1], None))
    assert subscribers.take(0) == []
    assert subscribers.dropped == {"/modem: data holds no bytes": 3, "/permit: says no id": 1}
    assert [it.node for it in subscribers.take_events()] == ["/stranger"]
    subscribers.close()


@pytest.mark.parametrize(
    ("kind", "text", "node"),
    [
        ("x/Y", "x/Y a", "/stranger"),
        ("", "int32 a", "/stranger"),
        ("x/Y\n", "int32 a", "/stranger"),
        ("x/Y", "int32 = 1", "/stranger"),
        ("x/Y", f"x/Z a\n{'=' * 80}\nMSG: x/Z()\nint32 a\n", "/stranger"),
        ("x/Y", "foo bar baz", None),
    ],
    ids=[
        "in itself",
        "nameless",
        "with a line's end",
        "with a nameless constant",
        "of a part with brackets",
        "nonsense of nobody",
    ],
)
def test_a_laboratorys_definition_that_is_none_is_dropped_and_counted(
    kind: str, text: str, node: str | None
) -> None:
    heard = Subscription(what=MessageKind.CLEAR, topic="/clear", id=Number(field="a"))
    subscribers = LaboratorySubscribers(Names(hear=(heard,)), "apad1", [4])
    raw = on_the_wire(Int32(data=4))
    raw._connection_header = {"type": kind, "md5sum": "0", "message_definition": text}
    raw._connection_header |= {} if node is None else {"callerid": node}
    for _ in range(2):
        subscribers._subscribers[0].callback(raw, (heard, None))
    assert subscribers.take(0) == [] and subscribers.dropped.total() == 2
    assert [it.node for it in subscribers.take_events()] == [node or "an unnamed node"]
    subscribers.close()


def test_a_reader_that_fails_is_told_once_and_not_by_rospy_alone(subscribed: Inboxed) -> None:
    subscribers, inbox = subscribed

    def fail(message: Any) -> None:
        raise RuntimeError("no such gauge")

    receive = subscribers._listener.receiver("/apad1/gauge", Float64, ("data",), fail)
    for _ in range(3):
        receive(on_the_wire(Float64(1.0), "/boat"))
    (told,) = inbox.take_events()
    assert isinstance(told, MessagesDropped) and "its reader fails: RuntimeError: no such gauge" in str(told)
    assert sum(inbox.dropped.values()) == 3
