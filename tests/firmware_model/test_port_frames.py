"""The frames of the port: bytes by hand, any payload, damage, and the board's counter."""

from __future__ import annotations

from binascii import crc_hqx

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_model.port_frames import (
    COUNTER_HZ,
    MAX_PAYLOAD,
    BadFrame,
    Frame,
    FrameReader,
    _stuffed,
    _unstuffed,
    alarm_ms,
    counter_at,
)

FRAMES = st.builds(
    Frame,
    st.integers(0, 255),
    st.integers(0, 255),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**32 - 1),
    st.binary(max_size=MAX_PAYLOAD),
)


def test_a_frame_s_bytes_by_hand() -> None:
    """Head 42 03 0100 00800000 05000000, payload 01, CRC; each zero replaced by the distance to the next (COBS)."""
    body = bytes.fromhex("42 03 01 00 00 80 00 00 05 00 00 00 01".replace(" ", ""))
    check = crc_hqx(body, 0xFFFF).to_bytes(2, "little")
    assert 0 not in check
    by_hand = bytes.fromhex("04420301 01 0280 01 0205 01 01".replace(" ", "")) + b"\x04\x01" + check + b"\0"
    assert Frame(0x42, 3, 0x8000, 5, b"\1").encode() == by_hand


@pytest.mark.parametrize(
    ("data", "encoded"),
    [
        (b"", "01"),
        (b"\0\0", "01 01 01"),
        (b"\x11\x22\0\x33", "03 11 22 02 33"),
        (b"\x11\0\0\0", "02 11 01 01 01"),
        (bytes(range(1, 256)), f"ff {bytes(range(1, 255)).hex()} 02 ff"),
        (bytes([*range(2, 256), 0]), f"ff {bytes(range(2, 256)).hex()} 01 01"),
        (bytes([*range(3, 256), 0, 1]), f"fe {bytes(range(3, 256)).hex()} 02 01"),
    ],
)
def test_blocks_are_those_of_the_published_examples_of_cobs(data: bytes, encoded: str) -> None:
    """The examples: https://en.wikipedia.org/wiki/Consistent_Overhead_Byte_Stuffing"""
    assert _stuffed(data) == bytes.fromhex(encoded)
    assert _unstuffed(bytes.fromhex(encoded)) == data


def test_a_full_block_at_the_end_may_have_an_empty_one_behind_it_or_not() -> None:
    """The published example has none there; ours has, and both are COBS of the same bytes."""
    data = bytes(range(1, 255))
    assert _stuffed(data) == b"\xff" + data + b"\1"
    assert _unstuffed(b"\xff" + data) == _unstuffed(b"\xff" + data + b"\1") == data


@given(st.lists(FRAMES, max_size=5), st.lists(st.integers(1, 50), min_size=1, max_size=20))
def test_frames_survive_any_cut_of_the_stream(frames: list[Frame], cuts: list[int]) -> None:
    stream = b"\0" + b"".join(frame.encode() for frame in frames)
    reader, found, turn = FrameReader(), [], 0
    while stream:
        size, turn = cuts[turn % len(cuts)], turn + 1
        found += reader.feed(stream[:size])
        stream = stream[size:]
    assert found == frames


@given(FRAMES, st.data())
def test_a_damaged_frame_is_refused_and_the_next_one_is_read(frame: Frame, data: st.DataObject) -> None:
    encoded = bytearray(frame.encode())
    at = data.draw(st.integers(0, len(encoded) - 2))
    encoded[at] ^= data.draw(st.integers(1, 255).filter(lambda it: it != encoded[at]))
    reader = FrameReader()
    with pytest.raises(BadFrame):
        list(reader.feed(bytes(encoded)))
    assert list(reader.feed(frame.encode())) == [frame]


def test_a_frame_without_an_end_is_refused() -> None:
    reader = FrameReader()
    with pytest.raises(BadFrame, match="without an end"):
        list(reader.feed(b"\1" * 2000))


@given(st.integers(0, 40 * 365 * 86_400_000), st.integers(0, 64_000_000))
def test_an_alarm_after_whole_milliseconds_rings_in_that_millisecond(now_ms: int, after_ms: int) -> None:
    counter = (counter_at(now_ms) + after_ms * COUNTER_HZ // 1000) % 2**32
    assert alarm_ms(counter, now_ms) == now_ms + after_ms


@given(st.integers(0, 2**40), st.integers(1, 2**31))
def test_an_alarm_in_the_past_rings_at_once(now_ms: int, behind: int) -> None:
    assert alarm_ms((counter_at(now_ms) - behind) % 2**32, now_ms) == now_ms
