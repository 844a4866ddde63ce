"""Tests of the codec. The CRC here is bitwise and knows no table."""

import math
import random
import struct
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
import contextlib

import console as c


def bitwise_crc(data):
    """CRC-16 with polynomial x^16 + x^15 + x^2 + 1, bit by bit, start 0.

    It feeds the lowest bit of each octet first into a register that shifts
    left, and mirrors the register at the end.
    """
    register = 0
    for octet in data:
        for bit in range(8):
            feed = (octet >> bit) & 1
            top = (register >> 15) & 1
            register = (register << 1) & 0xFFFF
            if feed ^ top:
                register ^= 0x8005
    return int(f"{register:016b}"[::-1], 2)


def test_crc_known_value():
    assert bitwise_crc(b"123456789") == 0xBB3D
    assert c.crc16(b"123456789") == 0xBB3D


def test_crc_equals_bitwise():
    source = random.Random(1)
    for size in (0, 1, 2, 20, 300):
        data = bytes(source.randrange(256) for _ in range(size))
        assert c.crc16(data) == bitwise_crc(data)


def test_heartbeat_big_endian_by_hand():
    body = bytes.fromhex(
        "fe54"  # sync
        "0096"  # Heartbeat, 150
        "0000"  # size of the payload
        "3ff0000000000000"  # 1.0 s
        "4001"
        "ff"  # src, src_ent
        "2a00"
        "ff"
    )  # dst, dst_ent
    assert bitwise_crc(body) == 0x288F
    whole = body + bytes.fromhex("288f")
    assert c.encode("Heartbeat", src=0x4001, dst=0x2A00, timestamp=1.0) == whole
    message = c.decode(whole)
    assert (message.name, message.src, message.dst, message.timestamp) == ("Heartbeat", 0x4001, 0x2A00, 1.0)


def test_heartbeat_little_endian_by_hand():
    body = bytes.fromhex("54fe96000000000000000000f03f0140ff002aff")
    whole = body + struct.pack("<H", bitwise_crc(body))
    assert whole[-2:] == bytes.fromhex("46ed")
    assert c.encode("Heartbeat", src=0x4001, dst=0x2A00, timestamp=1.0, order="little") == whole
    assert c.decode(whole).order == "little"


def test_announce_by_hand():
    payload = (
        bytes.fromhex(
            "0004"
            "61506164"  # sys_name "aPad"
            "03"  # USV
            "ffff"  # no owner
            "3fe8000000000000"  # lat 0.75 rad
            "3fd0000000000000"  # lon 0.25 rad
            "3f800000"  # height 1 m
            "001a"
        )
        + b"imc+udp://127.0.0.1:6002/;"
    )
    body = bytes.fromhex("fe540097003940000000000000002a0000ffffff") + payload
    assert len(payload) == 0x39
    whole = body + struct.pack(">H", bitwise_crc(body))
    fields = {
        "sys_name": "aPad",
        "sys_type": "USV",
        "owner": 0xFFFF,
        "lat": 0.75,
        "lon": 0.25,
        "height": 1.0,
        "services": "imc+udp://127.0.0.1:6002/;",
    }
    assert c.encode("Announce", fields, src=0x2A00, src_ent=0, timestamp=2.0) == whole
    assert c.decode(whole).fields == {**fields, "sys_type": 3}


def test_plan_control_with_inline_goto_by_hand():
    payload = bytes.fromhex(
        "00"
        "00"
        "0007"  # REQUEST START 7
        "0001"
        "70"  # plan "p"
        "0000"  # flags
        "01c2"  # inline Goto, 450
        "03e8"  # timeout 1000 s
        "3fe8000000000000"
        "3fd0000000000000"
        "00000000"
        "01"  # z 0 m, DEPTH
        "447a0000"
        "01"  # 1000 RPM
        "0000000000000000"
        "0000000000000000"
        "0000000000000000"
        "0000"  # custom
        "0000"
    )  # info
    goto = (
        "Goto",
        {"timeout": 1000, "lat": 0.75, "lon": 0.25, "z_units": 1, "speed": 1000.0, "speed_units": 1},
    )
    assert c.pack_fields("PlanControl", {"request_id": 7, "plan_id": "p", "arg": goto}) == payload


def test_estimated_state_size():
    assert len(c.pack_fields("EstimatedState", {})) == 88


def sample(kind, name, field, source):
    if kind in ("u8", "u16", "u32"):
        return source.randrange(1 << int(kind[1:]))
    if kind in ("i16", "i32"):
        half = 1 << (int(kind[1:]) - 1)
        return source.randrange(-half, half)
    if kind == "f32":
        return struct.unpack("f", struct.pack("f", source.uniform(-9, 9)))[0]
    if kind == "f64":
        return source.uniform(-9, 9)
    if kind == "text":
        return source.choice(["", "abc", "žaba", "x" * 300])
    if kind == "raw":
        return bytes(source.randrange(256) for _ in range(source.randrange(20)))
    if kind == "msg":
        return source.choice(
            [None, ("Abort", {}), ("Heartbeat", {}), ("EntityList", {"op": 1, "list": "a=1"})]
        )
    return source.choice(
        [[], [None], [("Abort", {}), ("PlanVariable", {"name": "n", "value": "v", "type": 1, "access": 0})]]
    )


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize("name", sorted(c.MESSAGES))
def test_round_trip(name, order):
    source = random.Random(name)
    for _ in range(5):
        fields = {field: sample(kind, name, field, source) for field, kind in c.MESSAGES[name][1]}
        data = c.encode(
            name, fields, src=0x2A01, dst=0x4001, src_ent=3, dst_ent=4, timestamp=12.5, order=order
        )
        assert bitwise_crc(data[:-2]) == struct.unpack(">H" if order == "big" else "<H", data[-2:])[0]
        message = c.decode(data)
        assert (message.name, message.fields, message.order) == (name, fields, order)
        assert (message.src, message.src_ent, message.dst, message.dst_ent) == (0x2A01, 3, 0x4001, 4)
        assert (message.timestamp, message.length) == (12.5, len(data))
        assert c.unplain(c.plain(fields)).keys() == fields.keys()


