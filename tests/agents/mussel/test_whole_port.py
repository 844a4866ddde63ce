"""The whole board in C, in a process of its own: an agent with it lives the life of ours, byte for byte."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from fleets import STILL
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from native_boards import compiled

from agents.fleet import resting_on_bottom
from agents.mussel.agent import Agent, AgentConfig
from agents.mussel.outputs import Output, Truth
from agents.mussel.stimuli import (
    CoilSlipped,
    ContactClosed,
    ContactOpened,
    PinDisturbed,
    PingArrived,
    Placed,
    SoundArrived,
    Stimulus,
    WasReset,
    WifiArrived,
)
from firmware_model.config import LastResort, Timekeeping
from firmware_model.packets import (
    PLAIN_KINDS,
    Beacon,
    Command,
    CommandPacket,
    HoverAt,
    Kind,
    LogAck,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    Threshold,
)
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.charge import FULL, grains
from firmware_model.states import State
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import FIELD, METERING, board, power

CODEC = MusselbedCodec()
CYCLE = replace(FIELD, alarm_ms=200_000)
WATER = replace(STILL, body=replace(STILL.body, coil_alignment_ms=20_000)).maker().config(7).water
OURS = AgentConfig(board(CYCLE, power(LastResort.CALL), agent_id=7), WATER, STILL.reports)
_METERED = board(CYCLE, power(LastResort.SURFACE, metering=METERING, low_level=FULL // 2), agent_id=7)
assert _METERED.whole is not None
METERED = replace(
    OURS,
    board=replace(
        _METERED,
        drift_ppb=-20_000,
        whole=replace(_METERED.whole, timekeeping=Timekeeping(50_000, 30_000), stay_down_ms=300_000),
    ),
)
AWAKE = replace(OURS, board=board(None, power(LastResort.CALL), agent_id=7))
PAPER = replace(OURS, reports=replace(STILL.reports, heard_always=True))
CONFIGS = {"calls": OURS, "metered, surfaces": METERED, "never sleeps": AWAKE, "heard always": PAPER}
COMMANDS: tuple[Command, ...] = (
    *(CommandPacket(kind, 7) for kind in sorted(PLAIN_KINDS)),
    CommandPacket(Kind.PING, 0),
    CommandPacket(Kind.SINK, 9),
    Beacon(7, 500_000),
    Beacon(0, 1_500_000),
    Beacon(7, 1 << 60),
    SleepSchedule(7, 150_000, 20_000),
    SleepSchedule(7, 20_000, 150_000),
    SlotAssignment(7, 60_000, 4000, 1500, 3, -20),
    SlotAssignment(7, 60_000, 4000, 1500, 15, 0),
    SetThreshold(7, Threshold.SAFE_LEVEL, 0.1),
    SetThreshold(7, Threshold.LOW_LEVEL, 0.8),
    HoverAt(7, 1.25),
    HoverAt(7, 0.0),
    LogAck(7, 2),
    LogAck(7, 9999),
)
STIMULI: tuple[Stimulus, ...] = (
    *(SoundArrived(CODEC.encode(command)) for command in COMMANDS),
    *(WifiArrived(CODEC.encode(command)) for command in COMMANDS),
    SoundArrived(b"wrong"),
    WifiArrived(b""),
    *(ContactClosed(0, 0), ContactOpened(), CoilSlipped()) * 3,
    PingArrived(1000),
    PinDisturbed(False, True),
    Placed(1_000_000, 2_000_000, 3_000_000, grains(0.4), grains(0.9)),
    WasReset(ResetCause.BROWN_OUT),
)
END_MS = 2_000_000
TIMES = st.integers(0, END_MS)
Story = list[tuple[int, Stimulus]]


@pytest.fixture(scope="module")
def c_board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory, "whole_board")


def life(
    config: AgentConfig, story: Story, cuts: list[int], charges: tuple[float, float]
) -> tuple[list[Output], list[Truth]]:
    mussel = Agent(config, CODEC, resting_on_bottom(1.0, 2.0, 3.0, *charges), 0, ResetCause.POWER_ON)
    outputs: list[Output] = []
    moments = [(at_ms, 1, stimulus) for at_ms, stimulus in story] + [(at_ms, 0, None) for at_ms in cuts]
    for at_ms, _, stimulus in sorted(moments, key=lambda it: it[:2]):
        outputs += mussel.advance(at_ms) if stimulus is None else mussel.receive(stimulus, at_ms)
    outputs += mussel.advance(END_MS)
    mussel.close()
    return outputs, mussel.take_truths()


def is_sending_cut_short(truths: list[Truth]) -> bool:
    """True if something ended a transmission: on the C board the modem then sends to its end."""
    return any(
        before.state in (State.TRANSMITTING, State.CALLING)
        and after.state not in (before.state, State.SLEEPING, State.EMPTY)
        for before, after in pairwise(truths)
    )


@pytest.mark.parametrize("name", CONFIGS)
@settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(
    story=st.lists(st.tuples(TIMES, st.sampled_from(STIMULI)), max_size=12, unique_by=lambda it: it[0]),
    cuts=st.lists(TIMES, max_size=6),
    charges=st.sampled_from([(0.0, 0.0), (0.001, 0.15), (0.01, 1.0), (0.9, 1.0), (0.5001, 1.0)]),
)
def test_it_lives_the_life_of_our_board(
    c_board: Path, name: str, story: Story, cuts: list[int], charges: tuple[float, float]
) -> None:
    """Any stimuli at any times, and for the C board any further cuts: the same packets, refusals and physical states."""
    config = CONFIGS[name]
    outputs, truths = life(config, story, [], charges)
    assume(not is_sending_cut_short(truths))
    theirs = life(replace(config, firmware=(str(c_board),)), story, cuts, charges)
    assert theirs[0] == outputs
    assert theirs[1] == truths
