"""The medium against hand calculations: delays, collisions, capture, half duplex, and modems that cannot receive."""

from math import sqrt

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


def medium(*norths_m: float, sound: Sound = FAR, seed: int = 1) -> WaterMedium:
    """Modems 0, 1, ... along a line to the north, with these addresses."""
    made = WaterMedium(sound, seed, [(node, node) for node in range(len(norths_m))])
    for node, north_m in enumerate(norths_m):
        made.receive(ModemMoved(node, under_water(north_m)), 0)
    return made


def unicast(source: int, destination: int, size: int = 16) -> ModemFrame:
    return ModemFrame(FrameKind.UNICAST, source, destination, bytes(size))


def broadcast(source: int, size: int = 16) -> ModemFrame:
    return ModemFrame(FrameKind.BROADCAST, source, None, bytes(size))


def outcomes(results: list[MediumResult]) -> dict[tuple[int, int], PacketOutcome]:
    """Results by (sender, receiver)."""
    ended = [result for result in results if isinstance(result, PacketEnded)]
    return {(it.sender, reception.receiver): reception.outcome for it in ended for reception in it.receptions}


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


def test_a_delay_is_rounded_up_so_that_nothing_acts_before_it_has_arrived() -> None:
    water = medium(0, 1)  # 667 us
    water.receive(Began(0, ModemFrame(FrameKind.PING, 0, 1)), 0)
    assert water.next_due_ms == 106


def test_depth_counts_in_the_distance() -> None:
    water = WaterMedium(FAR, 1, [(0, 0), (1, 1)])
    water.receive(ModemMoved(0, under_water(0, 0, 10)), 0)
    water.receive(ModemMoved(1, under_water(300, 400, 1210)), 0)
    water.receive(Began(0, unicast(0, 1)), 0)
    (heard, _) = water.advance(5000)
    assert isinstance(heard, FrameHeard) and heard.reception.travelled_us == round(
        1e6 * sqrt(500**2 + 1200**2) / 1500
    )


def test_a_broadcast_reaches_everyone_but_its_sender_and_is_told_whole_at_the_last() -> None:
    water = medium(0, 150, 300, 450)
    water.receive(Began(1, broadcast(1)), 0)
    results = water.advance(10_000)
    heard = [(it.reception.receiver, it.reception.at_ms) for it in results if isinstance(it, FrameHeard)]
    assert heard == [(0, 605), (2, 605), (3, 705)]
    assert isinstance(results[-1], PacketEnded) and len(results[-1].receptions) == 3


ECHOING = Sound(noise_db_per_hz=-100, reverberation_s=0.2, reverberation_db=4)
WITHOUT_ABSORPTION = Sound(noise_db_per_hz=-100, absorption_db_per_km=0, capture_db=6)
LOST, HEARD, TALKING = PacketOutcome.COLLIDED, PacketOutcome.RECEIVED, PacketOutcome.TRANSMITTING


def sent(water: WaterMedium, *packets: tuple[int, int, int]) -> dict[tuple[int, int], PacketOutcome]:
    """The outcomes of packets of 505 ms, each with its begin, sender and receiver."""
    results: list[MediumResult] = []
    for at_ms, sender, receiver in packets:
        results += water.receive(Began(sender, unicast(sender, receiver)), at_ms)
    return outcomes(results + water.advance(packets[-1][0] + 8000))


@pytest.mark.parametrize(
    ("water", "later_ms", "first", "second"),
    [
        # From 150 m on either side, the second begins 504 ms after the first, which lasts 505: the last millisecond.
        (medium(0, 150, 300), 504, LOST, LOST),
        (medium(0, 150, 300), 505, HEARD, HEARD),
        # 1500 m away a packet arrives 1000 ms later than it was sent: both begin at once, and do not meet at node 1.
        (medium(0, 1500, 1501), 0, HEARD, HEARD),
        # Without absorption 6 dB is a ratio of 10^(6/20) = 1.995 in distance: 20 m against 39.9 m.
        (medium(0, 20, 59, sound=WITHOUT_ABSORPTION), 10, LOST, LOST),
        (medium(0, 20, 61, sound=WITHOUT_ABSORPTION), 10, HEARD, LOST),
        # Echoes 4 dB down for 200 ms: within the capture ratio of 6 dB they destroy a packet that begins 199 ms later.
        (medium(0, 150, 300, sound=ECHOING), 505 + 199, HEARD, LOST),
        (medium(0, 150, 300, sound=ECHOING), 505 + 200, HEARD, HEARD),
    ],
)
def test_packets_that_overlap_at_the_receiver_destroy_each_other(
    water: WaterMedium, later_ms: int, first: PacketOutcome, second: PacketOutcome
) -> None:
    assert sent(water, (0, 0, 1), (later_ms, 2, 1)) == {(0, 1): first, (2, 1): second}


def test_two_weak_ones_together_may_be_too_loud() -> None:
    """Each 41 m away is 6.2 dB weaker than the one at 20 m, both together 3.2 dB."""
    water = WaterMedium(WITHOUT_ABSORPTION, 1, [(n, n) for n in range(4)])
    for node, (north_m, east_m) in enumerate(((0.0, 0.0), (20.0, 0.0), (-41.0, 0.0), (0.0, 41.0))):
        water.receive(ModemMoved(node, under_water(north_m, east_m)), 0)
    assert sent(water, (0, 1, 0), (0, 2, 0), (0, 3, 0))[1, 0] is LOST


def test_a_transmitting_modem_hears_nothing() -> None:
    """At node 1 from 100 to 605 ms; at node 0 from 700 on, where it has long finished."""
    assert sent(medium(0, 150), (0, 0, 1), (600, 1, 0)) == {(0, 1): TALKING, (1, 0): HEARD}


