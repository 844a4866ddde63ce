"""Cuts, resets and the wire change nothing of an agent; and an agent with the whole firmware lives as its board says."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fleets import PAPER, STILL
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agents.fleet_config import resting_on_bottom
from agents.mussel.agent import Agent, AgentConfig
from agents.mussel.outputs import Output, SoundSent, Truth
from agents.mussel.physical import Physical
from agents.mussel.stimuli import (
    AgentStimulus,
    BuoyancyJammed,
    ChargeLost,
    CoilSlipped,
    ContactBounced,
    ContactClosed,
    ContactOpened,
    DockMoved,
    ModemSent,
    PinDisturbed,
    PingArrived,
    Placed,
    SoundArrived,
    WasReset,
    WifiArrived,
)
from firmware_model.config import LastResort, Timekeeping
from firmware_model.packets import (
    PLAIN,
    AcousticStatus,
    Beacon,
    Command,
    CommandPacket,
    HoverAt,
    Kind,
    SetThreshold,
    SleepSchedule,
    SlotAssignment,
    StatusPacket,
    Threshold,
)
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.packets.sample_record import RECORD_BYTES
from firmware_model.power.charge import FULL, Flow, grains
from firmware_model.sampling.flash import MemoryFlash
from firmware_model.states import State
from firmware_model.stimuli import ResetCause
from firmware_model.table_one import FIELD, METERING, board, power
from tests.agents.mussel.test_defects import Step, lived

CODEC = MusselbedCodec()
COMMANDS = {kind: CODEC.encode(CommandPacket(kind, 7)) for kind in sorted(PLAIN)}
WATER = replace(STILL, body=replace(STILL.body, coil_alignment_ms=20_000)).maker().config(7).water
CYCLE = replace(FIELD, alarm_ms=200_000)
CONFIG = AgentConfig(board(CYCLE, power(LastResort.CALL), agent_id=7), WATER, STILL.reports)
_FIELD = board(CYCLE, power(LastResort.SURFACE, metering=METERING, low_level=FULL // 2), agent_id=7)
assert _FIELD.whole is not None
DRIFTING = replace(
    CONFIG,
    board=replace(
        _FIELD,
        drift_ppb=-40_000_000,
        whole=replace(_FIELD.whole, timekeeping=Timekeeping(50_000_000, 30_000), stay_down_ms=300_000),
    ),
)
"""Its clock is so bad, with so wide a bound, that half an hour has the events of days."""
WORDS: tuple[Command, ...] = (
    Beacon(7, 500_000),
    Beacon(0, 1_500_000),
    SleepSchedule(7, 150_000, 20_000),
    SlotAssignment(7, 60_000, 4000, 1500, 3, -20),
    SetThreshold(7, Threshold.SAFE_LEVEL, 0.1),
    HoverAt(7, 1.25),
)
STIMULI: tuple[AgentStimulus, ...] = (
    *(SoundArrived(data) for data in COMMANDS.values()),
    *(SoundArrived(CODEC.encode(word)) for word in WORDS),
    WifiArrived(COMMANDS[Kind.RELEASE]),
    ContactClosed(0, 0),
    ContactOpened(),
    CoilSlipped(),
    PingArrived(1000),
    ModemSent(393),
    Placed(1_000_000, 2_000_000, 3_000_000, grains(0.4), grains(0.9)),
    WasReset(ResetCause.BROWN_OUT),
    SoundArrived(b"noise"),
    DockMoved(5_000_000, 2_000_000),
    ChargeLost(grains(0.3), grains(0.1)),
    *(BuoyancyJammed(jammed) for jammed in (0, 1)),
    *(PinDisturbed(high, blind) for high, blind in ((1, 0), (0, 1), (0, 0))),
    *(ContactBounced(times) for times in (3, 60)),
)
WORST_CASES = (PAPER.maker().config(7), STILL.maker().config(7))
END_MS = 2_000_000


def agent(
    primary: float = 0.9,
    secondary: float = 1.0,
    flash: MemoryFlash | None = None,
    config: AgentConfig = CONFIG,
) -> Agent:
    physical = resting_on_bottom(1.0, 2.0, 3.0, primary, secondary)
    return Agent(config, CODEC, physical, 0, ResetCause.POWER_ON, flash)


def live(
    config: AgentConfig,
    story: list[tuple[int, AgentStimulus | None]],
    cuts: list[int],
    charges: tuple[float, float],
    packed: bool,
) -> tuple[list[Output], list[Truth]]:
    """Outputs and truths up to END_MS; None is a reset, over the wire when `packed`."""
    flash = MemoryFlash(3, 2 * RECORD_BYTES)
    mussel = agent(*charges, flash, config)
    outputs: list[Output] = []
    truths: list[Truth] = []
    moments = [(at_ms, 1, stimulus) for at_ms, stimulus in story] + [(at_ms, 0, None) for at_ms in cuts]
    for at_ms, is_event, stimulus in sorted(moments, key=lambda it: it[:2]):
        outputs += mussel.advance(at_ms)
        if is_event and stimulus is None:
            truths += mussel.take_truths()
            physical = mussel.physical
            if packed:
                physical = Physical.unpack(physical.pack())
            mussel = Agent(config, CODEC, physical, at_ms, ResetCause.BROWN_OUT, flash)
        elif stimulus is not None:
            outputs += mussel.receive(stimulus, at_ms)
    outputs += mussel.advance(END_MS)
    return outputs, truths + mussel.take_truths()


TIMES = st.integers(0, END_MS // 10_000).map(lambda step: step * 10_000) | st.integers(0, END_MS)


@settings(max_examples=120, deadline=None)
@given(
    config=st.sampled_from([CONFIG, DRIFTING, *WORST_CASES]),
    story=st.lists(
        st.tuples(TIMES, st.sampled_from([*STIMULI, None])), max_size=12, unique_by=lambda it: it[0]
    ),
    cuts=st.lists(TIMES, max_size=20),
    charges=st.sampled_from([(0.0, 0.0), (0.001, 0.15), (0.01, 1.0), (0.9, 1.0)]),
)
@example(  # it leaves the surface, and time is cut on the way down: its next report is due under water
    config=WORST_CASES[1],
    story=[
        (20_000, SoundArrived(COMMANDS[Kind.PERMISSION])),
        (400_000, ContactClosed(3_000_000, -1_000_000)),
        (600_100, ContactOpened()),
        (600_200, WifiArrived(COMMANDS[Kind.RELEASE])),
    ],
    cuts=[610_000],
    charges=(0.5, 1.0),
)
def test_any_cuts_and_the_wire_give_the_same_life(
    config: AgentConfig,
    story: list[tuple[int, AgentStimulus | None]],
    cuts: list[int],
    charges: tuple[float, float],
) -> None:
    assert live(config, story, cuts, charges, packed=True) == live(config, story, [], charges, packed=False)


def test_it_hovers_at_the_depth_that_it_is_told_and_a_reset_leaves_it_there() -> None:
    """From 3 m, at 3 m in 60 s: 1.75 m take 35 s. 1.5 m down at 3 m in 45 s, and no deeper than the bottom."""
    mussel = agent()
    told = (70_000, [SoundArrived(CODEC.encode(HoverAt(7, 1.25)))], {})
    lived(mussel, [told, (90_000, [], {"depth_m": 2.0})])
    again = Agent(CONFIG, CODEC, Physical.unpack(mussel.physical.pack()), 90_000, ResetCause.BROWN_OUT)
    lived(again, [(105_000, [], {"depth_m": 1.25}), (500_000, [], {"depth_m": 1.25})])
    deeper = (100_000, [SoundArrived(CODEC.encode(HoverAt(7, 60.0)))], {})
    on_bottom = {"state": State.HOVERING, "depth_m": 3.0}
    lived(mussel, [deeper, (115_000, [], {"depth_m": 2.5}), (200_000, [], on_bottom)])


def reported(config: AgentConfig) -> tuple[int, StatusPacket]:
    """The time of its first status by sound, and the status."""
    sounds = [output for output in agent(config=config).advance(400_000) if isinstance(output, SoundSent)]
    packet = CODEC.decode(sounds[0].data)
    assert isinstance(packet, AcousticStatus)
    return sounds[0].at_ms, packet


def test_a_status_says_what_the_board_knows_its_readings_and_its_own_time() -> None:
    drifting = replace(CONFIG, board=replace(CONFIG.board, drift_ppb=1_000_000))
    at_ms, said = reported(drifting)
    # A thousandth fast: its 300 s are 299 701 ms, rounded up.
    assert (at_ms, said.agent_ms) == (299_701, 300_000)
    _, exact = reported(CONFIG)
    _, read = reported(replace(CONFIG, board=board(CYCLE, power(metering=METERING), agent_id=7)))
    # 3 mV of 600 at most, and not the 67 that the transmission itself takes.
    assert 0 < abs(read.primary - exact.primary) < 0.0051


def test_what_it_was_told_outlives_its_process() -> None:
    mussel = agent(config=DRIFTING)
    for at_ms, word in enumerate(WORDS, 70_000):
        mussel.receive(SoundArrived(CODEC.encode(word)), at_ms)
    physical = Physical.unpack(mussel.physical.pack())
    assert physical == mussel.physical
    again = Agent(DRIFTING, CODEC, physical, 100_000, ResetCause.BROWN_OUT)
    assert again.board.kept == mussel.board.kept is not None
    assert again.board.clock_ms(100_000) == mussel.board.clock_ms(100_000)


RELEASED, FLOATING, CHARGING = State.RELEASED, State.FLOATING, State.CHARGING
CONTACT: list[Step] = [
    (70_000, [SoundArrived(COMMANDS[Kind.PERMISSION])], {}),
    (140_000, [ContactClosed(0, 0)], {"pin": (False, 160_000)}),
]
"""At the surface since 130 s; a dock closes at 140 s, and its coils are aligned at 160 s."""
DOCKED: dict[str, list[Step]] = {
    "the charger starts when the coils are aligned and not at the contact": [
        *CONTACT,
        (160_049, [], {"state": FLOATING, "flow": Flow.CHARGING, "anchor_ms": 160_000}),
        (160_050, [], {"state": CHARGING}),
    ],
    "coils that slip release nothing when they align again in time": [
        *CONTACT,
        (163_000, [CoilSlipped()], {}),
        (163_050, [], {"state": RELEASED, "flow": Flow.DISCHARGING}),
        (183_050, [], {"state": CHARGING, "flow": Flow.CHARGING}),
    ],
    # Over and over: after 120 s without the charger it believes that it is free.
    "a body that a dock holds does not sink until it is let go": [
        *CONTACT,
        *((at_ms, [CoilSlipped()], {}) for at_ms in range(170_000, 310_000, 15_000)),
        (310_000, [], {"state": State.SINKING, "depth_m": 0.0}),
        (310_000, [ContactOpened()], {}),
        (355_000, [], {"state": State.ACTIVE, "depth_m": 3.0}),
    ],
}


@pytest.mark.parametrize("steps", DOCKED.values(), ids=DOCKED)
def test_what_a_dock_does_to_it(steps: list[Step]) -> None:
    lived(agent(0.5, 0.5), steps)
