"""What an aPad says of its own accord: in quiet times, one word after another, and true when it is said."""

from __future__ import annotations

from dataclasses import replace

from agents.modem.frames import Frame, FrameKind
from agents.packet_medium import Medium
from agents.water import medium as water_medium
from agents.water.places import Place
from agents.water.sound import Sound
from apad_bridge.acoustics.schedule import AcousticScheduler, ScheduleConfig
from apad_bridge.mission.events import Ping, Send
from apad_bridge.mission.orders import Note
from firmware_model.config import Slots
from firmware_model.packets import EVERYONE, Beacon, CommandPacket, Kind, SlotAssignment
from firmware_model.packets.codec import MusselbedCodec

CODEC = MusselbedCodec()
SLOTS = Slots(frame_ms=300_000, slot_ms=5000)
CONFIG = ScheduleConfig(
    theta=1,
    sound_speed_m_s=1500.0,
    way_ms=100,
    waits=True,
    assigns=True,
    guard_ms=40,
    beacon_period_ms=3_600_000,
    ping_period_ms=0,
)
NOBODY: frozenset[int] = frozenset()


def decoded(action: object) -> object:
    assert isinstance(action, Send)
    return CODEC.decode(action.data)


def test_it_learns_ways_and_then_says_what_time_it_is() -> None:
    """Three slots of 5 s are taken. A ping may take 105 ms and 4 s of waiting; a beacon of 14 bytes lasts 480 ms."""
    talk = AcousticScheduler(CONFIG, CODEC, SLOTS, [3, 1, 2])
    first, second, third, beacon = talk.advance(0, NOBODY)
    assert [first, second, third] == [Ping(1, 15_000), Ping(2, 19_105), Ping(3, 23_210)]
    assert isinstance(beacon, Send) and beacon.not_before_ms == 27_315
    assert decoded(beacon) == Beacon(EVERYONE, 27_315 + 105 + -(-(len(beacon.data) + 16) * 25 // 2))
    assert talk.advance(10_000, NOBODY) == []


def test_an_answer_brings_a_slot_with_an_offset_for_both_ways() -> None:
    """150 m are 100 ms: the beacon sets its clock 100 ms late, and its own words take 100 ms."""
    talk = AcousticScheduler(CONFIG, CODEC, SLOTS, [1, 2, 3])
    talk.advance(0, NOBODY)
    (word,) = talk.hear(2, 150.0, 20_000)
    assert decoded(word) == SlotAssignment(2, 300_000, 5000, 40, 1, -200)
    assert talk.hear(2, 150.0, 21_000) == []
    alone = AcousticScheduler(replace(CONFIG, beacon_period_ms=0), CODEC, SLOTS, [1, 2, 3])
    assert decoded(alone.hear(2, 150.0, 20_000)[0]) == SlotAssignment(2, 300_000, 5000, 40, 1, -100)


def test_slots_are_said_again_with_every_beacon() -> None:
    talk = AcousticScheduler(CONFIG, CODEC, SLOTS, [1, 2])
    talk.advance(0, NOBODY)
    talk.hear(1, 150.0, 20_000)
    said = [decoded(it) for it in talk.advance(3_600_000, NOBODY) if isinstance(it, Send)]
    assert isinstance(said[0], Beacon) and said[1] == SlotAssignment(1, 300_000, 5000, 40, 0, -200)


def test_who_does_not_answer_is_asked_again_and_who_is_away_is_not() -> None:
    talk = AcousticScheduler(replace(CONFIG, beacon_period_ms=0), CODEC, SLOTS, [1, 2])
    talk.advance(0, NOBODY)
    assert talk.advance(500_000, NOBODY) == []
    assert [it.agent_id for it in talk.advance(600_000, frozenset({2})) if isinstance(it, Ping)] == [1]
    talk.hear(1, 10.0, 610_000)
    assert [it.agent_id for it in talk.advance(1_300_000, NOBODY) if isinstance(it, Ping)] == [2]


def test_one_that_was_put_elsewhere_is_measured_again() -> None:
    talk = AcousticScheduler(replace(CONFIG, beacon_period_ms=0), CODEC, SLOTS, [1])
    talk.advance(0, NOBODY)
    talk.hear(1, 10.0, 20_000)
    talk.moved(1, 1_000_000)
    assert talk.advance(1_599_000, NOBODY) == []
    assert [type(it) for it in talk.advance(1_600_000, NOBODY)] == [Ping]


def test_the_mission_s_words_wait_for_quiet_and_wifi_does_not() -> None:
    talk = AcousticScheduler(replace(CONFIG, assigns=False, beacon_period_ms=0), CODEC, SLOTS, [1, 2])
    sound = Send(Medium.SOUND, 1, bytes(6))  # 105 + 22 x 12.5 = 380 ms
    other = replace(sound, agent_id=2)
    radio = Send(Medium.WIFI, 1, bytes(6))
    assert talk.timed([sound, radio, other], 301_000) == [
        replace(sound, not_before_ms=310_000),
        radio,
        replace(other, not_before_ms=310_380 + 20),
    ]
    # What waits already is not said twice; once it has been said, it may be said again.
    assert talk.timed([sound, radio], 305_000) == [radio]
    assert talk.timed([sound], 311_000) == [replace(sound, not_before_ms=311_000)]


def test_two_permissions_in_a_row_do_not_meet_in_the_water() -> None:
    """Echoes 1 dB down for 100 ms destroy what is within the capture ratio of 6 dB; the aPad runs 30 m meanwhile, 20 ms.

    From 150 and then from 120 m: the second begins to arrive as soon as the first has passed, or when its echoes have, too.
    """
    echoing = Sound(noise_db_per_hz=-100, reverberation_ms=100, reverberation_db=1)
    outcomes = {}
    for breath_ms in (20, 120):
        config = replace(CONFIG, assigns=False, beacon_period_ms=0, waits=False, breath_ms=breath_ms)
        words = [Send(Medium.SOUND, it, CODEC.encode(CommandPacket(Kind.PERMISSION, it))) for it in (1, 2)]
        first, second = AcousticScheduler(config, CODEC, SLOTS, [1, 2]).timed(words, 1000)
        assert isinstance(first, Send) and isinstance(second, Send) and first.not_before_ms == 1000
        water = water_medium.Medium(echoing, 1, [(0, 0), (1, 1), (2, 2)])
        for node, north_m in enumerate((0, 160, 150)):
            water.receive(water_medium.Moved(node, Place(north_m * 1_000_000, 0, 5_000_000)), 0)
        said = [Frame(FrameKind.UNICAST, 0, it.agent_id, it.data) for it in (first, second)]
        water.receive(water_medium.Began(0, said[0]), first.not_before_ms)
        ended = water.receive(
            water_medium.Moved(0, Place(30_000_000, 0, 5_000_000)), second.not_before_ms - 1
        )
        ended += water.receive(water_medium.Began(0, said[1]), second.not_before_ms)
        ended += water.advance(9000)
        outcomes[breath_ms] = [
            it.outcome for end in ended if isinstance(end, water_medium.PacketEnded) for it in end.receptions
        ]
    received, collided = water_medium.Outcome.RECEIVED, water_medium.Outcome.COLLIDED
    assert outcomes == {20: [received, collided], 120: [received, received]}


def test_pings_go_round_those_who_hear() -> None:
    talk = AcousticScheduler(
        replace(CONFIG, assigns=False, beacon_period_ms=0, ping_period_ms=10_000), CODEC, None, [1, 2, 3]
    )
    asked = [talk.advance(now_ms, frozenset({2})) for now_ms in range(0, 40_000, 5000)]
    assert [[it.agent_id for it in said if isinstance(it, Ping)] for said in asked] == [
        [1], [], [3], [], [1], [], [3], [],
    ]  # fmt: skip


def test_places_are_asked_for_before_charges_and_the_air_is_kept_clear_for_each_answer() -> None:
    """A ping claims 105 ms and 4 s; a question of 6 bytes lasts 380 ms, its answer takes 893 and both have ways of 100."""
    talk = AcousticScheduler(
        replace(CONFIG, assigns=False, beacon_period_ms=0, answer_ms=893), CODEC, SLOTS, [1, 2, 3]
    )
    ping, note, question = talk.advance(10_000, NOBODY, [2, 3], [2, 1])
    assert ping == Ping(2, 15_000)
    assert note == Note("asked", {"id": 2})
    assert isinstance(question, Send) and question.not_before_ms == 19_105 + 20
    assert decoded(question) == CommandPacket(Kind.PING, 2)
    (permission,) = talk.timed([Send(Medium.SOUND, 1, bytes(6))], 10_000)
    assert isinstance(permission, Send) and permission.not_before_ms == 19_125 + 380 + 893 + 200 + 20


def test_an_answer_that_does_not_fit_before_the_slots_is_asked_for_after_them() -> None:
    config = replace(CONFIG, assigns=False, beacon_period_ms=0, answer_ms=893)
    said = AcousticScheduler(config, CODEC, SLOTS, [1]).advance(299_000, NOBODY, [], [1])
    assert isinstance(said[1], Send) and said[1].not_before_ms == 305_020


def test_a_question_without_an_answer_is_told_and_counted_once() -> None:
    config = replace(CONFIG, assigns=False, beacon_period_ms=0, answer_ms=893)
    talk = AcousticScheduler(config, CODEC, None, [1, 2])
    talk.advance(0, NOBODY, [], [1])
    assert talk.advance(5000, NOBODY) == []
    # A breath of 20, 380 + 893 + 2 x 100 ms, and 4 s.
    assert talk.advance(6000, NOBODY) == [Note("unanswered", {"id": 1})]
    talk.advance(10_000, NOBODY, [], [2])
    talk.heard_of(2)
    assert talk.advance(20_000, NOBODY) == [] and talk.unanswered == 1
