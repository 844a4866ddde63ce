"""The law of cuts: any windows, the same facts, byte for byte."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from apad_bridge.scenario.schema import APad
from apad_bridge.vehicle.commands import CloseDock, GoTo, Hold, OpenDock, VehicleCommand
from apad_bridge.world.apad.simulated_apad import SimulatedAPad

metres = st.floats(-6, 6)
docks = st.integers(0, 4)
agents = st.integers(1, 3)
commands = st.one_of(
    st.builds(GoTo, st.just(0), metres, metres, st.floats(0.05, 1.5), st.floats(0.01, 1)),
    st.builds(Hold, st.just(0), metres, metres),
    st.builds(CloseDock, st.just(0), docks, agents),
    st.builds(OpenDock, st.just(0), docks, agents),
)
END_MS = 30_000
histories = st.lists(st.tuples(st.integers(0, END_MS), commands), max_size=8).map(
    lambda found: [
        (at_ms, replace(command, command_id=number))
        for number, (at_ms, command) in enumerate(sorted(found, key=lambda pair: pair[0]), start=1)
    ]
)


def trace(config: APad, history: list[tuple[int, VehicleCommand]], cuts_ms: list[int]) -> str:
    """Every fact in order, and the state at the end, with floats in full."""
    apad = SimulatedAPad(config)
    facts = []
    moments = sorted([(at_ms, 1, command) for at_ms, command in history], key=lambda moment: moment[0])
    cuts = [(at_ms, 0, None) for at_ms in cuts_ms]
    for at_ms, _, command in sorted([*moments, *cuts], key=lambda moment: moment[:2]):
        facts += apad.advance(at_ms) if command is None else apad.receive(command, at_ms)
    facts += apad.advance(END_MS)
    end = (apad.pose, apad.battery.fraction, apad.motion.forces_n, apad.battery.power_w, dict(apad.docked))
    return repr((facts, end))


@pytest.mark.parametrize("capacity_wh", [230, 0.3])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=80)
@given(history=histories, cuts_ms=st.lists(st.integers(0, END_MS), max_size=60))
def test_cutting_time_changes_nothing(config, capacity_wh, history, cuts_ms):
    config = replace(config, battery=replace(config.battery, capacity_wh=capacity_wh))
    assert trace(config, history, cuts_ms) == trace(config, history, [])


def test_a_cut_at_every_millisecond_changes_nothing(config):
    history = [(1234, GoTo(1, 3.0, -2.0, 0.7, 0.2)), (1250, CloseDock(2, 0, 5)), (4001, Hold(3, 0.0, 1.0))]
    assert trace(config, history, list(range(END_MS))) == trace(config, history, [])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=80)
@given(history=histories, thruster_max_n=st.floats(2, 40), drag=st.floats(0, 200))
def test_the_limits_hold_and_the_vehicle_always_ends_at_the_last_goal(config, history, thruster_max_n, drag):
    config = replace(config, thruster_max_n=thruster_max_n, drag_n_per_m2_s2=drag)
    apad = SimulatedAPad(config)
    goal = (0.0, 0.0)
    for at_ms, command in history:
        apad.receive(command, at_ms)
        if isinstance(command, GoTo | Hold):
            goal = (command.north_m, command.east_m)
    now_ms = history[-1][0] // 100 * 100 if history else 0
    apad.advance(now_ms + 100)
    while (apad.pose.north_m, apad.pose.east_m, apad.pose.speed_m_s) != (*goal, 0.0):
        before, now_ms = apad.pose, now_ms + 100
        apad.advance(now_ms + 100)
        after = apad.pose
        change_m_s = abs(complex(after.north_m_s - before.north_m_s, after.east_m_s - before.east_m_s))
        assert change_m_s <= config.max_acceleration_m_s2 * 0.1 + 1e-9
        assert after.speed_m_s <= config.max_speed_m_s + 1e-9
        assert max(abs(force) for force in apad.motion.forces_n) <= thruster_max_n + 1e-9
        assert now_ms < END_MS + 600_000


def test_time_going_back_is_refused(config):
    apad = SimulatedAPad(config)
    apad.advance(500)
    for back in (lambda: apad.advance(499), lambda: apad.receive(Hold(1, 0.0, 0.0), 499)):
        with pytest.raises(ValueError, match="back"):
            back()


def test_at_rest_it_is_due_once_a_second(config):
    apad = SimulatedAPad(config)
    dues = [(apad.next_due_ms, len(apad.advance(apad.next_due_ms))) for _ in range(5)]
    assert dues == [(1000 * n, 2) for n in range(5)]