@pytest.mark.parametrize(("turnaround_ms", "expected"), [(94, HEARD), (96, TALKING)])
def test_turning_round_takes_its_time(turnaround_ms: int, expected: PacketOutcome) -> None:
    """The own packet ends at 505 ms, the other one arrives from 600 ms on."""
    water = medium(0, 150, sound=Sound(noise_db_per_hz=-100, turnaround_s=turnaround_ms / 1000))
    assert sent(water, (0, 1, 0), (500, 0, 1))[0, 1] is expected


@pytest.fixture
def water() -> WaterMedium:
    return medium(0, 150)


def test_a_modem_that_is_still_sending_sends_nothing_else(water: WaterMedium) -> None:
    water.receive(Began(0, unicast(0, 1)), 0)
    (ended,) = water.receive(Began(0, unicast(0, 1)), 504)
    assert ended == PacketEnded(0, 504, unicast(0, 1), "the modem is still sending", ())
    assert water.receive(Began(0, unicast(0, 1)), 505) == []


def test_in_air_nothing_is_sent_and_nothing_is_heard(water: WaterMedium) -> None:
    water.receive(ModemMoved(1, under_water(150, depth_m=0)), 0)
    (ended,) = water.receive(Began(1, unicast(1, 0)), 10)
    assert isinstance(ended, PacketEnded) and ended.unsent == "the modem is not in the water"
    assert sent(water, (20, 0, 1)) == {(0, 1): PacketOutcome.IN_AIR}


def test_one_that_comes_up_during_a_packet_loses_it() -> None:
    """3 m down it rises 1 m a second; a packet is at it from 100 to 605 ms after it began."""
    for began_ms, expected in ((2000, HEARD), (2395, PacketOutcome.IN_AIR), (2500, PacketOutcome.IN_AIR)):
        water = WaterMedium(FAR, 1, [(0, 0), (1, 1)])
        water.receive(ModemMoved(0, under_water(0, depth_m=3)), 0)
        water.receive(ModemMoved(1, ModemPlace(150_000_000, 0, 3_000_000, 0, -1_000_000, 1000, 3_000_000)), 0)
        assert sent(water, (began_ms, 0, 1)) == {(0, 1): expected}


def test_a_keel_hears_at_depth_nought(water: WaterMedium) -> None:
    water.receive(ModemMoved(1, ModemPlace(150_000_000, 0, 0, in_water=True)), 0)
    assert sent(water, (0, 0, 1)) == {(0, 1): HEARD}


def test_one_that_left_the_water_neither_hears_nor_sends(water: WaterMedium) -> None:
    water.receive(Began(0, unicast(0, 1)), 0)
    water.receive(ModemMoved(1, None), 200)
    assert outcomes(water.advance(9000)) == {(0, 1): PacketOutcome.IN_AIR}
    assert sent(water, (9000, 0, 1)) == {}


def test_running_thrusters_mask_their_own_modem_only() -> None:
    """SNR at 1 km is 13 dB; 30 dB more noise leave -17, and hardly a packet in ten thousand gets through."""
    water = medium(0, 1000, sound=Sound(thruster_noise_db=30))
    water.receive(ThrustersRan(0, True), 0)
    water.receive(Began(1, unicast(1, 0)), 0)
    water.receive(ThrustersRan(1, False), 1)
    assert outcomes(water.advance(9000)) == {(1, 0): PacketOutcome.NOISE}
    assert sent(water, (9000, 0, 1)) == {(0, 1): HEARD}
    water.receive(ThrustersRan(0, False), 18_000)
    assert sent(water, (18_000, 1, 0)) == {(1, 0): HEARD}


def test_a_cut_link_carries_neither_packets_nor_disturbance() -> None:
    water = medium(0, 150, 300)
    water.receive(LinksChanged(Topology([LinkRule(0, 1, 1.0)])), 0)
    assert sent(water, (0, 0, 1), (0, 2, 1)) == {(0, 1): PacketOutcome.CUT, (2, 1): HEARD}
    water.receive(LinksChanged(Topology()), 9000)
    assert sent(water, (9000, 0, 1)) == {(0, 1): HEARD}


def test_beyond_the_range_limit_the_addressee_is_named_and_others_are_not() -> None:
    water = medium(0, 150, 600, sound=Sound(noise_db_per_hz=-100, range_limit_m=500))
    assert outcomes(water.receive(Began(0, unicast(0, 2)), 0)) == {(0, 2): PacketOutcome.OUT_OF_RANGE}
    water.receive(Began(0, broadcast(0)), 9000)
    assert outcomes(water.advance(18_000)) == {(0, 1): PacketOutcome.RECEIVED}


def test_several_nodes_may_share_an_address() -> None:
    water = WaterMedium(FAR, 1, [(0, 0), (1, 7), (255, 7)])
    for node in (0, 1, 255):
        water.receive(ModemMoved(node, under_water(node)), 0)
    water.receive(Began(0, unicast(0, 7)), 0)
    assert set(outcomes(water.advance(9000))) == {(0, 1), (0, 255)}


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
        lost += PacketOutcome.NOISE in outcomes(water.advance(1000 * n + 999)).values()
    assert lost / 2000 == pytest.approx(rate, abs=4.5 * sqrt(rate * (1 - rate) / 2000))


def test_time_cannot_go_back() -> None:
    water = medium(0, 1)
    water.advance(10)
    with pytest.raises(ValueError, match="time went back: 9 before 10"):
        water.advance(9)
