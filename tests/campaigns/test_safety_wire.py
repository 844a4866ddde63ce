"""The judge's eye: packets made by hand, and messages as ROS's own serialisers write them."""

from __future__ import annotations

import ast
import io
import random
import struct
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from safety import tcpros, wire
from safety.tcpros import Answer, Call, Heard, Message, PacketsMissed, Reader, Stream

from apad_bridge.ros.types.messages import use_generated_messages

use_generated_messages()

from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray  # noqa: E402
from apad.msg import aPadActionGoal  # noqa: E402
from auv_msgs.msg import NavSts  # noqa: E402
from genpy import Message as RosMessage  # noqa: E402
from misc_msgs.srv import (  # noqa: E402
    DynamicPositioningPrimitiveServiceRequest,
    Go2pointPrimitiveServiceRequest,
    Go2pointServiceRequest,
)
from navcon_msgs.srv import EnableControlRequest  # noqa: E402
from std_msgs.msg import Bool, Float32, Float32MultiArray, MultiArrayDimension, String  # noqa: E402
from std_srvs.srv import TriggerResponse  # noqa: E402

STUDY = Path(wire.__file__).parent
LAPTOP, VEHICLE = "10.99.0.2", "10.99.0.1"
SYN, ACK = 0x02, 0x10
HULL = "/apad1_simulated"


def packet(
    source: tuple[str, int], target: tuple[str, int], sequence: int, flags: int, data: bytes = b""
) -> bytes:
    """IPv4 and TCP headers without options, by RFC 791 and RFC 9293; checksums are left at 0."""
    addresses = b"".join(bytes(map(int, it[0].split("."))) for it in (source, target))
    ip = struct.pack("!BBHHHBBH", 0x45, 0, 40 + len(data), 0, 0, 64, 6, 0) + addresses
    return (
        ip
        + struct.pack("!HHIIBBHHH", source[1], target[1], sequence % 2**32, 0, 5 << 4, flags, 0, 0, 0)
        + data
    )


