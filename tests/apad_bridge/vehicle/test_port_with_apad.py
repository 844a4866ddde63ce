"""The port with the simulated aPad: one collection and one release, from primitive to outcome."""

from __future__ import annotations

import heapq
from dataclasses import replace

import pytest
from scenario_files import POOL_FILE

from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Docking, DockingProfile
from apad_bridge.vehicle.commands import CloseDock, GoTo, OpenDock
from apad_bridge.vehicle.docking_port import DockingPort
from apad_bridge.vehicle.outcomes import DockChanged, PrimitiveFailed, PrimitiveSucceeded
from apad_bridge.world.apad.apad import SimulatedAPad

APAD = replace(load(POOL_FILE).apad, start_m=(0.0, 0.0))
VIRTUAL = Docking(profile=DockingProfile.VIRTUAL, dock_s=15, undock_s=5, timeout_s=60)


class Bench:
    """Port and vehicle, advanced from due time to due time; every fact goes straight to the port."""

    def __init__(self) -> None:
        self.apad, self.port, self.now_ms = SimulatedAPad(APAD), DockingPort(VIRTUAL), 0

    def outcome_of(self, primitive, until_ms: int):
        """Run until the primitive has ended; return its outcome and the dock changes on the way."""
        changes = []
        pending = list(self.port.receive(primitive, self.now_ms))
        while True:
            while pending:
                action = pending.pop(0)
                if isinstance(action, PrimitiveSucceeded | PrimitiveFailed):
                    return action, changes
                if isinstance(action, DockChanged):
                    changes.append(action)
                    continue
                for fact in self.apad.receive(action, self.now_ms):
                    pending += self.port.receive(fact, self.now_ms)
            dues = [due for due in (self.port.next_due_ms, self.apad.next_due_ms) if due is not None]
            heapq.heapify(dues)
            self.now_ms = dues[0]
            assert self.now_ms <= until_ms, "the primitive did not end"
            for fact in self.apad.advance(self.now_ms):
                pending += self.port.receive(fact, self.now_ms)
            pending += self.port.advance(self.now_ms)


def test_collect_one_and_let_it_go_again():
    bench = Bench()
    arrived, _ = bench.outcome_of(GoTo(1, 14.0, 0.0, 0.5, 0.5), 60_000)
    assert isinstance(arrived, PrimitiveSucceeded)
    # about 29.7 s to rest; half a metre of mean distance is reached somewhat earlier
    assert 27_000 < arrived.at_ms < 29_700
    docked, changes = bench.outcome_of(CloseDock(2, 1, 9), 90_000)
    assert docked == PrimitiveSucceeded(arrived.at_ms + 15_000, 2)
    assert [(change.dock_index, change.agent_id, change.closed) for change in changes] == [(1, 9, True)]
    assert dict(bench.apad.docked) == dict(bench.port.docked) == {1: 9}
    assert bench.apad.dock_position(1) == pytest.approx((13.9, 0.1))
    undocked, changes = bench.outcome_of(OpenDock(3, 1, 9), 90_000)
    assert undocked == PrimitiveSucceeded(docked.at_ms + 5_000, 3)
    assert [(change.dock_index, change.agent_id, change.closed) for change in changes] == [(1, 9, False)]


def test_a_taken_dock_is_refused_by_the_vehicle_and_told_with_its_reason():
    bench = Bench()
    bench.outcome_of(CloseDock(1, 0, 5), 30_000)
    refused, _ = bench.outcome_of(CloseDock(2, 0, 6), 60_000)
    assert isinstance(refused, PrimitiveFailed)
    assert refused.reason == "dock 1 holds aMussel 5"
