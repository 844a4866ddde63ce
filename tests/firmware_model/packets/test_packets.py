"""The wire layout: golden bytes assembled by hand, round trips, and the detection of every single flipped bit."""

import re
import struct
from dataclasses import astuple, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.packets import (
    EVERYONE,
    PLAIN,
    AcousticStatus,
    Beacon,
    CommandPacket,
    HoverAt,
    Kind,
    LogAck,
    LogRecords,
    Packet,
    SetThreshold,
    ShortStatus,
    SleepSchedule,
    SlotAssignment,
    StatusPacket,
    Threshold,
    WifiStatus,
    decode,
)
from firmware_model.packets.command_packets import WITH_ARGUMENTS
from firmware_model.packets.sample_record import RECORD_BYTES, SampleRecord
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.sampling.sensors import SENSORS
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

STATUS = StatusPacket(24, 7, State.FLOATING, 0.5, 1.0, 12.34, -5.0, 3.0, 1_800_000)
# id 24, sequence 7, state 4, 32768/65535, 65535/65535, 1234 cm, -500 cm, 300 cm, 1 800 000 ms
_BASIC = "1800" "0700" "04" "0080" "ffff" "d2040000" "0cfeffff" "2c01" "40771b0000000000"  # fmt: skip
FURTHER = len(SENSORS) - 4
"""The sensors beyond the board's four, with a count of two bytes each: 0 unless somebody has added a row to the table."""
COUNTS = (1000, 2000, 3000, 4095, *FURTHER * (0,))
_COUNTS = "e803" "d007" "b80b" "ff0f" + FURTHER * "0000"  # fmt: skip
RECORD = SampleRecord(5, 1_800_000, COUNTS, 0b1000)
RECORD_BODY = "01" "08" "05000000" "40771b0000000000" + _COUNTS  # fmt: skip


