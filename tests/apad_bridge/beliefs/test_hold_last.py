import json
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from apad_bridge.beliefs.hold_last import HoldLast
from apad_bridge.beliefs.measurement import Docked, Permitted, Released, TimeslotSilent
from firmware_model.packets import ShortStatus, StatusPacket
from firmware_model.states import State

PACKET = StatusPacket(5, 0, State.ACTIVE, 0.7, 1.0, 3.0, 4.0, 3.0, 60_000)


def test_it_believes_the_newest_packet_with_its_depth() -> None:
    """A short status has no depth, an overtaken packet changes nothing, and another supervisor goes on with it."""
    beliefs, found = HoldLast([5, 6]), []
    assert beliefs.get(5) is None
    for hear in (
        lambda: beliefs.hear(PACKET, 2000),
        lambda: beliefs.hear_short(ShortStatus(5, State.ACTIVE, 0.65, 1.0), 2500),
        lambda: beliefs.hear(replace(PACKET, primary=0.6, depth_m=1.25, agent_ms=90_000), 3000),
        lambda: beliefs.hear(PACKET, 4000),
        lambda: beliefs.restore(json.loads(json.dumps(beliefs.kept()))),
    ):
        hear()
        it = beliefs.get(5)
        found.append((it.primary, it.heard_ms, it.reported.depth_m))
    assert found == [(0.7, 2000, 3.0), (0.65, 2500, 3.0), *[(0.6, 3000, 1.25)] * 3]
    assert [it.agent_id for it in beliefs.all()] == [5] and beliefs.get(5).age_s(5500) == 2.5


@pytest.mark.parametrize(
    ("packet", "reason"),
    [
        (replace(PACKET, agent_id=7), "unknown aMussel"),
        (replace(PACKET, north_m=math.nan), "north_m is outside"),
        (replace(PACKET, east_m=math.inf), "east_m is outside"),
        (replace(PACKET, depth_m=1e308), "depth_m is outside"),
        (replace(PACKET, primary=1.01), "outside"),
        (replace(PACKET, secondary=-0.01), "outside"),
        (replace(PACKET, agent_ms=59_999), "overtook"),
    ],
)
def test_what_it_does_not_believe_changes_nothing(packet: StatusPacket, reason: str) -> None:
    beliefs = HoldLast([5])
    beliefs.hear(PACKET, 2000)
    before = beliefs.all()
    assert reason in beliefs.hear(packet, 3000)
    assert beliefs.all() == before


@given(st.permutations(range(6)))
def test_the_order_of_arrival_does_not_matter(order: list[int]) -> None:
    beliefs = HoldLast([5])
    for n in order:
        beliefs.hear(replace(PACKET, primary=n / 10, agent_ms=1000 * n), 10_000)
    assert beliefs.get(5).primary == 0.5


def test_it_learns_from_packets_alone_and_stays_as_it_was() -> None:
    beliefs = HoldLast([5])
    assert beliefs.learn(5, TimeslotSilent(), 500) is None and beliefs.get(5) is None
    beliefs.hear(PACKET, 2000)
    before = beliefs.get(5)
    measurements = (TimeslotSilent(), 2500), (Permitted(), 2500), (Docked(), 2600), (Released(0.0, 0.0), 2700)
    assert [beliefs.learn(5, *it) for it in measurements] == [None] * 4
    beliefs.advance(90_000)
    assert beliefs.get(5) is before
    with pytest.raises(ValueError):
        beliefs.advance(89_999)


def test_a_short_status_says_the_state_and_the_charges_of_one_whose_place_is_known() -> None:
    beliefs = HoldLast([5, 6])
    short = ShortStatus(5, State.EMPTY, 0.0, 0.8)
    reason = "a short status of an aMussel whose place is not known"
    assert beliefs.hear_short(short, 1000) == reason and beliefs.all() == []
    beliefs.hear(PACKET, 2000)
    assert beliefs.hear_short(short, 3000) is None
    it = beliefs.get(5)
    found = it.state, it.primary, it.secondary, it.heard_ms, it.north_m, it.east_m
    assert found == (State.EMPTY, 0.0, 0.8, 3000, 3.0, 4.0)
