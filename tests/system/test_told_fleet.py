"""Whole boards with all that they may have, told all that they may be told, in processes that are killed: as in one."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from fleets import KILL, STILL, Story, fly, with_whole_boards

from agents.fleet_config import resting_on_bottom
from agents.hosting.in_process import InProcessHost
from agents.hosting.process_host import ProcessHost
from agents.mussel.stimuli import AgentStimulus, CoilSlipped, ContactClosed, ContactOpened, SoundArrived
from agents.nursery.fleet_file import RestartPolicy
from firmware_model.config import FullFirmware, LastResort, Timekeeping
from firmware_model.packets import (
    Beacon,
    Command,
    CommandPacket,
    HoverAt,
    Kind,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    Threshold,
)
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State
from firmware_model.table_one import FIELD, METERING, MODEL, power

pytestmark = pytest.mark.system

THETA = 30
IDS = (1, 2)
POWER = power(LastResort.SURFACE, metering=METERING, low_level=MODEL.segments[0][0])
FLEET = with_whole_boards(
    replace(
        STILL,
        seed=11,
        body=replace(STILL.body, coil_alignment_ms=20_000),
        clock_drift_ppb=400_000,
    ),
    FullFirmware(
        POWER,
        replace(FIELD, alarm_ms=600_000),
        transmit_ms=1000,
        call_ms=600_000,
        hover_ms=300_000,
        timekeeping=Timekeeping(400_000, 120_000),
    ),
)
"""Clocks of up to 400 parts in a million: in doubt, by a guard of 700 ms, within half an hour."""
BIRTHS = {agent_id: resting_on_bottom(0.0, agent_id, 3.0, 0.2, 1.0) for agent_id in IDS}


def word(command: Command) -> SoundArrived:
    return SoundArrived(MusselbedCodec().encode(command))


def story(agent_id: int) -> Story:
    """By seconds of mission time."""
    told: dict[int, AgentStimulus | str] = {
        10: word(SlotAssignment(agent_id, 60_000, 5000, 700, agent_id, -20)),
        12: word(SleepSchedule(agent_id, 900_000, 15_000)),
        14: word(SetThreshold(agent_id, Threshold.LOW_LEVEL, 0.19)),
        40: word(Beacon(agent_id, 40 * 1000 * THETA)),
        50: KILL,
        95: word(HoverAt(agent_id, 1.25)),
        97: KILL,
        105: word(CommandPacket(Kind.SINK, agent_id)),
        190: word(CommandPacket(Kind.PERMISSION, agent_id)),
        194: ContactClosed(5, 5),
        195: KILL,
        200: CoilSlipped(),
        240: ContactOpened(),
    }
    return [(at_s, agent_id, what) for at_s, what in told.items()]


def test_what_boards_were_told_outlives_their_processes(tmp_path: Path) -> None:
    stories, seconds = [it for agent_id in IDS for it in story(agent_id)], [1000] * 300
    policy = RestartPolicy(restarts=100)
    with closing(
        ProcessHost.start(tmp_path, FLEET, BIRTHS, window_timeout_s=60.0, restart_policy=policy)
    ) as host:
        came, told = fly(host, IDS, stories, seconds)
    assert (came, told) == fly(InProcessHost(FLEET, BIRTHS), IDS, stories, seconds)
    states = {truth.state for truth in told}
    assert {
        State.AWAITING_BEACON,
        State.TRANSMITTING,
        State.HOVERING,
        State.CHARGING,
        State.SINKING,
    } <= states
    for agent_id in IDS:
        kept = [truth.physical.kept for truth in told if truth.agent_id == agent_id][-1]
        assert kept is not None
        assert (kept.anchor_ms, kept.reading_ms) == (40_000 * THETA, 40_000 * THETA)
        assert (kept.settings.alarm_ms, kept.settings.slot) == (900_000, agent_id)
