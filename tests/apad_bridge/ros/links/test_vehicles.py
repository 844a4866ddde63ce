"""Opening the link to an aPad whose generation only the live graph tells."""

from __future__ import annotations

from dataclasses import replace

import pytest

from apad_bridge.ros.links import vehicles
from apad_bridge.scenario.choices import Generation
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario
from apad_bridge.vehicle.guards.gate import plain_safety
from apad_bridge.vehicle.link_errors import VehicleNotReady


def test_more_docks_than_a_live_apad_can_name_are_refused(
    pool: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(vehicles, "live_generation", lambda name, timeout_s: Generation.B)
    six = replace(pool, apad=replace(pool.apad, docks=6))
    options = RunOptions(BenchPart.WHOLE, APadKind.ROS, TimeSource.WALL, 1.0, OnDeath.WAIT)
    with pytest.raises(
        VehicleNotReady, match=r"apad1 is of generation B, which can name 4 docks, and apad.docks is 6"
    ):
        vehicles.open_apad(six, options, plain_safety().gate, {}, 0, lambda now_ms: [])
