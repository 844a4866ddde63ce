"""Two flights in one sea: who hears whom, who collides with whom, and two far apart that fly as if each were alone."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from seas import FLEET, SEA
from shared_seas import ASKED, DISTURBED, THETA, Asked, Flown, command, joined, played

from agents.mussel.outputs import Truth
from agents.mussel.stimuli import SoundArrived
from agents.time_scale import TimeScale
from agents.water.medium import PacketOutcome
from agents.water.sea import Sea, SeaConfig
from agents.water.sea_events import AgentRanged, SoundReached, StimulusDelivered
from agents.water.topology import LinkRule, Topology
from firmware_model.packets import AcousticStatus, Kind
from firmware_model.packets.codec import MusselbedCodec

HOUR_MS = 3_600_000
FRAME_MS = 105 + 22 * 25 // 2
"""A command's 6 bytes: a chirp and a header of 105 ms, and 12.5 ms for each of 6 + 16."""


def two(
    first: tuple[float, dict[int, float]], second: tuple[float, dict[int, float]], sea: SeaConfig = SEA
) -> tuple[Flown, Flown]:
    """Two flights in one sea, each with the place of its aPad and of its aMussels."""
    shared = Sea(sea, FLEET.time_scale, (1, 2, 3, 4), apads=2)
    one, other = (joined(shared, norths_m, apad_m) for apad_m, norths_m in (first, second))
    return one, other


def run(flights: tuple[Flown, ...], from_ms: int, until_ms: int) -> None:
    for now_ms in range(from_ms, until_ms + 1, 1000):
        for it in flights:
            it.advance(now_ms)


@pytest.fixture
def flights() -> tuple[Flown, Flown]:
    return two((0.0, {1: 150.0}), (400.0, {2: 350.0}))


@pytest.mark.parametrize(
    ("later_ms", "outcome"),
    [
        (-448, "received"),
        (-447, "received"),
        (-446, "collided"),
        (0, "collided"),
        (312, "collided"),
        (313, "received"),
    ],
)
def test_two_aPads_collide_where_their_packets_overlap(
    flights: tuple[Flown, Flown], later_ms: int, outcome: str
) -> None:
    """aMussel 1 is 150 m from its aPad and 250 m from the other one: 100 and 167 ms. Packets last 380 ms.

    Its packet is there from 100 to 480 ms, the other one from 167 to 547 ms after it began. They overlap if the other
    begins less than 480 - 167 = 313 ms later and less than 547 - 100 = 447 ms earlier. It is 20 log10(250 / 150) + 0.6 =
    5 dB louder, which is less than the 6 dB of a capture.
    """
    run(flights, 0, 99_000)
    for it, agent_id, at_ms in zip(flights, (1, 2), (110_000, 110_000 + later_ms), strict=True):
        it.station.send_sound(agent_id, command(Kind.HOVER, agent_id), at_ms)
    run(flights, 100_000, 120_000)
    assert flights[0].outcomes()[0, 110_000] == [(1, PacketOutcome[outcome.upper()])]
    told = [it.agent_ms for it in flights[0].of(StimulusDelivered) if isinstance(it, StimulusDelivered)]
    assert told == ([110_000 + FRAME_MS + 100] if outcome == "received" else [])


def test_each_aPad_hears_every_fleet_once(flights: tuple[Flown, Flown]) -> None:
    """The slots of aMussels 1 and 2 begin at 3900 and 3905 s, a status lasts 868 ms, and 1500 m take a second."""
    run(flights, 0, HOUR_MS + 400_000)
    for it, delays_ms in zip(flights, ((100, 234), (167, 34)), strict=True):
        heard = [reached for reached in it.of(SoundReached) if isinstance(reached, SoundReached)]
        assert [(reached.mission_ms, reached.agent_id) for reached in heard] == [
            (3_900_868 + delays_ms[0], 1),
            (3_905_868 + delays_ms[1], 2),
        ]
        statuses = [MusselbedCodec().decode(reached.data) for reached in heard]
        assert [it.agent_id for it in statuses if isinstance(it, AcousticStatus)] == [1, 2]
    # A packet is recorded by the flight that it began beside: that flight's aPad is 0, the n-th aPad otherwise -n.
    assert flights[0].outcomes() == {
        (1, 3_900_000): [(0, PacketOutcome.RECEIVED), (-2, PacketOutcome.RECEIVED)]
    }
    assert flights[1].outcomes() == {
        (2, 3_905_000): [(0, PacketOutcome.RECEIVED), (-1, PacketOutcome.RECEIVED)]
    }


