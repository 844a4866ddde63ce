"""A motor run that does not bring an aMussel up: it stays on the bottom, gives up in time, and may try again."""

from __future__ import annotations

from dataclasses import replace

from fleets import STILL
from hypothesis import given
from hypothesis import strategies as st

from agents.fleet_config import resting_on_bottom
from agents.mussel.agent import Agent
from agents.mussel.body import surfacing_fails
from agents.mussel.outputs import Output, StimulusDropped
from agents.mussel.stimuli import SoundArrived
from firmware_model.packets import CommandPacket, Kind
from firmware_model.packets.codec import MusselbedCodec
from firmware_model.states import State
from firmware_model.stimuli import ResetCause

PERMISSION = CommandPacket(Kind.PERMISSION, 7)
GIVEN_UP = "a surfacing: it did not come up in time"


def agent_that_fails(failure_ppm: int) -> Agent:
    fleet = replace(STILL, body=replace(STILL.body, surfacing_failure_ppm=failure_ppm))
    config = fleet.maker().config(7)
    bottom_m = fleet.body.sinking.bottom_um / 1e6
    physical = resting_on_bottom(1.0, 2.0, bottom_m, 0.9, 1.0)
    return Agent(config, MusselbedCodec(), physical, 0, ResetCause.POWER_ON)


def permit(agent: Agent, now_ms: int) -> list[Output]:
    return agent.receive(SoundArrived(MusselbedCodec().encode(PERMISSION)), now_ms)


def test_one_in_a_hundred_fails_and_no_more() -> None:
    failures = sum(
        surfacing_fails(3, agent_id, at_ms, 10_000) for agent_id in range(100) for at_ms in range(200)
    )
    assert 150 <= failures <= 250
    assert not any(surfacing_fails(3, 7, at_ms, 0) for at_ms in range(1000))


def test_one_that_does_not_come_up_gives_up_says_so_and_can_be_permitted_again() -> None:
    agent = agent_that_fails(1_000_000)
    timeout_ms = agent.config.board.surfacing_timeout_ms
    for permitted_ms in (10_000, 10_000 + 2 * timeout_ms):
        permit(agent, permitted_ms)
        agent.advance(permitted_ms + timeout_ms - 1)
        assert agent.board.state is State.SURFACING
        outputs = agent.advance(permitted_ms + timeout_ms)
        assert GIVEN_UP in [output.reason for output in outputs if isinstance(output, StimulusDropped)]
        assert agent.board.state is State.ACTIVE  # on the bottom, where it was
        assert agent.body.rests_on_bottom


def test_one_that_comes_up_never_gives_up() -> None:
    agent = agent_that_fails(0)
    permit(agent, 10_000)
    outputs = agent.advance(10_000 + 3 * agent.config.board.surfacing_timeout_ms)
    assert agent.board.state is State.FLOATING
    assert GIVEN_UP not in [output.reason for output in outputs if isinstance(output, StimulusDropped)]


@given(st.lists(st.integers(1, 400_000), max_size=12))
def test_however_time_is_cut_the_same_surfacings_fail(cuts_ms: list[int]) -> None:
    states = []
    for cuts in ([], cuts_ms):
        agent = agent_that_fails(500_000)
        trace = []
        moments = sorted(
            [(at_ms, 0) for at_ms in cuts] + [(at_ms, 1) for at_ms in range(10_000, 400_000, 30_000)]
        )
        for at_ms, is_permission in moments:
            if is_permission:
                permit(agent, at_ms)
                trace.append((agent.board.state, agent.body.depth_at_um(at_ms)))
            else:
                agent.advance(at_ms)
        states.append(trace)
    assert states[0] == states[1]
