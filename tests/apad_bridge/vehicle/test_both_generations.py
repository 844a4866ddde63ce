"""Properties that the cores and the simulated vehicles of both generations share."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from scenario_files import POOL_FILE

from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from apad_bridge.vehicle.generation_a.core import GenerationACore
from apad_bridge.vehicle.generation_a.docks import ReportedDocks
from apad_bridge.vehicle.generation_b.core import GenerationBCore
from apad_bridge.vehicle.stack_messages import BatteryReceived, StateRefReceived
from apad_bridge.world.apad.dock_mechanisms import Misses
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_a.vehicle import GenerationAVehicle
from apad_bridge.world.generation_b.docks import BenchDocks
from apad_bridge.world.generation_b.vehicle import GenerationBVehicle
from apad_bridge.world.simulated_stack import PosePublished

POOL = load(POOL_FILE)
BATTERY_V = (10.5, 16.0)
Core = GenerationACore | GenerationBCore
Vehicle = GenerationAVehicle | GenerationBVehicle


@pytest.fixture(params=["a", "b"])
def core(request: pytest.FixtureRequest) -> Core:
    if request.param == "a":
        return GenerationACore(ReportedDocks(range(1, 10)), BATTERY_V, "run")
    return GenerationBCore(BenchDocks(range(1, 10), Misses(1, 0.0)), BATTERY_V, POOL.mission.docking)


@pytest.fixture(params=["a", "b"])
def made_at(request: pytest.FixtureRequest) -> Callable[[int], Vehicle]:
    """A vehicle whose time begins at `start_ms`."""
    if request.param == "a":
        return lambda start_ms: GenerationAVehicle(SimulatedAPad(POOL.apad), 0.5, 0.5, start_ms)
    return lambda start_ms: GenerationBVehicle(SimulatedAPad(POOL.apad), start_ms)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e308, -1e308])
def test_a_number_out_of_range_is_dropped_and_counted(core: Core, bad: float) -> None:
    core.receive(PoseReported(0, bad, 0.0, 0.0), 0)
    core.receive(PoseReported(0, 0.0, 0.0, bad), 0)
    core.receive(BatteryReceived(0, bad), 0)
    assert core.advance(0) == []
    assert core.dropped == {
        "position: north_m is outside -50000 to 50000": 1,
        "position: yaw_rad is outside -1000 to 1000": 1,
        "battery_level: battery_percent is outside -50 to 200": 1,
    }


@pytest.mark.parametrize(
    ("percent", "fraction", "voltage_v"),
    [(100.0, 1.0, 16.0), (50.0, 0.5, 13.25), (0.0, 0.0, 10.5), (101.5, 1.0, 16.0), (-2.0, 0.0, 10.5)],
)
def test_percent_becomes_a_fraction_and_a_voltage(
    core: Core, percent: float, fraction: float, voltage_v: float
) -> None:
    core.receive(BatteryReceived(1_000, percent), 1_000)
    assert core.advance(1_000) == [BatteryReported(1_000, voltage_v, fraction)]


@pytest.mark.parametrize(
    ("received", "told", "dropped"),
    [
        pytest.param(
            [
                (100, PoseReported(100, 2.1, 3.1, 0.0)),
                (1_000, PoseReported(900, 4.0, 5.0, 0.5)),
                (1_000, PoseReported(800, 2.1, 3.1, 0.0)),
            ],
            {1_000: [PoseReported(900, 4.0, 5.0, 0.5)]},
            {"position: a newer one overtook it": 1},
            id="of poses only the newest is told, and an overtaken one is counted",
        ),
        # The second is from a node that is ahead.
        pytest.param(
            [(1_000, PoseReported(1_500, 4.0, 5.0, 0.0)), (1_000, StateRefReceived(2_000))],
            {1_000: [], 2_000: [PoseReported(1_500, 4.0, 5.0, 0.0)]},
            {},
            id="what is stamped later waits for its time",
        ),
    ],
)
def test_poses_are_told_in_their_time(
    core: Core, received: list[tuple[int, Any]], told: dict[int, list[PoseReported]], dropped: dict[str, int]
) -> None:
    for at_ms, message in received:
        core.receive(message, at_ms)
    ahead = [it.at_ms for _, it in received if isinstance(it, StateRefReceived)]
    assert not ahead or core.readings.state_ms == ahead[0], "stateRef counts at once"
    assert {at_ms: core.advance(at_ms) for at_ms in told} == told and core.dropped == dropped
    with pytest.raises(ValueError, match="time went back"):
        core.advance(999)


def test_a_vehicle_starts_at_any_time_and_never_goes_back(made_at: Callable[[int], Vehicle]) -> None:
    vehicle = made_at(5_000)
    poses = [it for it in vehicle.advance(6_000) if isinstance(it, PosePublished)]
    assert [it.at_ms for it in poses] == list(range(5_000, 6_001, 100))
    assert (poses[0].pose.north_m, poses[0].pose.east_m) == POOL.apad.start_m
    with pytest.raises(ValueError, match="time went back"):
        vehicle.advance(5_999)
