"""Every phase with every event, against a table written by hand here; and the law of cuts."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from apad_bridge.scenario.schema import Docking, DockingProfile
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


def port_in(phase: DockingPhase) -> DockingPort:
    """A port whose primitive has id 1, whose command (if any) has id 1, at time 20 000 ms."""
    port = DockingPort(DOCKING)
    if phase is DockingPhase.GOING:
        port.receive(GoTo(1, 50.0, 0.0, 0.5, 0.5), 20_000)
    elif phase is DockingPhase.HOLDING:
        port.receive(Hold(1, 0.0, 0.0), 20_000)
    elif phase is DockingPhase.WAITING:
        port.receive(CloseDock(1, 0, 9), 20_000)
    elif phase is DockingPhase.ACTING:
        port.receive(CloseDock(1, 0, 9), 5_000)
        port.advance(20_000)
    return port


def happens(port: DockingPort, event: DockingEvent) -> list[object]:
    """The port's actions after `event`; waiting, a little or long, produces the timers' events."""
    match event:
        case DockingEvent.ARRIVED:
            return list(port.receive(Arrived(20_001, 1), 20_001))
        case DockingEvent.COMMAND_FAILED:
            return list(port.receive(CommandFailed(20_001, 1, "?"), 20_001))
        case DockingEvent.MECHANISM_DONE:
            return list(port.receive(DockClosed(20_001, 0, 9), 20_001))
        case DockingEvent.WAIT_OVER:
            return list(port.advance(35_000))
        case DockingEvent.TIMED_OUT:
            port.advance(35_000)
            return list(port.advance(90_000))
        case DockingEvent.REPLACED:
            return list(port.receive(GoTo(2, 1.0, 1.0, 0.5, 0.5), 20_001))


@pytest.mark.parametrize(("phase", "event"), PAIRS)
def test_every_phase_with_every_event(phase, event):
    actions = happens(port_in(phase), event)
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
