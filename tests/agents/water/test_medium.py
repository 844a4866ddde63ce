"""The medium against hand calculations: delays, collisions, capture, half duplex, and modems that cannot receive."""

from math import sqrt
from typing import Any

import pytest

from agents.modem.frames import FrameKind, ModemFrame
from agents.water.medium import (
    Began,
    FrameHeard,
    LinksChanged,
    MediumResult,
    ModemMoved,
    PacketEnded,
    PacketOutcome,
    Reception,
    ThrustersRan,
    WaterMedium,
)
from agents.water.places import ModemPlace
from agents.water.sound import Sound
from agents.water.topology import LinkRule, Topology

FAR = Sound(absorption_db_per_km=6.0, noise_db_per_hz=-100.0)
"""So little noise that no packet is lost in it."""


def under_water(north_m: float, east_m: float = 0.0, depth_m: float = 5.0) -> ModemPlace:
    return ModemPlace(round(north_m * 1e6), round(east_m * 1e6), round(depth_m * 1e6))


def medium(*places: float | ModemPlace, sound: Sound = FAR) -> WaterMedium:
    """Modems 0, 1, ... at these places or along a line to the north, with their numbers for addresses."""
    made = WaterMedium(sound, 1, [(node, node) for node in range(len(places))])
    for node, it in enumerate(places):
        made.receive(ModemMoved(node, it if isinstance(it, ModemPlace) else under_water(it)), 0)
    return made


def unicast(source: int, destination: int, size: int = 16) -> ModemFrame:
    return ModemFrame(FrameKind.UNICAST, source, destination, bytes(size))


def broadcast(source: int, size: int = 16) -> ModemFrame:
    return ModemFrame(FrameKind.BROADCAST, source, None, bytes(size))


def shown(results: list[MediumResult]) -> dict[Any, PacketOutcome | str]:
    """Outcomes by (sender, receiver), and by the sender alone why it sent nothing."""
    ended = [it for it in results if isinstance(it, PacketEnded)]
    unsent = {it.sender: it.unsent for it in ended if it.unsent is not None}
    return unsent | {(it.sender, way.receiver): way.outcome for it in ended for way in it.receptions}


def test_a_packet_acts_at_its_end_after_its_way() -> None:
    """750 m at 1500 m/s are 500 ms; 16 bytes last 505 ms."""
    water = medium(0, 750)
    assert water.receive(Began(0, unicast(0, 1)), 1000) == [] and water.next_due_ms == 2005
    assert water.advance(2004) == []
    heard, ended = water.advance(2005)
    assert isinstance(heard, FrameHeard) and isinstance(ended, PacketEnded)
    assert heard.reception == Reception(
        1, 2005, PacketOutcome.RECEIVED, pytest.approx(168 - 57.5012 - 4.5 + 60.969), 500_000
    )
    assert (heard.sender, heard.frame.data) == (0, bytes(16))
    assert ended == PacketEnded(0, 1000, unicast(0, 1), None, (heard.reception,))
    assert water.next_due_ms is None


def test_a_broadcast_reaches_everyone_but_its_sender_and_is_told_whole_at_the_last() -> None:
    water = medium(0, 150, 300, 450)
    water.receive(Began(1, broadcast(1)), 0)
    *results, ended = water.advance(10_000)
    heard = [(it.reception.receiver, it.reception.at_ms) for it in results if isinstance(it, FrameHeard)]
    assert heard == [(0, 605), (2, 605), (3, 705)]
    assert isinstance(ended, PacketEnded) and len(ended.receptions) == 3


ECHOING = Sound(noise_db_per_hz=-100, reverberation_s=0.2, reverberation_db=4)
WITHOUT_ABSORPTION = Sound(noise_db_per_hz=-100, absorption_db_per_km=0, capture_db=6)
LOST, HEARD, TALKING, IN_AIR = (
    getattr(PacketOutcome, it) for it in ("COLLIDED", "RECEIVED", "TRANSMITTING", "IN_AIR")
)
Step = tuple[int, list[ModemMoved | ThrustersRan | LinksChanged | tuple[int, int]], dict[Any, Any]]
"""A time in ms, what happens then, as (sender, receiver) for a packet of 505 ms, and all that ended by then."""


