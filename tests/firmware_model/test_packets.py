"""The wire layout: golden bytes worked out by hand, round trips, and that no single flipped bit goes unseen."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.packets import CommandPacket, Kind, StatusPacket, decode
from firmware_model.states import State

STATUS = StatusPacket(24, 7, State.FLOATING, 0.5, 1.0, 12.34, -5.0, 3.0, 1_800_000)

GOLDEN_STATUS_BODY = (
    "01" "01" "1800" "0700" "04" "0080" "ffff" "d2040000" "0cfeffff" "2c01" "40771b0000000000"
)  # fmt: skip


def crc16_ccitt(data: bytes) -> int:
    """CRC-16/CCITT-FALSE bit by bit: polynomial 0x1021, start 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
            crc &= 0xFFFF
    return crc


def test_crc_has_the_published_check_value() -> None:
    assert crc16_ccitt(b"123456789") == 0x29B1


def test_golden_status() -> None:
    body = bytes.fromhex(GOLDEN_STATUS_BODY)
    assert STATUS.encode() == body + struct.pack("<H", crc16_ccitt(body))
    assert len(STATUS.encode()) <= 64  # what a v3 nanomodem carries


def test_golden_command() -> None:
    body = bytes.fromhex("01020500")
    assert CommandPacket(Kind.PERMISSION, 5).encode() == body + struct.pack("<H", crc16_ccitt(body))
    assert len(CommandPacket(Kind.RELEASE, 1).encode()) <= 7  # what a v2 nanomodem carries


@given(
    st.integers(0, 65535),
    st.integers(0, 65535),
    st.sampled_from(State),
    st.integers(0, 65535),
    st.integers(0, 65535),
    st.integers(-(2**31), 2**31 - 1),
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 65535),
    st.integers(0, 2**63),
)
def test_status_round_trip(
    agent_id: int,
    sequence: int,
    state: State,
    primary: int,
    secondary: int,
    north_cm: int,
    east_cm: int,
    depth_cm: int,
    agent_ms: int,
) -> None:
    packet = StatusPacket(
        agent_id,
        sequence,
        state,
        primary / 65535,
        secondary / 65535,
        north_cm / 100,
        east_cm / 100,
        depth_cm / 100,
        agent_ms,
    )
    assert decode(packet.encode()) == packet


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.STATUS])
def test_command_round_trip(kind: Kind) -> None:
    packet = CommandPacket(kind, 65535)
    assert decode(packet.encode()) == packet


@pytest.mark.parametrize("packet", [STATUS, CommandPacket(Kind.RELEASE, 300)])
def test_every_single_bit_error_is_detected(packet: StatusPacket | CommandPacket) -> None:
    data = packet.encode()
    for bit in range(8 * len(data)):
        harmed = bytearray(data)
        harmed[bit // 8] ^= 1 << bit % 8
        assert decode(bytes(harmed)) is None, f"bit {bit}"


@given(st.binary(max_size=80))
def test_any_bytes_decode_to_a_packet_or_to_nothing(data: bytes) -> None:
    packet = decode(data)
    assert packet is None or packet.encode() == data


@pytest.mark.parametrize("kind", [0, 6, 255])
def test_an_unknown_kind_with_a_right_checksum_is_nothing(kind: int) -> None:
    body = bytes([1, kind, 5, 0])
    assert decode(body + struct.pack("<H", crc16_ccitt(body))) is None


def test_an_unknown_state_with_a_right_checksum_is_nothing() -> None:
    body = bytearray(bytes.fromhex(GOLDEN_STATUS_BODY))
    body[6] = 200
    assert decode(bytes(body) + struct.pack("<H", crc16_ccitt(bytes(body)))) is None
