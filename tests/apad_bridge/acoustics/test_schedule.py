"""Tests the aPad's schedule: packets outside of the timeslots, one after another, with a beacon's time true when sent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from typing import Any

import pytest

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
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec

CODEC = MusselbedCodec()
SLOTS = Timeslots(frame_ms=300_000, slot_ms=5000, guard_ms=40)
TALK = Talk(waits=True, assigns=True, beacon_period_s=3600.0)
CONFIG = ScheduleConfig(TimeScale(1), water=Water(talk=TALK), longest_delay_ms=100)
NOBODY: frozenset[int] = frozenset()


def talking(**changes: Any) -> ScheduleConfig:
    return replace(CONFIG, water=Water(talk=replace(TALK, **changes)))


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


SOUND, RADIO = Send(Medium.SOUND, 1, bytes(6)), Send(Medium.WIFI, 1, bytes(6))
"""Two that no codec reads; of sound, 105 + 22 x 12.5 = 380 ms."""


def text(action: object) -> str:
    """What is sent to whom, and the time before which it is not."""
    match action:
        case Ping(agent_id, not_before_ms):
            return f"ping {agent_id} at {not_before_ms}"
        case Send(medium, agent_id, data, not_before_ms) if data == bytes(6):
            return f"{medium} {agent_id} at {not_before_ms}"
        case Send(_, _, data, not_before_ms):
            packet = CODEC.decode(data)
            values = (int(it) for it in astuple(packet) if it is not None)
            return f"{type(packet).__name__} {' '.join(map(str, values))} at {not_before_ms}"
        case Asked(agent_id) | NoAnswer(agent_id):
            return f"{type(action).__name__} {agent_id}"
    return str(action)


Act = Callable[[AcousticScheduler], Any]


def tick(now_ms: int, *away: int, urgent: Sequence[int] = (), unsure: Sequence[int] = ()) -> Act:
    return lambda it: it.advance(now_ms, frozenset(away), list(urgent), list(unsure))


def answers(agent_id: int, range_m: float, now_ms: int) -> Act:
    return lambda it: it.ping_answered(agent_id, range_m, now_ms)


def sends(packet: Send, now_ms: int, agent_id: int = 1) -> Act:
    return lambda it: it.send(replace(packet, agent_id=agent_id), now_ms)


def shown(actions: Any) -> list[str] | None:
    if isinstance(actions, list):
        return [text(it) for it in actions]
    return None if actions is None else [text(actions)]


NO_BEACON = {"beacon_period_s": 0.0}
QUIET = {"assigns": False, "beacon_period_s": 0.0}
SCENES: dict[str, tuple[dict[str, Any], dict[str, Any], list[tuple[Act, list[str] | None]]]] = {
    # Three timeslots of 5 s are taken. A ping may take 105 ms and 4 s of waiting; a beacon of 14 bytes lasts 480 ms.
    "it learns delays and then sends a beacon, whose time is that of its end": (
        {},
        {"ids": [3, 1, 2]},
        [
            (tick(0), ["ping 1 at 15000", "ping 2 at 19105", "ping 3 at 23210", "Beacon 0 27795 at 27315"]),
            (tick(10_000), []),
        ],
    ),
    # 150 m are 100 ms: the beacon sets its clock 100 ms late, and its own packets take 100 ms.
    "an answer brings a timeslot with an offset for both delays, once": (
        {},
        {"ids": [1, 2, 3]},
        [
            (tick(0), ["ping 1 at 15000", "ping 2 at 19105", "ping 3 at 23210", "Beacon 0 27795 at 27315"]),
            (answers(2, 150.0, 20_000), ["SlotAssignment 2 300000 5000 40 1 -200 at 27795"]),
            (answers(2, 150.0, 21_000), []),
        ],
    ),
    "without beacons the offset is that of one delay": (
        NO_BEACON,
        {"ids": [1, 2, 3]},
        [(answers(2, 150.0, 20_000), ["SlotAssignment 2 300000 5000 40 1 -100 at 20000"])],
    ),
    "timeslots are assigned again with every beacon": (
        {},
        {"ids": [1, 2]},
        [
            (tick(0), ["ping 1 at 10000", "ping 2 at 14105", "Beacon 0 18690 at 18210"]),
            (answers(1, 150.0, 20_000), ["SlotAssignment 1 300000 5000 40 0 -200 at 20000"]),
            (
                tick(3_600_000),
                [
                    "ping 2 at 3610000",
                    "Beacon 0 3614585 at 3614105",
                    "SlotAssignment 1 300000 5000 40 0 -200 at 3614585",
                ],
            ),
        ],
    ),
    "who does not answer is asked again, and who is away is not": (
        NO_BEACON,
        {"ids": [1, 2]},
        [
            (tick(0), ["ping 1 at 10000", "ping 2 at 14105"]),
            (tick(500_000), []),
            (tick(600_000, 2), ["ping 1 at 610000"]),
            (answers(1, 10.0, 610_000), ["SlotAssignment 1 300000 5000 40 0 -7 at 614105"]),
            (tick(1_300_000), ["ping 2 at 1300000"]),
        ],
    ),
    "one that did not answer is asked again ten minutes of its own time later, at theta 30": (
        QUIET,
        {"ids": [1], "slots": None, "answer_ms": 893, "theta": 30},
        [
            (tick(0, unsure=[1]), ["Asked 1", "CommandPacket 4 1 at 20"]),
            (tick(19_999, unsure=[1]), ["NoAnswer 1"]),
            (tick(20_000, unsure=[1]), ["Asked 1", "CommandPacket 4 1 at 600020"]),
        ],
    ),
    "one that was put elsewhere is measured again": (
        NO_BEACON,
        {"ids": [1]},
        [
            (tick(0), ["ping 1 at 5000"]),
            (answers(1, 10.0, 20_000), ["SlotAssignment 1 300000 5000 40 0 -7 at 20000"]),
            (lambda it: it.moved(1, 1_000_000), None),
            (tick(1_599_000), []),
            (tick(1_600_000), ["ping 1 at 1600000"]),
        ],
    ),
    # A waiting packet is not sent twice; after it was sent, it may be sent again.
    "the mission's acoustic packets wait for the window, and wifi does not": (
        QUIET,
        {"ids": [1, 2]},
        [
            (sends(SOUND, 301_000), ["sound 1 at 310000"]),
            (sends(RADIO, 301_000), ["wifi 1 at 0"]),
            (sends(SOUND, 301_000, 2), ["sound 2 at 310400"]),
            (sends(SOUND, 305_000), None),
            (sends(RADIO, 305_000), ["wifi 1 at 0"]),
            (sends(SOUND, 311_000), ["sound 1 at 311000"]),
        ],
    ),
    "pings go round those who hear": (
        QUIET | {"ping_period_s": 10.0},
        {"ids": [1, 2, 3], "slots": None},
        [
            (
                tick(now_ms, 2),
                [] if now_ms % 10_000 else [f"ping {1 + 2 * (now_ms // 10_000 % 2)} at {now_ms}"],
            )
            for now_ms in range(0, 40_000, 5000)
        ],
    ),
    # A ping reserves 105 ms and 4 s; a request of 6 bytes lasts 380 ms, its answer 893 ms, and each delay is 100 ms.
    "pings come before status requests, and nothing is sent before each answer": (
        QUIET,
        {"ids": [1, 2, 3], "answer_ms": 893},
        [
            (
                tick(10_000, urgent=[2, 3], unsure=[2, 1]),
                ["ping 2 at 15000", "Asked 2", "CommandPacket 4 2 at 19125"],
            ),
            (sends(SOUND, 10_000), [f"sound 1 at {19_125 + 380 + 893 + 200 + 20}"]),
        ],
    ),
    "an answer that does not fit before the timeslots is requested after them": (
        QUIET,
        {"ids": [1], "answer_ms": 893},
        [(tick(299_000, unsure=[1]), ["Asked 1", "CommandPacket 4 1 at 305020"])],
    ),
    # A pause of 20 ms, 380 + 893 + 2 x 100 ms, and 4 s.
    "a question without an answer is told and counted once": (
        QUIET,
        {"ids": [1, 2], "slots": None, "answer_ms": 893},
        [
            (tick(0, unsure=[1]), ["Asked 1", "CommandPacket 4 1 at 20"]),
            (tick(5000), []),
            (tick(6000), ["NoAnswer 1"]),
            (tick(10_000, unsure=[2]), ["Asked 2", "CommandPacket 4 2 at 10020"]),
            (lambda it: it.short_status_received(2), None),
            (tick(20_000), []),
            (lambda it: str(it.unanswered), ["1"]),
        ],
    ),
    # Four timeslots are 20 s of 300. The second of two aPads has the second 140 s: from 160 s on. A timeslot's number is
    # its place in the whole fleet.
    "one of several aPads keeps to its turn and to whom it serves": (
        {"turn": (2, 2), "ping_period_s": 1000.0},
        {"ids": [1, 2, 3, 4], "served": [2, 4]},
        [
            (
                tick(0),
                ["ping 2 at 160000", "ping 4 at 164105", "Beacon 0 168690 at 168210", "ping 2 at 168690"],
            ),
            (answers(4, 150.0, 170_000), ["SlotAssignment 4 300000 5000 40 3 -200 at 172795"]),
            (lambda it: it.start_serving(1, 200_000), None),
            (lambda it: it.stop_serving(2), None),
            (lambda it: it.stop_serving(4), None),
            (
                lambda it: str(
                    {
                        ping.agent_id
                        for now_ms in range(200_000, 10_000_000, 100_000)
                        for ping in it.advance(now_ms, NOBODY)
                        if isinstance(ping, Ping)
                    }
                ),
                ["{1}"],
            ),
            (answers(1, 150.0, 10_000_000), ["SlotAssignment 1 300000 5000 40 0 -200 at 10060000"]),
            (answers(4, 150.0, 10_000_000), []),
            (lambda it: str(set(it.delays_ms)), ["{1}"]),
        ],
    ),
}


@pytest.mark.parametrize(("talk", "how", "steps"), SCENES.values(), ids=SCENES)
def test_what_is_sent_and_when(
    talk: dict[str, Any], how: dict[str, Any], steps: list[tuple[Act, list[str] | None]]
) -> None:
    how = {"slots": SLOTS, "served": None, "answer_ms": CONFIG.answer_ms, "theta": 1} | how
    config = replace(talking(**talk), answer_ms=how["answer_ms"], scale=TimeScale(how["theta"]))
    scheduler = AcousticScheduler(config, CODEC, how["slots"], how["ids"], served=how["served"])
    for act, sent in steps:
        assert shown(act(scheduler)) == sent