def both(later_ms: int, first: PacketOutcome, second: PacketOutcome) -> list[Step]:
    """Node 0 and, so much later, node 2 send to node 1. The first one has been there by 655 ms."""
    ended: dict[Any, Any] = {(0, 1): first}
    then, at_last = (ended, {}) if later_ms > 655 else ({}, ended)
    return [
        (0, [(0, 1)], {}),
        (later_ms, [(2, 1)], then),
        (later_ms + 8000, [], {**at_last, (2, 1): second}),
    ]


RISING = ModemPlace(150_000_000, 0, 3_000_000, 0, -1_000_000, 1000, 3_000_000)
"""3 m down, it rises 1 m a second."""
SCENES: dict[str, tuple[WaterMedium, list[Step]]] = {
    # 1 m are 667 us.
    "a delay is rounded up so that nothing acts before it has arrived": (
        medium(0, 1),
        [(0, [(0, 1)], {}), (505, [], {}), (506, [], {(0, 1): HEARD})],
    ),
    # 500 m and 1200 m down are 1300 m: 866.7 ms.
    "depth counts in the distance": (
        medium(under_water(0, 0, 10), under_water(300, 400, 1210)),
        [(0, [(0, 1)], {}), (1371, [], {}), (1372, [], {(0, 1): HEARD})],
    ),
    # From 150 m on either side, the second begins 504 ms after the first, which lasts 505: the last millisecond.
    "they overlap for a millisecond": (medium(0, 150, 300), both(504, LOST, LOST)),
    "one follows the other": (medium(0, 150, 300), both(505, HEARD, HEARD)),
    # 1500 m away a packet arrives 1000 ms later than it was sent: both begin at once, and do not meet at node 1.
    "they were sent at once and do not meet": (medium(0, 1500, 1501), both(0, HEARD, HEARD)),
    # Without absorption 6 dB is a ratio of 10^(6/20) = 1.995 in distance: 20 m against 39.9 m.
    "one is not loud enough": (medium(0, 20, 59, sound=WITHOUT_ABSORPTION), both(10, LOST, LOST)),
    "the louder one is heard": (medium(0, 20, 61, sound=WITHOUT_ABSORPTION), both(10, HEARD, LOST)),
    # Echoes 4 dB down for 200 ms: within the capture ratio of 6 dB they destroy a packet that begins 199 ms later.
    "echoes destroy": (medium(0, 150, 300, sound=ECHOING), both(505 + 199, HEARD, LOST)),
    "echoes have died down": (medium(0, 150, 300, sound=ECHOING), both(505 + 200, HEARD, HEARD)),
    # Each 41 m away is 6.2 dB weaker than the one at 20 m, both together 3.2 dB.
    "two weak ones together are too loud": (
        medium(*map(under_water, (0, 20, -41, 0), (0, 0, 0, 41)), sound=WITHOUT_ABSORPTION),
        [(0, [(1, 0), (2, 0), (3, 0)], {}), (8000, [], dict.fromkeys([(1, 0), (2, 0), (3, 0)], LOST))],
    ),
    # At node 1 from 100 to 605 ms; at node 0 from 700 on, where it has long finished.
    "a transmitting modem hears nothing": (
        medium(0, 150),
        [(0, [(0, 1)], {}), (600, [(1, 0)], {}), (9000, [], {(0, 1): TALKING, (1, 0): HEARD})],
    ),
    # The own packet ends at 505 ms, the other one arrives from 600 ms on.
    **{
        f"turning round takes {turnaround_ms} ms": (
            medium(0, 150, sound=Sound(noise_db_per_hz=-100, turnaround_s=turnaround_ms / 1000)),
            [(0, [(1, 0)], {}), (500, [(0, 1)], {}), (9000, [], {(1, 0): TALKING, (0, 1): expected})],
        )
        for turnaround_ms, expected in ((94, HEARD), (96, TALKING))
    },
    "a modem that is still sending sends nothing else": (
        medium(0, 150),
        [
            (0, [(0, 1)], {}),
            (504, [(0, 1)], {0: "the modem is still sending"}),
            (505, [(0, 1)], {}),
            (605, [], {(0, 1): HEARD}),
            (1110, [], {(0, 1): HEARD}),
        ],
    ),
    "in air nothing is sent and nothing is heard": (
        medium(0, under_water(150, depth_m=0)),
        [
            (10, [(1, 0)], {1: "the modem is not in the water"}),
            (20, [(0, 1)], {}),
            (8000, [], {(0, 1): IN_AIR}),
        ],
    ),
    # A packet is at it from 100 to 605 ms after it began.
    **{
        f"one that comes up during a packet loses it: {began_ms} ms": (
            medium(under_water(0, depth_m=3), RISING),
            [(began_ms, [(0, 1)], {}), (9000, [], {(0, 1): expected})],
        )
        for began_ms, expected in ((2000, HEARD), (2395, IN_AIR), (2500, IN_AIR))
    },
    "a keel hears at depth nought": (
        medium(0, ModemPlace(150_000_000, 0, 0, in_water=True)),
        [(0, [(0, 1)], {}), (8000, [], {(0, 1): HEARD})],
    ),
    "one that left the water neither hears nor sends": (
        medium(0, 150),
        [
            (0, [(0, 1)], {}),
            (200, [ModemMoved(1, None)], {}),
            (9000, [], {(0, 1): IN_AIR}),
            (9000, [(0, 1)], {}),
            (18_000, [], {}),
        ],
    ),
    # SNR at 1 km is 13 dB; 30 dB more noise leave -17, and hardly a packet in ten thousand gets through.
    "running thrusters mask their own modem only": (
        medium(0, 1000, sound=Sound(thruster_noise_db=30)),
        [
            (0, [ThrustersRan(0, True), (1, 0)], {}),
            (1, [ThrustersRan(1, False)], {}),
            (9000, [], {(1, 0): PacketOutcome.NOISE}),
            (9000, [(0, 1)], {}),
            (18_000, [ThrustersRan(0, False)], {(0, 1): HEARD}),
            (18_000, [(1, 0)], {}),
            (27_000, [], {(1, 0): HEARD}),
        ],
    ),
    "a cut link carries neither packets nor disturbance": (
        medium(0, 150, 300),
        [
            (0, [LinksChanged(Topology([LinkRule(0, 1, 1.0)])), (0, 1), (2, 1)], {}),
            (9000, [LinksChanged(Topology())], {(0, 1): PacketOutcome.CUT, (2, 1): HEARD}),
            (9000, [(0, 1)], {}),
            (18_000, [], {(0, 1): HEARD}),
        ],
    ),
}


