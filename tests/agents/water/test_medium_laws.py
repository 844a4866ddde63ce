"""Laws of the medium: no cut of time and no order of ties changes anything; a second implementation agrees."""

from __future__ import annotations

import random
from itertools import pairwise
from math import dist, log10

from hypothesis import given, settings
from hypothesis import strategies as st

from agents.modem.frames import FrameKind, ModemFrame
from agents.water.medium import (
    Began,
    FrameHeard,
    MediumResult,
    ModemMoved,
    PacketEnded,
    PacketOutcome,
    WaterMedium,
)
from agents.water.places import ModemPlace
from agents.water.sound import Sound

NODES = 24
QUIET = Sound(absorption_db_per_km=6, noise_db_per_hz=-100, reverberation_s=0.04, reverberation_db=8)
Sent = tuple[int, int, int | None]
"""(begin, sender, destination)"""


def places(seed: int, side_m: float, nodes: int = NODES) -> dict[int, tuple[float, float, float]]:
    draw = random.Random(seed)
    return {
        node: (
            round(draw.uniform(0, side_m), 3),
            round(draw.uniform(0, side_m), 3),
            round(draw.uniform(1, 20), 3),
        )
        for node in range(nodes)
    }


def filled(sound: Sound, where: dict[int, tuple[float, float, float]]) -> WaterMedium:
    medium = WaterMedium(sound, 7, [(node, node % 256) for node in where])
    for node, (north_m, east_m, depth_m) in where.items():
        medium.receive(
            ModemMoved(node, ModemPlace(*(round(1e6 * it) for it in (north_m, east_m, depth_m)))), 0
        )
    return medium


def frame(sender: int, destination: int | None) -> ModemFrame:
    if destination is None:
        return ModemFrame(FrameKind.BROADCAST, sender % 256, None, bytes(16))
    return ModemFrame(FrameKind.UNICAST, sender % 256, destination % 256, bytes(16))


def flown(medium: WaterMedium, sent: list[Sent], cuts_ms: list[int], end_ms: int) -> list[MediumResult]:
    results: list[MediumResult] = []
    for at_ms, packet in sorted(
        [(it[0], it) for it in sent] + [(cut, None) for cut in cuts_ms],
        key=lambda it: (it[0], it[1] is not None),
    ):
        if packet is None:
            results += medium.advance(at_ms)
        else:
            results += medium.receive(Began(packet[1], frame(packet[1], packet[2])), at_ms)
    return results + medium.advance(end_ms)


traffic = st.lists(
    st.tuples(st.integers(0, 5000), st.integers(0, NODES - 1), st.none() | st.integers(0, NODES - 1)).filter(
        lambda it: it[1] != it[2]
    ),
    max_size=25,
    unique_by=lambda it: (it[0], it[1]),
).map(sorted)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 9), traffic, st.lists(st.integers(0, 9000), max_size=12))
def test_cutting_time_changes_nothing(seed: int, sent: list[Sent], cuts_ms: list[int]) -> None:
    where = places(seed, 900.0)
    sound = Sound(fading_db=6, reverberation_s=0.04)
    whole = flown(filled(sound, where), sent, [], 20_000)
    assert flown(filled(sound, where), sent, cuts_ms, 20_000) == whole


def by_packet(results: list[MediumResult]) -> dict[tuple[int, int], PacketEnded]:
    return {(it.began_ms, it.sender): it for it in results if isinstance(it, PacketEnded)}


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 9), traffic, st.randoms(use_true_random=False))
def test_the_order_of_ties_changes_nothing(seed: int, sent: list[Sent], draw: random.Random) -> None:
    where = places(seed, 900.0)
    shuffled = sorted(draw.sample(sent, len(sent)), key=lambda it: it[0])
    first = by_packet(flown(filled(Sound(fading_db=6), where), sent, [], 20_000))
    assert by_packet(flown(filled(Sound(fading_db=6), where), shuffled, [], 20_000)) == first


def judged_by_hand(
    where: dict[int, tuple[float, float, float]], sent: list[Sent]
) -> dict[tuple[int, int, int], PacketOutcome]:
    """(begin, sender, receiver): every pair and every other packet, straight from the definitions."""
    lasting_ms = 505
    on_air: list[Sent] = []
    for packet in sent:
        if not any(other[1] == packet[1] and other[0] + lasting_ms > packet[0] for other in on_air):
            on_air.append(packet)
    found = {}

    def arrives_ms(sender: int, receiver: int) -> int:
        return -(-round(1e6 * dist(where[sender], where[receiver]) / 1500) // 1000)

    def power(sender: int, receiver: int) -> float:
        metres = max(1.0, dist(where[sender], where[receiver]))
        return float(10 ** ((168 - 20 * log10(metres) - 0.006 * metres) / 10))

    for began_ms, sender, destination in on_air:
        for receiver in where if destination is None else [destination]:
            if receiver == sender:
                continue
            from_ms = began_ms + arrives_ms(sender, receiver)
            until_ms = from_ms + lasting_ms
            others, talks = 0.0, False
            for other_ms, other, _ in on_air:
                if (other_ms, other) == (began_ms, sender):
                    continue
                if other == receiver:
                    talks |= other_ms < until_ms and other_ms + lasting_ms > from_ms
                    continue
                other_from_ms = other_ms + arrives_ms(other, receiver)
                other_until_ms = other_from_ms + lasting_ms
                if other_from_ms < until_ms and other_until_ms > from_ms:
                    others += power(other, receiver)
                elif other_from_ms < until_ms and other_until_ms + 40 > from_ms:
                    others += power(other, receiver) / 10**0.8
            if talks:
                outcome = PacketOutcome.TRANSMITTING
            elif others and power(sender, receiver) / others < 10**0.6:
                outcome = PacketOutcome.COLLIDED
            else:
                outcome = PacketOutcome.RECEIVED
            found[began_ms, sender, receiver] = outcome
    return found


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 99), traffic)
def test_24_modems_are_judged_as_by_another_implementation(seed: int, sent: list[Sent]) -> None:
    where = places(seed, 1500.0)
    ended = [it for it in flown(filled(QUIET, where), sent, [], 30_000) if isinstance(it, PacketEnded)]
    judged = {
        (it.began_ms, it.sender, reception.receiver): reception.outcome
        for it in ended
        for reception in it.receptions
    }
    assert judged == judged_by_hand(where, sent)


def test_culling_by_cells_leaves_out_nobody_within_the_limit() -> None:
    """300 modems over 4 x 4 km, one after another: the medium decides at those within 600 m, and nowhere else."""
    where = places(3, 4000.0, 300)
    sound = Sound(noise_db_per_hz=-100, range_limit_m=600)
    medium = filled(sound, where)
    for sender in range(0, 300, 10):
        results = medium.receive(Began(sender, frame(sender, None)), sender * 1000)
        results += medium.advance(sender * 1000 + 9999)
        (ended,) = (it for it in results if isinstance(it, PacketEnded))
        near = {node for node in where if node != sender and dist(where[node], where[sender]) <= 600}
        assert {it.receiver for it in ended.receptions} == near
        assert {it.reception.receiver for it in results if isinstance(it, FrameHeard)} == near


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 99), traffic)
def test_results_come_in_the_order_of_time(seed: int, sent: list[Sent]) -> None:
    heard = [
        it for it in flown(filled(QUIET, places(seed, 900.0)), sent, [], 30_000) if isinstance(it, FrameHeard)
    ]
    assert all(one.reception.at_ms <= other.reception.at_ms for one, other in pairwise(heard))
