"""Values that cross a sea's link come out as they went in, and foreign bytes are refused."""

from __future__ import annotations

from collections import Counter

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.coordinator import AgentDied
from agents.modem.frames import FrameKind, ModemFrame
from agents.mussel.outputs import SoundSent
from agents.mussel.stimuli import ContactClosed, SoundArrived, WasReset
from agents.water import sea_link
from agents.water.medium import PacketEnded, PacketOutcome, Reception
from agents.water.places import ModemPlace
from agents.water.sea_link import CODEC, SeaMessage, StationCall, Tick, Ticked, Window, Windowed
from agents.water.topology import LinkRule, Topology
from firmware_model.stimuli import ResetCause

RECEPTIONS = (
    Reception(4, 7, PacketOutcome.RECEIVED, 12.5, 40),
    Reception(5, 8, PacketOutcome.COLLIDED, None, 90),
)
FRAME = ModemFrame(FrameKind(1), 3, 255, b"\x00\xff")
MESSAGES: tuple[SeaMessage, ...] = (
    Window(60_000, None, ((3, 59_999, ContactClosed(-5, 7)), (4, 60_000, SoundArrived(b"")))),
    Windowed(
        (
            SoundSent(60, 3, b"hello"),
            AgentDied(2, 4, 90, ResetCause.WATCHDOG, "it stood still", None),
        ),
        (),
        2**62,
    ),
    Ticked(
        (PacketEnded(3, 1, FRAME, None, RECEPTIONS), SoundSent(60, 3, b"")),
        ((4, 5, WasReset(2)),),
        {0: ModemPlace(1, 2, 3, in_water=True), -1: None},
        Counter({"sound: no place": 3}),
    ),
)


@pytest.mark.parametrize("message", MESSAGES, ids=lambda it: type(it).__name__)
def test_a_message_comes_out_as_it_went_in(message: SeaMessage) -> None:
    out = CODEC.decode(CODEC.encode(message))
    assert out == message and type(out) is type(message)
    assert repr(out) == repr(message)  # members of enumerations are no bare numbers


def test_a_topology_comes_out_with_its_rules() -> None:
    rules = (LinkRule(None, 3, 0.5), LinkRule(0, None, 1.0, 5, 9))
    sent = Tick(
        1_000,
        (StationCall("set_topology", (Topology(rules),)), StationCall("send_sound", (None, b"x", 0))),
        (),
        3,
    )
    out = CODEC.decode(CODEC.encode(sent))
    assert out.calls[0].arguments[0].rules == rules and out.calls[1] == sent.calls[1]


def test_the_classes_of_a_link_are_the_benchs_own() -> None:
    rooms = {kind.__module__.partition(".")[0] for kind in CODEC._kinds}
    assert rooms == {"agents", "firmware_model", "collections"} and len(CODEC._kinds) < 128
    assert not hasattr(sea_link, "pickle")


@given(
    data=st.binary(max_size=80)
    | st.integers(0, 127).map(lambda it: msgpack.packb(msgpack.ExtType(it, b"\x90")))
)
def test_foreign_bytes_are_a_value_error_or_no_message(data: bytes) -> None:
    try:
        value = CODEC.decode(data)
    except ValueError:
        return
    assert not isinstance(value, Window | Windowed | Tick | Ticked)
