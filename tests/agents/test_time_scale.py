"""Tests the two clocks by hand calculation: what has happened has a mission time at which it has happened."""

import pytest

from agents.time_scale import AgentMs, MissionMs, TimeScale


@pytest.mark.parametrize(
    ("agent_ms", "mission_ms"), [(0, 0), (1, 1), (29, 1), (30, 1), (31, 2), (90_000, 3_000), (-1, 0)]
)
def test_an_agents_event_has_happened_at_its_mission_time(agent_ms, mission_ms):
    assert TimeScale(30).mission_ms(AgentMs(agent_ms)) == mission_ms


def test_a_mission_second_is_theta_agent_seconds():
    scale = TimeScale(30)
    assert scale.agent_ms(MissionMs(1_000)) == 30_000 and scale.agent_span(60) == 1_800
    assert scale.mission_span(59) == 1 and scale.agent_time(0.5) == 15.0
    assert scale.mission_time(45) == 1.5


def test_real_time_needs_both_clocks_alike():
    assert TimeScale(1).is_real
    assert not TimeScale(2).is_real


@pytest.mark.parametrize("theta", [0, -1])
def test_a_clock_that_stands_or_goes_back_is_refused(theta):
    with pytest.raises(ValueError, match="theta is a positive integer"):
        TimeScale(theta)
