"""A rack of modems acts like each of its modems alone."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.modem.facts import FrameArrived, FrameRequested, ModemStimulus, SerialBytes
from agents.modem.frames import FrameKind, ModemFrame
from agents.modem.modem import Modem
from agents.modem.modem_model import ModemConfig
from agents.modem.rack import Rack

NODES = {1: 1, 2: 2, 7: 7}
STIMULI: list[ModemStimulus] = [
    FrameRequested(ModemFrame(FrameKind.PING, 1, 9)),
    FrameRequested(ModemFrame(FrameKind.BROADCAST, 1, None, b"abc")),
    FrameArrived(ModemFrame(FrameKind.PING, 9, 2)),
    FrameArrived(ModemFrame(FrameKind.STATUS_REQUEST, 9, 7)),
    FrameArrived(ModemFrame(FrameKind.BROADCAST, 9, None, b"abc")),
]


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.one_of(
            st.tuples(st.integers(0, 900), st.sampled_from(sorted(NODES)), st.sampled_from(STIMULI)),
            st.tuples(
                st.integers(0, 900), st.just(7), st.sampled_from([SerialBytes(b"$P001"), SerialBytes(b"$")])
            ),
        ),
        max_size=12,
    )
)
def test_a_rack_is_its_modems(told: list[tuple[int, int, ModemStimulus]]) -> None:
    rack = Rack(ModemConfig(), NODES, opened=[7])
    alone = {node: Modem(ModemConfig(lines=int(node == 7)), address) for node, address in NODES.items()}
    together: list[tuple[int, Any]] = []
    apart: dict[int, list[Any]] = {node: [] for node in NODES}
    at_ms = 0
    for after_ms, node, stimulus in told:
        at_ms += after_ms
        together += rack.receive(node, stimulus, at_ms)
        apart[node] += alone[node].receive(stimulus, at_ms)
    together += rack.advance(20_000)
    assert rack.next_due_ms is None
    for node, modem in alone.items():
        assert [action for who, action in together if who == node] == apart[node] + modem.advance(20_000)
    times = [action.at_ms for _, action in together]
    assert times == sorted(times)


def test_time_does_not_go_back() -> None:
    rack = Rack(ModemConfig(), NODES, opened=[])
    rack.advance(5)
    with pytest.raises(ValueError, match="went back"):
        rack.advance(4)


def test_only_opened_modems_have_a_line() -> None:
    rack = Rack(ModemConfig(), NODES, opened=[7])
    assert [len(rack[node].lines) for node in NODES] == [0, 0, 1]
