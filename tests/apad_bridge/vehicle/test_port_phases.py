"""Every phase with every event, against a table written by hand here; and the law of cuts."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.scenario.blocks.mission_options import Docking, DockingProfile
from apad_bridge.vehicle.commands import (
    Arrived,
    CloseDock,
    CommandFailed,
    DockClosed,
    DockOpened,
    GoTo,
    Hold,
    OpenDock,
    PoseReported,
    Primitive,
)
from apad_bridge.vehicle.docking_port import DockingEvent, DockingPhase, DockingPort
from apad_bridge.vehicle.outcomes import PrimitiveFailed, PrimitiveSucceeded

DOCKING = Docking(profile=DockingProfile.VIRTUAL, dock_s=15, undock_s=5, timeout_s=60)
OK, BAD, ACT, NOTHING = "succeeds", "fails", "commands the mechanism", "nothing"
EXPECTED = {
    DockingPhase.IDLE: {},
    DockingPhase.GOING: {
        DockingEvent.ARRIVED: OK,
        DockingEvent.COMMAND_FAILED: BAD,
        DockingEvent.TIMED_OUT: BAD,
        DockingEvent.REPLACED: BAD,
    },
    DockingPhase.HOLDING: {DockingEvent.COMMAND_FAILED: BAD, DockingEvent.REPLACED: OK},
    DockingPhase.WAITING: {
        DockingEvent.MECHANISM_DONE: OK,
        DockingEvent.WAIT_OVER: ACT,
        DockingEvent.REPLACED: BAD,
    },
    DockingPhase.ACTING: {
        DockingEvent.MECHANISM_DONE: OK,
        DockingEvent.COMMAND_FAILED: BAD,
        DockingEvent.TIMED_OUT: BAD,
    },
}
# A wait cannot time out: the schema requires a longer timeout_s, so the wait ends in acting first. That nothing is caught
# is found out when a docking starts, in no phase: tests/apad_bridge/vehicle/test_port_primitives.py.
PAIRS = [
    (phase, event)
    for phase, event in itertools.product(DockingPhase, DockingEvent)
    if (phase, event) != (DockingPhase.WAITING, DockingEvent.TIMED_OUT)
    and event is not DockingEvent.NOTHING_CAUGHT
]


ENTERED: dict[DockingPhase, list[tuple[int, Primitive | None]]] = {
    DockingPhase.IDLE: [],
    DockingPhase.GOING: [(20_000, GoTo(1, 50.0, 0.0, 0.5, 0.5))],
    DockingPhase.HOLDING: [(20_000, Hold(1, 0.0, 0.0))],
    DockingPhase.WAITING: [(20_000, CloseDock(1, 0, 9))],
    DockingPhase.ACTING: [(5_000, CloseDock(1, 0, 9)), (20_000, None)],
}
"""What enters a phase, by a port whose primitive has id 1, as its command has: orders, or time that passes."""
HAPPENS: dict[DockingEvent, list[tuple[int, Any]]] = {
    DockingEvent.ARRIVED: [(20_001, Arrived(20_001, 1))],
    DockingEvent.COMMAND_FAILED: [(20_001, CommandFailed(20_001, 1, "?"))],
    DockingEvent.MECHANISM_DONE: [(20_001, DockClosed(20_001, 0, 9))],
    DockingEvent.WAIT_OVER: [(35_000, None)],
    DockingEvent.TIMED_OUT: [(35_000, None), (90_000, None)],
    DockingEvent.REPLACED: [(20_001, GoTo(2, 1.0, 1.0, 0.5, 0.5))],
}
"""Waiting, a little or long, produces the timers' events."""


def actions_of(port: DockingPort, steps: list[tuple[int, Any]]) -> list[object]:
    """The port's actions at the last step."""
    actions: list[object] = []
    for at_ms, it in steps:
        actions = [*(port.advance(at_ms) if it is None else port.receive(it, at_ms))]
    return actions


@pytest.mark.parametrize(("phase", "event"), PAIRS)
def test_every_phase_with_every_event(phase, event):
    port = DockingPort(DOCKING)
    actions_of(port, ENTERED[phase])
    actions = actions_of(port, HAPPENS[event])
    endings = [action for action in actions if isinstance(action, PrimitiveSucceeded | PrimitiveFailed)]
    expected = EXPECTED[phase].get(event, NOTHING)
    assert [(type(ending), ending.primitive_id) for ending in endings] == {
        OK: [(PrimitiveSucceeded, 1)],
        BAD: [(PrimitiveFailed, 1)],
    }.get(expected, [])
    assert any(isinstance(action, CloseDock) for action in actions) == (expected == ACT)


ids = st.integers(1, 6)
metres = st.floats(-5, 5)
END_MS = 200_000
stimuli = st.one_of(
    st.builds(GoTo, ids, metres, metres, st.just(0.5), st.just(0.5)),
    st.builds(Hold, ids, metres, metres),
    st.builds(CloseDock, ids, st.integers(0, 3), ids),
    st.builds(OpenDock, ids, st.integers(0, 3), ids),
    st.builds(PoseReported, st.just(0), metres, metres, st.just(0.0)),
    st.builds(Arrived, st.just(0), ids),
    st.builds(CommandFailed, st.just(0), ids, st.just("?")),
    st.builds(DockClosed, st.just(0), st.integers(-1, 4), ids),
    st.builds(DockOpened, st.just(0), st.integers(-1, 4), ids),
)
moments = st.lists(st.tuples(st.integers(0, END_MS), stimuli), max_size=25).map(
    lambda found: sorted(found, key=lambda moment: moment[0])
)


@settings(deadline=None)
@given(history=moments, cuts_ms=st.lists(st.integers(0, END_MS), max_size=30))
def test_cutting_time_changes_nothing_and_no_primitive_ends_twice_or_never(history, cuts_ms):
    traces = []
    for cuts in ([], cuts_ms):
        port = DockingPort(DOCKING)
        both = [(at_ms, 1, stimulus) for at_ms, stimulus in history] + [(at_ms, 0, None) for at_ms in cuts]
        actions = []
        for at_ms, _, stimulus in sorted(both, key=lambda moment: moment[:2]):
            actions += port.advance(at_ms) if stimulus is None else port.receive(stimulus, at_ms)
        actions += port.advance(END_MS + 200_000)
        traces.append(repr((actions, port.dropped, port.first_failure)))
        ordered = [s for _, s in history if isinstance(s, Primitive)]
        ended = [a for a in actions if isinstance(a, PrimitiveSucceeded | PrimitiveFailed)]
        held = isinstance(port.running, Hold)
        assert len(ended) == len(ordered) - held
        assert held or port.running is None
    assert traces[0] == traces[1]