def test_ids_are_unique():
    assert len(c.BY_ID) == len(c.MESSAGES)


def reason(data):
    with pytest.raises(c.ImcError) as error:
        c.decode(data)
    return error.value.reason


def with_crc(body):
    return body + struct.pack(">H", bitwise_crc(body))


def head(number, size):
    return struct.pack(">HHHdHBHB", 0xFE54, number, size, 0.0, 1, 0, 2, 0)


def test_reasons():
    good = c.encode("EntityState", {"description": "ok"}, src=1)
    assert reason(b"") == "short"
    assert reason(b"\xfe") == "short"
    assert reason(b"\xfe\x54") == "short"
    assert reason(good[:-1]) == "short"
    assert reason(b"\x00\x00" + good[2:]) == "bad sync"
    assert reason(good[:-1] + bytes([good[-1] ^ 1])) == "bad CRC"
    assert reason(good[:22] + bytes([good[22] ^ 1]) + good[23:]) == "bad CRC"
    assert reason(with_crc(head(9999, 0))) == "unknown id"
    assert reason(with_crc(head(150, 1) + b"\0")) == "bad payload"
    assert reason(with_crc(head(251, 3) + b"\0\0\0")) == "bad payload"
    assert reason(with_crc(head(305, 3) + b"\0\x01\xff")) == "bad payload"
    assert reason(with_crc(head(561, 2) + b"\0\x09")) == "bad payload"


def test_unknown_inline_id():
    payload = bytes.fromhex("0000000100000000270f0000")
    assert reason(with_crc(head(559, len(payload)) + payload)) == "unknown id"


def test_deep_nesting_is_refused():
    payload = bytes.fromhex("0000010001f5") * 5000
    assert reason(with_crc(head(501, len(payload)) + payload)) == "bad payload"


def test_random_octets_raise_only_imc_error():
    source = random.Random(2)
    for _ in range(500):
        name = source.choice(sorted(c.MESSAGES))
        fields = {field: sample(kind, name, field, source) for field, kind in c.MESSAGES[name][1]}
        body = bytearray(c.encode(name, fields)[:-2])
        for _ in range(source.randrange(1, 6)):
            if len(body) > 20:
                body[source.randrange(20, len(body))] = source.randrange(256)
        with contextlib.suppress(c.ImcError):
            c.decode(with_crc(bytes(body)))


@pytest.mark.parametrize(
    "name,fields",
    [
        ("Nothing", {}),
        ("Abort", {"x": 1}),
        ("FuelLevel", {"value": 1e300}),
        ("EntityState", {"state": 256}),
        ("EntityState", {"state": -1}),
        ("EntityState", {"state": "BAD"}),
        ("EntityState", {"description": "x" * 65536}),
        ("PlanControl", {"arg": 7}),
        ("PlanControl", {"request_id": 65536}),
        ("EntityState", {"description": 5}),
    ],
)
def test_encode_refuses(name, fields):
    with pytest.raises(ValueError):
        c.encode(name, fields)


def test_choose_address():
    services = "imc+udp://172.17.0.1:6001/;imc+udp://127.0.0.1:7001/;imc+udp://127.0.0.1:7002/;imc+tcp://127.0.0.1:9/;"
    assert c.choose_address(services, ("127.0.0.1", 7002)) == ("127.0.0.1", 7002)
    assert c.choose_address(services, ("127.0.0.1", 5)) == ("127.0.0.1", 7001)
    assert c.choose_address("imc+udp://127.0.0.2:7001", ("127.0.0.1", 5)) == ("127.0.0.2", 7001)
    assert c.choose_address("imc+udp://10.0.200.9:6001/;", ("127.0.0.1", 6001)) is None
    assert c.choose_address("", ("127.0.0.1", 6001)) is None


def test_displace():
    lat, lon = math.radians(45.0), math.radians(13.0)
    north, _ = c.displace(lat, lon, 1000.0, 0.0)
    _, east = c.displace(lat, lon, 0.0, 1000.0)
    # One degree of latitude at 45 degrees is 111132 m, one of longitude 78847 m.
    assert math.degrees(north - lat) * 111132 == pytest.approx(1000.0, abs=0.2)
    assert math.degrees(east - lon) * 78847 == pytest.approx(1000.0, abs=0.2)


def test_faults_are_seeded():
    first, second, other = (c.Faults(seed, 0.5, 0.5, 0.5, 0) for seed in (1, 1, 2))
    rows = [[faults.draw("PlanControl", 5) for _ in range(50)] for faults in (first, second, other)]
    assert rows[0] == rows[1] != rows[2]
    assert not any(c.Faults(1, 0, 0, 0, 0).draw("x", 1).values())
    assert all(c.Faults(1, 1, 1, 1, 0).draw("x", 1).values())