def crc16_ccitt(data: bytes) -> int:
    """CRC-16/CCITT-FALSE bit by bit: polynomial 0x1021, start 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
            crc &= 0xFFFF
    return crc


RECORD_CHECK = struct.pack("<H", crc16_ccitt(bytes.fromhex(RECORD_BODY))).hex() if FURTHER else "8070"
"""Of the record alone."""
GOLDEN: dict[str, tuple[Packet, str]] = {
    "STATUS": (STATUS, "0101" + _BASIC),
    "ACOUSTIC_STATUS": (
        AcousticStatus(*astuple(STATUS), COUNTS, 70_000, 300),
        "020d" + _BASIC + _COUNTS + "70110100" + "2c01",
    ),
    "WIFI_STATUS": (
        WifiStatus(
            *astuple(STATUS), COUNTS, 70_000, 68_988, 69_000, 12, 1,
            ResetCause.BROWN_OUT, ActiveBattery.SECONDARY, 1026, -250,
        ),
        "020e" + _BASIC + _COUNTS
        + "70110100" "7c0d0100" "880d0100" "0c000000" "0100" "01" "01" "0204" "06ffffff",
    ),
    "SHORT_STATUS": (ShortStatus(300, State.LOST, 0.2, 1.0), "b1" "2c01" "33" "ff"),
    "PERMISSION": (CommandPacket(Kind.PERMISSION, 5), "0102" "0500"),
    "RELEASE": (CommandPacket(Kind.RELEASE, 5), "0103" "0500"),
    "PING": (CommandPacket(Kind.PING, 5), "0104" "0500"),
    "HOVER": (CommandPacket(Kind.HOVER, 5), "0105" "0500"),
    "HOVER at a depth": (HoverAt(5, 12.75), "0205" "0500" "33"),
    "SINK": (CommandPacket(Kind.SINK, 5), "0206" "0500"),
    "SLEEP_SCHEDULE": (SleepSchedule(5, 3_600_000, 10_000), "0207" "0500" "80ee3600" "10270000"),
    "SLOT_ASSIGNMENT": (
        SlotAssignment(5, 300_000, 3000, 500, 23, -1330),
        "0208" "0500" "e0930400" "b80b0000" "f401" "1700" "cefaffff",
    ),
    "SET_THRESHOLD": (SetThreshold(5, Threshold.SWITCH_BACK, 0.2), "0209" "0500" "01" "3333"),
    "BACK_UP_LOG": (CommandPacket(Kind.BACK_UP_LOG, 5), "020a" "0500"),
    "BEACON": (Beacon(EVERYONE, 2**40 + 1), "020b" "0000" "0100000000010000"),
    "LOG_ACK": (LogAck(5, 70_000), "020c" "0500" "70110100"),
    "LOG_RECORDS": (
        LogRecords.of(5, 3, 4, 2, (RECORD,)),
        "020f" "0500" "03000000" "04000000" "02" + RECORD_BODY + RECORD_CHECK,
    ),
}  # fmt: skip
WITH_COUNTS = ("ACOUSTIC_STATUS", "WIFI_STATUS", "LOG_RECORDS")


def checked(body: bytes) -> bytes:
    return body + struct.pack("<H", crc16_ccitt(body))


def test_a_count_beyond_its_field_is_stated_as_the_greatest() -> None:
    sound, wifi = GOLDEN["ACOUSTIC_STATUS"][0], GOLDEN["WIFI_STATUS"][0]
    told = decode(replace(sound, samples=1 << 33, waiting=70_000).encode())
    assert (told.samples, told.waiting) == (0xFFFF_FFFF, 0xFFFF)
    assert decode(replace(wifi, torn=70_000).encode()).torn == 0xFFFF


def golden(name: str) -> bytes:
    return checked(bytes.fromhex(GOLDEN[name][1]))


def test_crc_has_the_published_check_value() -> None:
    assert crc16_ccitt(b"123456789") == 0x29B1


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_bytes_are_written_and_read_back_and_nothing_where_they_are_cut_off(name: str) -> None:
    packet, data = GOLDEN[name][0], golden(name)
    found = decode(data)
    assert packet.encode() == data and type(found) is type(packet)
    assert found is not None and found.encode() == data
    assert all(decode(data[:size]) is None for size in range(len(data)))


def test_the_page_shows_these_bytes() -> None:
    page = (Path(__file__).parents[3] / "docs" / "packets.md").read_text()
    shown = dict(re.findall(r"^\| ([\w ]+) \| `([0-9a-f]+)` \|$", page, re.MULTILINE))
    for_four = [name for name in GOLDEN if not (FURTHER and name in WITH_COUNTS)]
    assert shown.keys() == GOLDEN.keys()
    assert {name: shown[name] for name in for_four} == {name: golden(name).hex() for name in for_four}


def test_the_page_states_every_size() -> None:
    page = (Path(__file__).parents[3] / "docs" / "packets.md").read_text()
    rows = re.findall(r"^\| `(\w+)` (\d+) \| (\d) \| (\d+)( \+ 24 n)? \|", page, re.MULTILINE)
    stated = {(name, int(kind), int(version)): int(size) for name, kind, version, size, _ in rows}
    expected = {}
    for name in GOLDEN:
        data = golden(name)
        if name != "SHORT_STATUS":
            records = RECORD_BYTES if name == "LOG_RECORDS" else 2 * FURTHER * (name in WITH_COUNTS)
            expected[Kind(data[1]).name, data[1], data[0]] = len(data) - records
    assert stated == expected


def test_every_kind_has_a_golden_packet() -> None:
    kinds = {getattr(packet, "kind", None) or getattr(packet, "KIND", None) for packet, _ in GOLDEN.values()}
    assert kinds == {*Kind, None}  # None: the short status has no room for a kind


def test_golden_record() -> None:
    data = checked(bytes.fromhex(RECORD_BODY))
    assert RECORD.encode() == data
    assert data[-2:].hex() == RECORD_CHECK and len(data) == RECORD_BYTES
    assert SampleRecord.decode(data) == RECORD


def test_what_a_v3_modem_carries() -> None:
    assert len(golden("ACOUSTIC_STATUS")) == 45 + 2 * FURTHER
    over_wifi = ("WIFI_STATUS", "LOG_RECORDS")
    assert all(len(golden(name)) <= 64 for name in GOLDEN if name not in over_wifi)


def test_what_a_v2_modem_carries() -> None:
    fits = {name for name in GOLDEN if len(golden(name)) <= 7}
    assert fits == {
        "SHORT_STATUS",
        "PERMISSION",
        "RELEASE",
        "PING",
        "HOVER",
        "HOVER at a depth",
        "SINK",
        "BACK_UP_LOG",
    }
    assert len(golden("SHORT_STATUS")) == 7


NATIVE = Path(__file__).parents[3] / "firmware_model/native"
LAYOUTS = {(it.version, kind, 6) for kind, it in PLAIN.items()} | {
    (it.VERSION, it.kind, it.FORMAT.size + 2) for it in WITH_ARGUMENTS
}


def test_the_board_of_the_worst_case_in_c_has_the_declared_commands() -> None:
    rows = re.findall(r'\{(\d+), (\d+), (\d+), "(\w+)", +(-1|\w+)\}', (NATIVE / "worst_case.c").read_text())
    assert {(int(version), Kind[name], int(size)) for version, _, size, name, _ in rows} == LAYOUTS
    assert all(int(kind) == Kind[name] for _, kind, _, name, _ in rows)
    declared = {
        kind.name: it.trigger.name
        for kind, it in PLAIN.items()
        if it.trigger is not None and it.in_worst_case
    }
    assert {name: trigger for *_, name, trigger in rows if trigger != "-1"} == declared


def test_the_whole_board_in_c_has_the_declared_commands() -> None:
    task = (NATIVE / "whole/command_task.c").read_text()
    (named,) = re.findall(r"enum kind \{(.*?)\}", task, re.DOTALL)
    numbers: dict[str, int] = {}
    for name, number in re.findall(r"(\w+)(?: = (\d+))?", named):
        numbers[name] = int(number or max(numbers.values()) + 1)
    assert numbers == {kind.name: kind for _, kind, _ in LAYOUTS}
    rows = re.findall(r"\{(\d+), ([A-Z_]+), (\d+)\}", task)
    assert {(int(version), Kind[name], int(size)) for version, name, size in rows} == LAYOUTS
    triggers = re.findall(r"case (\w+): execute_with_trigger\(kind, (\w+),", task)
    assert dict(triggers) == {
        kind.name: it.trigger.name for kind, it in PLAIN.items() if it.trigger is not None
    }


CENTIMETRES = st.integers(-(2**31), 2**31 - 1).map(lambda n: n / 100)
U8, U16, U32 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32))
CHARGES = U16.map(lambda n: n / 65535)
COUNTED = st.tuples(*len(SENSORS) * (U16,))
FIELDS = (
    U16,
    U16,
    st.sampled_from(State),
    CHARGES,
    CHARGES,
    CENTIMETRES,
    CENTIMETRES,
    U16.map(lambda n: n / 100),
    st.integers(0, 2**63),
)
RECORDS = st.builds(SampleRecord, U32, st.integers(0, 2**63), COUNTED, st.integers(0, 15))


def log_records(agent_id: int, oldest: int, first: int, records: list[SampleRecord]) -> LogRecords:
    """Records as an aMussel sends them: rising, with some missing."""
    first += oldest
    kept = [replace(record, sequence=first + 2 * n) for n, record in enumerate(records)]
    return LogRecords.of(agent_id, oldest, first, 2 * len(kept), tuple(kept))


PACKETS: st.SearchStrategy[Packet] = st.one_of(
    st.builds(StatusPacket, *FIELDS),
    st.builds(AcousticStatus, *FIELDS, COUNTED, U32, U16),
    st.builds(
        WifiStatus,
        *FIELDS,
        COUNTED,
        U32,
        U32,
        U32,
        U32,
        U16,
        st.sampled_from(ResetCause),
        st.sampled_from(ActiveBattery),
        U16,
        st.integers(-(2**31), 2**31 - 1),
    ),
    st.builds(ShortStatus, U16, st.sampled_from(State), U8.map(lambda n: n / 255), U8.map(lambda n: n / 255)),
    st.builds(CommandPacket, st.sampled_from(sorted(PLAIN)), U16),
    st.builds(HoverAt, U16, U8.map(lambda n: n / 4)),
    st.builds(SleepSchedule, U16, U32, U32),
    st.builds(SlotAssignment, U16, U32, U32, U16, U16, st.integers(-(2**31), 2**31 - 1)),
    st.builds(SetThreshold, U16, st.sampled_from(Threshold), CHARGES),
    st.builds(Beacon, U16, st.integers(0, 2**64 - 1)),
    st.builds(LogAck, U16, U32),
    st.builds(log_records, U16, st.integers(0, 2**31), U8, st.lists(RECORDS, max_size=5)),
)


@given(PACKETS)
def test_round_trip(packet: Packet) -> None:
    assert decode(packet.encode()) == packet


@pytest.mark.parametrize("name", GOLDEN)
def test_every_single_bit_error_is_detected(name: str) -> None:
    data = golden(name)
    for bit in range(8 * len(data)):
        harmed = bytearray(data)
        harmed[bit // 8] ^= 1 << bit % 8
        assert decode(bytes(harmed)) is None, f"bit {bit}"


def test_every_error_of_two_bits_in_seven_bytes_is_detected() -> None:
    whole = int.from_bytes(golden("SHORT_STATUS"))
    for one in range(56):
        for other in range(one):
            assert decode((whole ^ 1 << one ^ 1 << other).to_bytes(7)) is None, (one, other)


@given(st.binary(max_size=80))
def test_any_bytes_decode_to_a_packet_or_to_nothing(data: bytes) -> None:
    packet = decode(data)
    assert packet is None or packet.encode() == data


@given(
    st.binary(max_size=80),
    st.sampled_from([(1, kind) for kind in range(8)] + [(2, kind) for kind in range(18)]),
)
def test_any_bytes_with_a_right_check_decode_to_a_packet_or_to_nothing(
    data: bytes, head: tuple[int, int]
) -> None:
    sealed = checked(bytes(head) + data)
    packet = decode(sealed)
    assert packet is None or packet.encode() == sealed


@pytest.mark.parametrize("kind", [0, 6, 255])
def test_an_unknown_kind_with_a_right_checksum_is_nothing(kind: int) -> None:
    assert decode(checked(bytes([1, kind, 5, 0]))) is None


@pytest.mark.parametrize("name", [name for name in GOLDEN if name != "SHORT_STATUS"])
def test_a_later_version_of_a_kind_is_nothing_to_this_one(name: str) -> None:
    body = bytes.fromhex(GOLDEN[name][1])
    assert decode(checked(bytes([3]) + body[1:])) is None


@pytest.mark.parametrize(
    ("name", "at", "value"),
    [
        ("STATUS", 6, 200),  # a state
        ("ACOUSTIC_STATUS", 6, 200),
        ("WIFI_STATUS", 55 + 2 * FURTHER, 3),  # a reset cause
        ("WIFI_STATUS", 56 + 2 * FURTHER, 3),  # a feeding battery
        ("SHORT_STATUS", 0, 0b101_11111),
        ("SET_THRESHOLD", 4, 3),
    ],
)
def test_a_value_that_there_is_not_with_a_right_checksum_is_nothing(name: str, at: int, value: int) -> None:
    body = bytearray(bytes.fromhex(GOLDEN[name][1]))
    assert decode(checked(bytes(body))) is not None
    body[at] = value
    assert decode(checked(bytes(body))) is None


def test_a_harmed_record_in_an_unharmed_packet_is_nothing() -> None:
    body = bytearray(bytes.fromhex(GOLDEN["LOG_RECORDS"][1]))
    body[20] ^= 1
    assert decode(checked(bytes(body))) is None


@pytest.mark.parametrize(
    ("oldest", "first", "covered", "sequences"),
    [(5, 4, 2, [5]), (3, 4, 2, [3]), (3, 4, 2, [6]), (3, 4, 2, [5, 4]), (3, 4, 2, [5, 5]), (3, 4, 0, [4])],
)
def test_records_outside_what_a_packet_covers_are_nothing(
    oldest: int, first: int, covered: int, sequences: list[int]
) -> None:
    records = tuple(replace(RECORD, sequence=sequence) for sequence in sequences)
    assert decode(LogRecords.of(5, oldest, first, covered, records).encode()) is None
