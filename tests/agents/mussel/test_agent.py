"""An agent of the worst case: its reports, and what it drops."""

from __future__ import annotations

import pytest
from fleets import PAPER

from agents.fleet_config import resting_on_bottom
from agents.mussel.agent import Agent
from agents.mussel.outputs import StimulusDropped, WifiSent
from agents.mussel.stimuli import (
    AgentStimulus,
    ContactClosed,
    ContactOpened,
    DockMoved,
    SoundArrived,
)
from firmware_model.packets import StatusPacket
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.stimuli import ResetCause

CODEC = MusselbedCodec()


@pytest.fixture
def mussel() -> Agent:
    physical = resting_on_bottom(1.0, 2.0, 3.0, 0.5, 1.0)
    return Agent(PAPER.maker().config(7), CODEC, physical, 0, ResetCause.POWER_ON)


def test_reports_come_each_period_once_it_has_booted(mussel: Agent) -> None:
    reports = [out for out in mussel.advance(95_000) if isinstance(out, WifiSent)]
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
