"""Tests the aPad's schedule: packets outside of the timeslots, one after another, with a beacon's time true when sent."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from agents.modem.frames import FrameKind, ModemFrame
from agents.packet_medium import Medium
from agents.time_scale import TimeScale
from agents.water import medium as water_medium
from agents.water.places import ModemPlace
from agents.water.sound import Sound
from apad_bridge.acoustics.schedule import AcousticScheduler, ScheduleConfig
from apad_bridge.events.sound_events import Asked, NoAnswer
from apad_bridge.mission.facts import Ping, Send
from apad_bridge.scenario.water.water_options import Talk, Water
from firmware_model.config import Timeslots
from firmware_model.packets import EVERYONE, Beacon, CommandPacket, Kind, SlotAssignment
from firmware_model.packets.codec import MusselbedCodec

CODEC = MusselbedCodec()
SLOTS = Timeslots(frame_ms=300_000, slot_ms=5000, guard_ms=40)
TALK = Talk(waits=True, assigns=True, beacon_period_s=3600.0)
CONFIG = ScheduleConfig(TimeScale(1), water=Water(talk=TALK), longest_delay_ms=100)
NOBODY: frozenset[int] = frozenset()


def talking(**changes: Any) -> ScheduleConfig:
    return replace(CONFIG, water=Water(talk=replace(TALK, **changes)))


def decoded(action: object) -> object:
    assert isinstance(action, Send)
    return CODEC.decode(action.data)


def test_it_learns_delays_and_then_sends_a_beacon() -> None:
    """Three timeslots of 5 s are taken. A ping may take 105 ms and 4 s of waiting; a beacon of 14 bytes lasts 480 ms."""
    scheduler = AcousticScheduler(CONFIG, CODEC, SLOTS, [3, 1, 2])
    first, second, third, beacon = scheduler.advance(0, NOBODY)
    assert [first, second, third] == [Ping(1, 15_000), Ping(2, 19_105), Ping(3, 23_210)]
    assert isinstance(beacon, Send) and beacon.not_before_ms == 27_315
    assert decoded(beacon) == Beacon(EVERYONE, 27_315 + 105 + -(-(len(beacon.data) + 16) * 25 // 2))
    assert scheduler.advance(10_000, NOBODY) == []


def test_an_answer_brings_a_timeslot_with_an_offset_for_both_delays() -> None:
    """150 m are 100 ms: the beacon sets its clock 100 ms late, and its own packets take 100 ms."""
    scheduler = AcousticScheduler(CONFIG, CODEC, SLOTS, [1, 2, 3])
    scheduler.advance(0, NOBODY)
    (assignment,) = scheduler.ping_answered(2, 150.0, 20_000)
    assert decoded(assignment) == SlotAssignment(2, 300_000, 5000, 40, 1, -200)
    assert scheduler.ping_answered(2, 150.0, 21_000) == []
    alone = AcousticScheduler(talking(beacon_period_s=0.0), CODEC, SLOTS, [1, 2, 3])
    assert decoded(alone.ping_answered(2, 150.0, 20_000)[0]) == SlotAssignment(2, 300_000, 5000, 40, 1, -100)


def test_timeslots_are_assigned_again_with_every_beacon() -> None:
    scheduler = AcousticScheduler(CONFIG, CODEC, SLOTS, [1, 2])
    scheduler.advance(0, NOBODY)
    scheduler.ping_answered(1, 150.0, 20_000)
    actions = [decoded(it) for it in scheduler.advance(3_600_000, NOBODY) if isinstance(it, Send)]
    assert isinstance(actions[0], Beacon) and actions[1] == SlotAssignment(1, 300_000, 5000, 40, 0, -200)


def test_who_does_not_answer_is_asked_again_and_who_is_away_is_not() -> None:
    scheduler = AcousticScheduler(talking(beacon_period_s=0.0), CODEC, SLOTS, [1, 2])
    scheduler.advance(0, NOBODY)
    assert scheduler.advance(500_000, NOBODY) == []
    assert [it.agent_id for it in scheduler.advance(600_000, frozenset({2})) if isinstance(it, Ping)] == [1]
    scheduler.ping_answered(1, 10.0, 610_000)
    assert [it.agent_id for it in scheduler.advance(1_300_000, NOBODY) if isinstance(it, Ping)] == [2]


def test_one_that_was_put_elsewhere_is_measured_again() -> None:
    scheduler = AcousticScheduler(talking(beacon_period_s=0.0), CODEC, SLOTS, [1])
    scheduler.advance(0, NOBODY)
    scheduler.ping_answered(1, 10.0, 20_000)
    scheduler.moved(1, 1_000_000)
    assert scheduler.advance(1_599_000, NOBODY) == []
    assert [type(it) for it in scheduler.advance(1_600_000, NOBODY)] == [Ping]


def test_the_mission_s_acoustic_packets_wait_for_the_window_and_wifi_does_not() -> None:
    scheduler = AcousticScheduler(talking(assigns=False, beacon_period_s=0.0), CODEC, SLOTS, [1, 2])
    sound = Send(Medium.SOUND, 1, bytes(6))  # 105 + 22 x 12.5 = 380 ms
    other = replace(sound, agent_id=2)
    radio = Send(Medium.WIFI, 1, bytes(6))
    assert [scheduler.send(it, 301_000) for it in (sound, radio, other)] == [
        replace(sound, not_before_ms=310_000),
        radio,
        replace(other, not_before_ms=310_380 + 20),
    ]
    # A waiting packet is not sent twice; after it was sent, it may be sent again.
    assert [scheduler.send(it, 305_000) for it in (sound, radio)] == [None, radio]
    assert scheduler.send(sound, 311_000) == replace(sound, not_before_ms=311_000)


def test_two_permissions_in_a_row_do_not_meet_in_the_water() -> None:
    """Echoes 1 dB down for 100 ms destroy packets within the capture ratio of 6 dB; meanwhile the aPad runs 30 m, or 20 ms.

    It sends from 150 m and then from 120 m. The second packet begins to arrive as soon as the first has passed, or only
    after its echoes.
    """
    echoing = Sound(noise_db_per_hz=-100, reverberation_s=0.1, reverberation_db=1)
    outcomes = {}
    for pause_ms in (20, 120):
        config = replace(talking(assigns=False, beacon_period_s=0.0, waits=False), pause_ms=pause_ms)
        permissions = [
            Send(Medium.SOUND, it, CODEC.encode(CommandPacket(Kind.PERMISSION, it))) for it in (1, 2)
        ]
        scheduler = AcousticScheduler(config, CODEC, SLOTS, [1, 2])
        first, second = (scheduler.send(it, 1000) for it in permissions)
        assert isinstance(first, Send) and isinstance(second, Send) and first.not_before_ms == 1000
        water = water_medium.WaterMedium(echoing, 1, [(0, 0), (1, 1), (2, 2)])
        for node, north_m in enumerate((0, 160, 150)):
            water.receive(water_medium.ModemMoved(node, ModemPlace(north_m * 1_000_000, 0, 5_000_000)), 0)
        actions = [ModemFrame(FrameKind.UNICAST, 0, it.agent_id, it.data) for it in (first, second)]
        water.receive(water_medium.Began(0, actions[0]), first.not_before_ms)
        ended = water.receive(
            water_medium.ModemMoved(0, ModemPlace(30_000_000, 0, 5_000_000)), second.not_before_ms - 1
        )
        ended += water.receive(water_medium.Began(0, actions[1]), second.not_before_ms)
        ended += water.advance(9000)
        outcomes[pause_ms] = [
            it.outcome for end in ended if isinstance(end, water_medium.PacketEnded) for it in end.receptions
        ]
    received, collided = water_medium.PacketOutcome.RECEIVED, water_medium.PacketOutcome.COLLIDED
    assert outcomes == {20: [received, collided], 120: [received, received]}


def test_pings_go_round_those_who_hear() -> None:
    scheduler = AcousticScheduler(
        talking(assigns=False, beacon_period_s=0.0, ping_period_s=10.0), CODEC, None, [1, 2, 3]
    )
    asked = [scheduler.advance(now_ms, frozenset({2})) for now_ms in range(0, 40_000, 5000)]
    assert [[it.agent_id for it in actions if isinstance(it, Ping)] for actions in asked] == [
        [1], [], [3], [], [1], [], [3], [],
    ]  # fmt: skip


def test_pings_come_before_status_requests_and_nothing_is_sent_before_each_answer() -> None:
    """A ping reserves 105 ms and 4 s; a request of 6 bytes lasts 380 ms, its answer 893 ms, and each delay is 100 ms."""
    scheduler = AcousticScheduler(
        replace(talking(assigns=False, beacon_period_s=0.0), answer_ms=893), CODEC, SLOTS, [1, 2, 3]
    )
    ping, note, question = scheduler.advance(10_000, NOBODY, [2, 3], [2, 1])
    assert ping == Ping(2, 15_000)
    assert note == Asked(2)
    assert isinstance(question, Send) and question.not_before_ms == 19_105 + 20
    assert decoded(question) == CommandPacket(Kind.PING, 2)
    permission = scheduler.send(Send(Medium.SOUND, 1, bytes(6)), 10_000)
    assert isinstance(permission, Send) and permission.not_before_ms == 19_125 + 380 + 893 + 200 + 20


def test_an_answer_that_does_not_fit_before_the_timeslots_is_requested_after_them() -> None:
    config = replace(talking(assigns=False, beacon_period_s=0.0), answer_ms=893)
    actions = AcousticScheduler(config, CODEC, SLOTS, [1]).advance(299_000, NOBODY, [], [1])
    assert isinstance(actions[1], Send) and actions[1].not_before_ms == 305_020


def test_a_question_without_an_answer_is_told_and_counted_once() -> None:
    config = replace(talking(assigns=False, beacon_period_s=0.0), answer_ms=893)
    scheduler = AcousticScheduler(config, CODEC, None, [1, 2])
    scheduler.advance(0, NOBODY, [], [1])
    assert scheduler.advance(5000, NOBODY) == []
    # A pause of 20 ms, 380 + 893 + 2 x 100 ms, and 4 s.
    assert scheduler.advance(6000, NOBODY) == [NoAnswer(1)]
    scheduler.advance(10_000, NOBODY, [], [2])
    scheduler.short_status_received(2)
    assert scheduler.advance(20_000, NOBODY) == [] and scheduler.unanswered == 1


def test_one_of_several_apads_keeps_to_its_turn_and_to_whom_it_serves() -> None:
    """Four timeslots are 20 s of 300. The second of two aPads has the second 140 s: from 160 s on."""
    config = talking(turn=(2, 2), ping_period_s=1000.0)
    scheduler = AcousticScheduler(config, CODEC, SLOTS, [1, 2, 3, 4], served=[2, 4])
    first, second, beacon, *_ = scheduler.advance(0, NOBODY)
    assert [first, second] == [Ping(2, 160_000), Ping(4, 164_105)]
    assert isinstance(beacon, Send) and beacon.not_before_ms == 168_210
    (assignment,) = scheduler.ping_answered(4, 150.0, 170_000)
    assert decoded(assignment) == SlotAssignment(
        4, 300_000, 5000, 40, 3, -200
    )  # its place in the whole fleet

    scheduler.start_serving(1, 200_000)
    scheduler.stop_serving(2)
    scheduler.stop_serving(4)
    pinged = [
        it.agent_id
        for now_ms in range(200_000, 10_000_000, 100_000)
        for it in scheduler.advance(now_ms, NOBODY)
        if isinstance(it, Ping)
    ]
    assert set(pinged) == {1}
    assert decoded(scheduler.ping_answered(1, 150.0, 10_000_000)[0]) == SlotAssignment(
        1, 300_000, 5000, 40, 0, -200
    )
    assert scheduler.ping_answered(4, 150.0, 10_000_000) == [] and scheduler.delays_ms.keys() == {1}