def record(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def header(**fields: str) -> bytes:
    return record(b"".join(record(f"{key}={value}".encode()) for key, value in fields.items()))


def bytes_of(message: RosMessage) -> bytes:
    out = io.BytesIO()
    message.serialize(out)
    return out.getvalue()


class Talk:
    """A connection of the laptop to the vehicle, whose packets arrive cut into pieces."""

    def __init__(self, reader: Reader, piece: int = 1400, first: int = 2**32 - 20) -> None:
        self.reader, self.piece = reader, piece
        self.ends = {True: (LAPTOP, 40_000), False: (VEHICLE, 50_000)}
        self.next = {True: first, False: 7}
        for of_client in (True, False):
            self.reader.take(self._packet(of_client, SYN, b""))
            self.next[of_client] += 1

    def _packet(self, of_client: bool, flags: int, data: bytes) -> bytes:
        return packet(self.ends[of_client], self.ends[not of_client], self.next[of_client], flags, data)

    def packets(self, of_client: bool, data: bytes) -> list[bytes]:
        made = []
        for at in range(0, len(data), self.piece):
            piece = data[at : at + self.piece]
            made.append(self._packet(of_client, ACK, piece))
            self.next[of_client] += len(piece)
        return made

    def say(self, of_client: bool, data: bytes) -> list[Heard]:
        return [it for one in self.packets(of_client, data) for it in self.reader.take(one)]


def calls(talk: Talk, service: str = "/apad1/commander/stop_mission") -> None:
    talk.say(True, header(callerid="/musselbed_1", service=service, md5sum="*"))
    talk.say(False, header(callerid=HULL, type="std_srvs/Trigger"))


@pytest.mark.parametrize("piece", [1, 3, 1400])
def test_a_call_and_its_answers_are_read_in_whatever_pieces_they_come(piece: int) -> None:
    talk = Talk(Reader(), piece)
    calls(talk)
    assert talk.say(True, record(b"")) == [Call(1, "/apad1/commander/stop_mission", "/musselbed_1", b"")]
    done = bytes_of(TriggerResponse(True, "it stops"))
    assert talk.say(False, b"\1" + record(done)) == [
        Answer(1, "/apad1/commander/stop_mission", "/musselbed_1", True, done)
    ]
    # The connection stays: a second call is refused with an error's text.
    assert [type(it) for it in talk.say(True, record(b""))] == [Call]
    (refused,) = talk.say(False, b"\0" + record(b"busy"))
    assert isinstance(refused, Answer) and (refused.number, refused.ok, refused.data) == (2, False, b"busy")


def test_a_topic_names_publisher_and_subscriber() -> None:
    talk = Talk(Reader())
    talk.say(True, header(callerid=HULL, topic="/apad1/action_server/goal"))
    talk.say(False, header(callerid="/musselbed_1"))
    assert talk.say(False, record(b"one") + record(b"two")) == [
        Message("/apad1/action_server/goal", "/musselbed_1", HULL, it) for it in (b"one", b"two")
    ]


@given(st.randoms(use_true_random=False), st.integers(1, 9))
def test_packets_in_any_order_and_sent_again_say_the_same(rng: random.Random, piece: int) -> None:
    talk = Talk(Reader(), piece)
    calls(talk)
    data = b"".join(record(bytes([number] * number)) for number in range(1, 9))
    packets = talk.packets(True, data)
    shuffled = packets + rng.choices(packets, k=5)
    rng.shuffle(shuffled)
    heard = [it for one in shuffled for it in talk.reader.take(one)]
    assert [it.data for it in heard] == [bytes([number] * number) for number in range(1, 9)]


def test_what_is_no_tcpros_or_only_asks_for_a_type_is_left_alone() -> None:
    assert Talk(Reader()).say(True, b"POST /RPC2 HTTP/1.1\r\nHost: vehicle\r\n" * 3) == []
    talk = Talk(Reader())
    talk.say(True, header(callerid="/x", service="/apad1/commander/stop_mission", probe="1"))
    assert talk.say(True, record(b"")) == []
    assert Reader().take(b"\x60" + bytes(60)) == []  # IPv6


def test_a_packet_that_never_comes_is_no_silence() -> None:
    stream = Stream(0)
    with pytest.raises(PacketsMissed):
        for number in range(1, 2000):
            stream.take(10 * number, b"later")


def test_a_port_that_is_used_again_is_another_connection() -> None:
    reader = Reader()
    calls(Talk(reader))
    again = Talk(reader, first=99)
    calls(again, "/apad1/VelCon_enable")
    (call,) = again.say(True, record(b"\0"))
    assert isinstance(call, Call) and call.service == "/apad1/VelCon_enable"


def heard_as(heard: Heard) -> dict[str, object] | None:
    return wire.Wire("/apad1", HULL, "/hull/position").take(heard)


def test_truth_is_read_as_ros_writes_it() -> None:
    message = NavSts()
    message.header.stamp.secs, message.header.stamp.nsecs = 12, 500_000_000
    message.header.frame_id = "local"
    message.position.north, message.position.east, message.position.depth = -3.25, 41.5, 9.0
    message.gbody_velocity.x, message.orientation.yaw, message.orientation.roll = 7.0, 0.5, 8.0
    assert heard_as(Message("/hull/position", HULL, "/actor_relay", bytes_of(message))) == {
        "fact": "truth", "north": -3.25, "east": 41.5, "yaw": 0.5, "stamp": 12.5
    }  # fmt: skip
    # The falsified copy is no truth, whoever hears it.
    assert heard_as(Message("/apad1/position", "/actor_relay", "/musselbed_1", bytes_of(message))) is None


@pytest.mark.parametrize(("kind", "place"), [(0, [20.0, 30.0]), (1, None), (2, None)])
def test_goals_of_generation_a_are_read_as_ros_writes_them(kind: int, place: list[float] | None) -> None:
    message = aPadActionGoal()
    message.header.frame_id, message.goal_id.id = "map", "musselbed-7"
    message.goal.id, message.goal.object = kind, "amussel3"
    message.goal.pose.position.x, message.goal.pose.position.y = 20.0, 30.0
    goal = Message("/apad1/action_server/goal", "/musselbed_1", HULL, bytes_of(message))
    assert heard_as(goal) == {
        "fact": "goal", "by": "/musselbed_1", "key": "musselbed-7", "kind": kind, "place": place
    }  # fmt: skip
    other = Message("/apad1/action_server/goal", "/musselbed_1", "/rosbag", bytes_of(message))
    assert heard_as(other) is None  # not the vehicle's own connection


def test_cancels_and_statuses_are_read_as_ros_writes_them() -> None:
    cancel = Message("/apad1/action_server/cancel", "/musselbed_1", HULL, bytes_of(GoalID(id="seven")))
    assert heard_as(cancel) == {"fact": "cancel", "by": "/musselbed_1", "key": "seven"}
    codes = GoalStatusArray()
    codes.status_list = [GoalStatus(GoalID(id=it), code, "text") for it, code in (("six", 2), ("seven", 1))]
    status = Message("/apad1/action_server/status", HULL, "/musselbed_1", bytes_of(codes))
    reader = wire.Wire("/apad1", HULL, "/hull/position")
    assert reader.take(status) == {"fact": "status", "goals": {"six": 2, "seven": 1}}
    assert reader.take(status) is None  # the same again


@pytest.mark.parametrize(
    ("service", "request_", "read"),
    [
        (
            "commander/primitive/dynamic_positioning",
            DynamicPositioningPrimitiveServiceRequest(north=4.5, east=-2.0, depth=1.0, heading=3.0),
            {"place": [4.5, -2.0]},
        ),
        ("commander/primitive/go2point", Go2pointPrimitiveServiceRequest(), {"place": [0.0, 0.0]}),
        ("commander/go2point", Go2pointServiceRequest(speed=1.0), {"place": [0.0, 0.0]}),
        ("VelCon_enable", EnableControlRequest(False), {"enable": False}),
        ("FADP_enable", EnableControlRequest(True), {"enable": True}),
    ],
)
def test_requests_are_read_as_ros_writes_them(
    service: str, request_: RosMessage, read: dict[str, object]
) -> None:
    call = Call(3, f"/apad1/{service}", "/musselbed_1", bytes_of(request_))
    assert heard_as(call) == {"fact": "call", "number": 3, "order": service, "by": "/musselbed_1"} | read


def test_an_answer_of_no_is_no_acceptance() -> None:
    for ok, data, took in (
        (True, b"\1", True),
        (True, b"\0", False),
        (False, b"why", False),
        (True, b"", True),
    ):
        fact = heard_as(Answer(3, "/apad1/commander/primitive/go2point", "/musselbed_1", ok, data))
        assert fact is not None and fact["took"] is took
    assert heard_as(Call(1, "/apad1/get_battery_level", "/x", b"")) is None


def test_flags_arms_and_states_are_told_when_they_change() -> None:
    reader = wire.Wire("/apad1", HULL, "/hull/position")
    flag = Message("/apad1/manual", "/actor_pilot", HULL, bytes_of(Bool(True)))
    assert reader.take(flag) == {"fact": "pilot", "steers": True, "by": "/actor_pilot"}
    assert reader.take(flag) is None
    arms = Float32MultiArray(data=[0.0, 1.0, 0.0, 0.0])
    arms.layout.dim = [MultiArrayDimension("docks", 4, 4)]
    assert reader.take(Message("/apad1/dock_out", "/musselbed_1", HULL, bytes_of(arms))) == {
        "fact": "arms", "open": 1, "by": "/musselbed_1"
    }  # fmt: skip
    held = Message("/apad1/watchdog", "/musselbed_watchdog_1", "/musselbed_1", bytes_of(String("HELD")))
    assert reader.take(held) == {"fact": "watchdog", "state": "HELD"}


@pytest.mark.parametrize(("number", "says_off"), [(0.4, False), (3.0, False), (-1.0, True)])
def test_a_heartbeat_is_told_where_it_arrives_at_the_watchdog(number: float, says_off: bool) -> None:
    beat = bytes_of(Float32(number))
    fact = heard_as(Message("/musselbed/heartbeat", "/musselbed_1", "/musselbed_watchdog_1", beat))
    assert fact == {"fact": "heartbeat", "says_off": says_off}
    assert heard_as(Message("/musselbed/heartbeat", "/musselbed_1", "/musselbed_2", beat)) is None


def test_a_layout_that_does_not_fit_is_told() -> None:
    fact = heard_as(Call(1, "/apad1/commander/primitive/go2point", "/musselbed_1", b"\1"))
    assert fact is not None and fact["fact"] == "unread"


def test_the_judge_knows_nothing_of_what_it_judges() -> None:
    """Its modules import the standard library and each other, wherever in the file."""
    own = {f"safety.{name}" for name in ("tcpros", "wire", "track", "judge")}
    for name in ("tcpros", "wire", "track", "judge"):
        for node in ast.walk(ast.parse((STUDY / f"{name}.py").read_text())):
            names = [it.name for it in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert all(it in own or it.split(".")[0] in sys.stdlib_module_names for it in names), (
                name,
                names,
            )
    assert tcpros.fields_of(header(callerid="/x", topic="/y=z")[4:]) == {"callerid": "/x", "topic": "/y=z"}
