"""Frames against the figures of the manual, by hand."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from agents.modem.frames import FrameKind, ModemFrame, ModemGeneration, duration_ms


@pytest.mark.parametrize(
    ("payload_bytes", "manual_ms"), [(2, 330), (8, 405), (16, 505), (32, 705), (64, 1105)]
)
def test_data_last_as_long_as_the_manual_says(payload_bytes: int, manual_ms: int) -> None:
    assert ModemFrame(FrameKind.BROADCAST, 1, None, bytes(payload_bytes)).duration_ms == manual_ms
    assert ModemFrame(FrameKind.UNICAST, 1, 2, bytes(payload_bytes)).duration_ms == manual_ms


@pytest.mark.parametrize(
    "kind", [FrameKind.PING, FrameKind.ACK, FrameKind.PING_REPLY, FrameKind.STATUS_REQUEST]
)
def test_a_frame_without_data_is_a_chirp_and_a_header(kind: FrameKind) -> None:
    assert ModemFrame(kind, 1, 2).duration_ms == 30 + 75


def test_half_milliseconds_are_rounded_up() -> None:
    # 105 + (31 + 16) * 12.5 = 692.5
    assert duration_ms(ModemGeneration.V3, 31) == 693


def test_a_v2_frame_needs_200_ms_for_a_byte() -> None:
    seven = ModemFrame(FrameKind.UNICAST, 1, 2, b"7 bytes", ModemGeneration.V2)
    one = ModemFrame(FrameKind.UNICAST, 1, 2, b"1", ModemGeneration.V2)
    assert seven.duration_ms - one.duration_ms == 6 * 8 * 1000 // 40


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: ModemFrame(FrameKind.BROADCAST, 1, 2, b"ab"),
        lambda: ModemFrame(FrameKind.PING, 1),
        lambda: ModemFrame(FrameKind.PING, 256, 1),
        lambda: ModemFrame(FrameKind.PING, 1, -1),
        lambda: ModemFrame(FrameKind.PING, 1, 2, b"ab"),
        lambda: ModemFrame(FrameKind.UNICAST, 1, 2, b"a"),
        lambda: ModemFrame(FrameKind.UNICAST, 1, 2, bytes(65)),
        lambda: ModemFrame(FrameKind.UNICAST, 1, 2, bytes(8), ModemGeneration.V2),
        lambda: ModemFrame(FrameKind.ECHO_REQUEST, 1, 2, b"ab", ModemGeneration.V2),
        lambda: ModemFrame(FrameKind.PING, 1, 2, flight_us=1),
    ],
)
def test_a_frame_that_no_modem_can_send_is_refused(wrong: Callable[[], ModemFrame]) -> None:
    with pytest.raises(ValueError, match=r"^an? |^V2"):
        wrong()


def test_who_takes_it() -> None:
    assert ModemFrame(FrameKind.PING, 1, 2).is_for(2)
    assert not ModemFrame(FrameKind.PING, 1, 2).is_for(3)
    assert ModemFrame(FrameKind.BEACON, 1).is_for(3)
