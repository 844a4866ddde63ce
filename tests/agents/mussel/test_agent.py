"""An agent's own laws: cuts of time and resets do not change its outputs."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from fleets import PAPER, STILL
from hypothesis import example, given, settings
from hypothesis import strategies as st

from agents.fleet import FleetConfig, resting_on_bottom
from agents.mussel.agent import Agent
from agents.mussel.outputs import Output, StimulusDropped, Truth, WifiSent
from agents.mussel.stimuli import (
    AgentStimulus,
    BuoyancyJammed,
    ChargeLost,
    ContactBounced,
    ContactClosed,
    ContactOpened,
    DockMoved,
    PinDisturbed,
    Placed,
    SoundArrived,
    WasReset,
    WifiArrived,
)
from firmware_model.packets import CommandPacket, Kind, StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.power.charge import grains
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

CODEC = MusselbedCodec()
PERMISSION = CODEC.encode(CommandPacket(Kind.PERMISSION, 7))
RELEASE = CODEC.encode(CommandPacket(Kind.RELEASE, 7))
STIMULI: tuple[AgentStimulus, ...] = (
    SoundArrived(PERMISSION),
    SoundArrived(b"noise"),
    WifiArrived(RELEASE),
    ContactClosed(3_000_000, -1_000_000),
    DockMoved(5_000_000, 2_000_000),
    ContactOpened(),
    Placed(1_000_000, 2_000_000, 3_000_000, grains(0.4), grains(0.9)),
    WasReset(ResetCause.BROWN_OUT),
    ChargeLost(grains(0.3), grains(0.1)),
    BuoyancyJammed(1),
    BuoyancyJammed(0),
    PinDisturbed(1, 0),
    PinDisturbed(0, 1),
    PinDisturbed(0, 0),
    ContactBounced(3),
    ContactBounced(60),
)
FLEET = PAPER
END_MS = 2_000_000


@dataclass(frozen=True)
class Reset:
    """A kill -9: a new agent from the physical state."""


def agent(charge: float = 0.5, fleet: FleetConfig = FLEET) -> Agent:
    physical = resting_on_bottom(1.0, 2.0, 3.0, charge, 1.0)
    return Agent(fleet.maker().config(7), CODEC, physical, 0, ResetCause.POWER_ON)


def live(
    story: list[tuple[int, AgentStimulus | Reset]], cuts: list[int], charge: float, fleet: FleetConfig
) -> tuple[list[Output], list[Truth]]:
    """Outputs and truths up to END_MS; a cut does nothing but advance."""
    mussel = agent(charge, fleet)
    outputs: list[Output] = []
    truths: list[Truth] = []
    moments: list[tuple[int, AgentStimulus | Reset | None]] = [*story, *((at_ms, None) for at_ms in cuts)]
    for at_ms, event in sorted(moments, key=lambda it: (it[0], it[1] is not None)):
        if isinstance(event, Reset):
            outputs += mussel.advance(at_ms)
            truths += mussel.take_truths()
            mussel = Agent(mussel.config, CODEC, mussel.physical, at_ms, ResetCause.BROWN_OUT)
        elif event is None:
            outputs += mussel.advance(at_ms)
        else:
            outputs += mussel.receive(event, at_ms)
        truths += mussel.take_truths()
    outputs += mussel.advance(END_MS)
    return outputs, truths + mussel.take_truths()


TIMES = st.integers(0, END_MS // 10_000).map(lambda step: step * 10_000) | st.integers(0, END_MS)
EVENTS = st.sampled_from([*STIMULI, Reset()])


@settings(max_examples=60, deadline=None)
@given(
    story=st.lists(st.tuples(TIMES, EVENTS), max_size=12, unique_by=lambda it: it[0]),
    cuts=st.lists(TIMES, max_size=20),
    charge=st.sampled_from([0.0, 0.01, 0.5, 1.0]),
    fleet=st.sampled_from([FLEET, STILL]),
)
@example(  # it leaves the surface, and time is cut on the way down: its next report is due under water
    story=[
        (20_000, SoundArrived(PERMISSION)),
        (400_000, ContactClosed(3_000_000, -1_000_000)),
        (600_100, ContactOpened()),
        (600_200, WifiArrived(RELEASE)),
    ],
    cuts=[610_000],
    charge=0.5,
    fleet=STILL,
)
def test_any_cuts_give_the_same_life(
    story: list[tuple[int, AgentStimulus | Reset]], cuts: list[int], charge: float, fleet: FleetConfig
) -> None:
    assert live(story, cuts, charge, fleet) == live(story, [], charge, fleet)


def states(mussel: Agent) -> list[State]:
    return [truth.state for truth in mussel.take_truths()]


@pytest.fixture
def mussel() -> Agent:
    return agent()


def test_reports_come_each_period_once_it_has_booted() -> None:
    reports = [out for out in agent().advance(95_000) if isinstance(out, WifiSent)]
    assert [report.at_ms for report in reports] == [30_000, 60_000, 90_000]
    packets = [CODEC.decode(report.data) for report in reports]
    assert [packet.sequence for packet in packets if isinstance(packet, StatusPacket)] == [0, 1, 2]


@pytest.mark.parametrize(
    ("stimulus", "reason"),
    [
        (ContactClosed(0, 0), "a dock closed, but not around this aMussel"),
        (DockMoved(0, 0), "a dock moved that does not hold this aMussel"),
        (ContactOpened(), "a dock opened that does not hold this aMussel"),
        (SoundArrived(b"noise"), "not a command"),
    ],
)
def test_what_cannot_be_is_dropped_with_a_reason(mussel: Agent, stimulus: AgentStimulus, reason: str) -> None:
    mussel.advance(5_000)
    before = mussel.physical
    assert mussel.receive(stimulus, 5_000) == [StimulusDropped(5_000, 7, reason)]
    assert mussel.physical == before


def test_time_never_goes_back(mussel: Agent) -> None:
    mussel.advance(10_000)
    with pytest.raises(ValueError, match="time went back: 9999 before 10000"):
        mussel.advance(9_999)