def test_a_range_is_told_to_the_aPad_that_asked(flights: tuple[Flown, Flown]) -> None:
    run(flights, 0, 100_000)
    flights[0].station.ping(2)
    run(flights, 101_000, 110_000)
    (ranged,) = flights[0].of(AgentRanged)
    assert isinstance(ranged, AgentRanged) and ranged.agent_id == 2
    assert ranged.range_m == pytest.approx(350.0, abs=0.024)
    assert (
        flights[1].of(AgentRanged) == []
        and not flights[0].station.all_dropped
        and not flights[1].station.all_dropped
    )


def test_an_aPad_speaks_to_another_fleets_aMussel(flights: tuple[Flown, Flown]) -> None:
    """As to one that was handed on to it: the stimulus is recorded where the aMussel is simulated."""
    run(flights, 0, 100_000)
    flights[0].station.send_sound(2, command(Kind.HOVER, 2))
    run(flights, 101_000, 110_000)
    at_ms = 100_000 + FRAME_MS + 234
    assert flights[1].of(StimulusDelivered) == [
        StimulusDelivered(at_ms, 2, at_ms, SoundArrived(command(Kind.HOVER, 2)))
    ]
    assert flights[0].of(StimulusDelivered) == []


def test_a_flight_that_has_ended_neither_sends_nor_hears(flights: tuple[Flown, Flown]) -> None:
    run(flights, 0, 100_000)
    left, stays = flights
    # One packet to it and one of its own are under way when it leaves.
    stays.station.send_sound(1, command(Kind.HOVER, 1), 100_990)
    left.station.send_sound(2, command(Kind.HOVER, 9), 100_400)
    run(flights, 101_000, 101_000)
    left.station.leave()
    run((stays,), 102_000, HOUR_MS + 400_000)
    assert stays.outcomes()[0, 100_990] == [(1, PacketOutcome.IN_AIR)]
    # What had left its modem goes on its way, and nothing begins any more: not in its aMussel's slot either.
    assert [it.agent_ms for it in stays.of(StimulusDelivered) if isinstance(it, StimulusDelivered)] == [
        101_014
    ]
    assert [it.agent_id for it in stays.of(SoundReached) if isinstance(it, SoundReached)] == [2]
    assert [it for it in stays.outcomes()[2, 3_905_000] if it[0] < 0] == []


def test_flights_out_of_step_are_refused() -> None:
    one, other = two((0.0, {1: 150.0}), (400.0, {2: 350.0}))
    one.advance(1000)
    with pytest.raises(ValueError, match="out of step"):
        one.advance(2000)
    with pytest.raises(ValueError, match="out of step"):
        other.advance(2000)
    other.advance(1000)
    one.advance(2000)
    with pytest.raises(ValueError, match="time went back"):
        other.advance(1000)


def test_a_rule_for_the_aPad_holds_for_each(flights: tuple[Flown, Flown]) -> None:
    flights[0].station.set_topology(Topology([LinkRule(1, 0, 1.0)]))
    run(flights, 0, HOUR_MS + 400_000)
    assert [
        [it.agent_id for it in each.of(SoundReached) if isinstance(it, SoundReached)] for each in flights
    ] == [
        [2],
        [2],
    ]


FAR_M = 20_000.0
"""Beyond the range of sound, 5 km, and of Wi-Fi."""


def without_order(flown: Flown) -> tuple[list[str], list[Truth], list[bool]]:
    truths = sorted(flown.truths, key=lambda one: (one.agent_id, one.at_ms))
    return sorted(map(repr, flown.came)), truths, flown.reached


@settings(max_examples=15, deadline=None)
@given(ASKED)
def test_two_far_apart_fly_as_if_each_were_alone(asked: Asked) -> None:
    def two_of(sea: Sea, *wheres_m: float | None) -> list[tuple[list[str], list[Truth], list[bool]]]:
        flights = played(sea, asked, wheres_m, tuple(range(len(wheres_m))))
        return [without_order(it) for it in flights]

    ids = (1, 2, 3, 4)
    first, second = two_of(Sea(DISTURBED, TimeScale(THETA), ids, 2), 0.0, FAR_M)
    (alone,) = two_of(Sea(DISTURBED, TimeScale(THETA), (1, 3)), 0.0)
    assert first == alone
    assert second == two_of(Sea(DISTURBED, TimeScale(THETA), ids, 2), None, FAR_M)[1]


@settings(max_examples=15, deadline=None)
@given(ASKED)
@example([(5, 1, "drive"), (5, 2, "wifi"), (5, 4, "wifi"), (5, 1, "wifi"), (5, 3, "wifi"), (5, 2, "drive")])
def test_the_order_of_flights_within_a_tick_changes_nothing(asked: Asked) -> None:
    in_order, reversed_ = (
        played(Sea(DISTURBED, TimeScale(THETA), (1, 2, 3, 4), 2), asked, [0.0, 500.0], order)
        for order in ((0, 1), (1, 0))
    )
    assert [without_order(it) for it in in_order] == [without_order(it) for it in reversed_]