@pytest.mark.parametrize(("water", "steps"), SCENES.values(), ids=SCENES)
def test_what_comes_of_packets(water: WaterMedium, steps: list[Step]) -> None:
    for at_ms, events, expected in steps:
        results = water.advance(at_ms)
        for it in events:
            results += water.receive(Began(it[0], unicast(*it)) if isinstance(it, tuple) else it, at_ms)
        assert shown(results) == expected, at_ms
    with pytest.raises(ValueError, match="time went back"):
        water.advance(at_ms - 1)


def test_beyond_the_range_limit_the_addressee_is_named_and_others_are_not() -> None:
    water = medium(0, 150, 600, sound=Sound(noise_db_per_hz=-100, range_limit_m=500))
    assert shown(water.receive(Began(0, unicast(0, 2)), 0)) == {(0, 2): PacketOutcome.OUT_OF_RANGE}
    water.receive(Began(0, broadcast(0)), 9000)
    assert shown(water.advance(18_000)) == {(0, 1): HEARD}


def test_several_nodes_may_share_an_address() -> None:
    water = WaterMedium(FAR, 1, [(0, 0), (1, 7), (255, 7)])
    for node in (0, 1, 255):
        water.receive(ModemMoved(node, under_water(node)), 0)
    water.receive(Began(0, unicast(0, 7)), 0)
    assert set(shown(water.advance(9000))) == {(0, 1), (0, 255)}


@pytest.mark.parametrize(
    ("rate", "snr_db", "fading_db"), [(0.412, -1.0, 0.0), (0.161, 0.0, 0.0), (0.841, -50.0, 50.0)]
)
def test_as_many_packets_are_lost_in_noise_as_the_curve_says(
    rate: float, snr_db: float, fading_db: float
) -> None:
    """2000 packets: within 4.5 standard deviations. With 50 dB of fading about -50 dB the curve is a step at the normal
    distribution's first standard deviation, beyond which 15.9 % lie."""
    quiet = Sound(absorption_db_per_km=0, source_level_db=89.0309 + snr_db, fading_db=fading_db)
    water = medium(0, 1, sound=quiet)
    lost = 0
    for n in range(2000):
        water.receive(Began(0, unicast(0, 1)), 1000 * n)
        lost += PacketOutcome.NOISE in shown(water.advance(1000 * n + 999)).values()
    assert lost / 2000 == pytest.approx(rate, abs=4.5 * sqrt(rate * (1 - rate) / 2000))
