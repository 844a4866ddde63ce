"""Messages of strangers among a vehicle's own: they are dropped, and the vehicle's are still read."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest

from apad_bridge.field.field_log.log_facts import BatteryReading, PacketLogged, Posed, Witness
from apad_bridge.field.field_log.reader import FactReader
from apad_bridge.field.field_log.vehicle_log import vehicle_log
from apad_bridge.records.bag import RecordedConnection, RecordedMessage

TEXT, NUMBER, NAMED_OTHERWISE = (
    RecordedConnection("/apad1/battery_level", kind, f"{field}\n", md5)
    for kind, field, md5 in (
        ("std_msgs/msg/String", "string data", "992ce8a1687cec8c8bd883ec73ca41d1"),
        ("std_msgs/msg/Float64", "float64 data", "fdb28210bfa9d7c91146260178d9a584"),
        ("lab_msgs/msg/Level", "float64 level", "0123456789abcdef0123456789abcdef"),
    )
)

PACKET = RecordedConnection(
    "/musselbed/heard",
    "musselbed_msgs/msg/Packet",
    "uint16 agent\nstring medium\nuint8[] data\n",
    "0123456789abcdef0123456789abcde0",
)


def percent(value: float, connection: RecordedConnection = NUMBER) -> RecordedMessage:
    return RecordedMessage(connection, 10**9, struct.pack("<d", value))


def test_a_text_where_a_number_is_read_is_dropped_and_counted() -> None:
    reader = FactReader("the log", "apad1")
    assert reader.read(RecordedMessage(TEXT, 10**9, struct.pack("<I", 5) + b"hello")) == []
    assert reader.dropped == {"/apad1/battery_level: no sense": 1}
    (told,) = reader.read(percent(55.0))
    assert isinstance(told, BatteryReading) and told.fraction == 0.55


def test_a_publisher_that_lacks_a_field_does_not_hide_another_that_has_it() -> None:
    reader = FactReader("the log", "apad1")
    assert reader.read(percent(55.0, NAMED_OTHERWISE)) == []
    (line,) = reader.missing.values()
    assert "lab_msgs/Level" in line and "`data`" in line
    assert len(reader.read(percent(55.0))) == 1
    assert reader.read(percent(55.0, NAMED_OTHERWISE)) == [] and len(reader.missing) == 1


def test_a_range_to_a_real_amussel_is_no_packet_of_it() -> None:
    def heard(medium: bytes) -> RecordedMessage:
        size = f"<HI{len(medium)}sI4s"
        return RecordedMessage(PACKET, 10**9, struct.pack(size, 7, len(medium), medium, 4, b"29.6"))

    reader = FactReader("the log", "apad1")
    assert reader.read(heard(b"range")) == []
    assert reader.read(heard(b"sound")) == [PacketLogged(1.0, 7, "sound", b"29.6")]


@pytest.mark.parametrize(
    "wrong_s",
    [
        pytest.param(lambda n: 3600.0 if n == 50 else 0.0, id="one stamp is an hour ahead"),
        pytest.param(lambda n: -3600.0 if n >= 300 else 0.0, id="the clock is set back by an hour"),
    ],
)
def test_a_clock_that_jumps_costs_the_track_nothing(wrong_s: Callable[[int], float]) -> None:
    poses = [Posed(n / 10, Witness.VEHICLE, n / 10 + wrong_s(n), (n / 20, 0.0)) for n in range(1000)]
    track = vehicle_log("a bag", poses).track
    assert len(track) > 990
    assert list(track.times_s) == pytest.approx([20 * it / 10 for it in track.north_m], abs=0.01)
