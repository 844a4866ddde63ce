"""The camera's geometry by hand, and the field's docking law with it, which ends where an aMussel is docked."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from scenario_files import POOL_FILE

from apad_bridge.scenario.loader import load
from apad_bridge.vehicle.commands import Hold
from apad_bridge.vehicle.generation_b.messages import (
    DockingOrder,
    PrimitiveStatus,
    dock_direction_rad,
)
from apad_bridge.world.apad.camera import seen
from apad_bridge.world.apad.simulated_apad import SimulatedAPad
from apad_bridge.world.generation_b.simulated_messages import StatusPublished
from apad_bridge.world.generation_b.vehicle import GenerationBVehicle, Stage

POOL = load(POOL_FILE)
NORTH_M, EAST_M = POOL.apad.start_m


def test_at_the_docking_distance_it_is_where_docking_ends() -> None:
    """0.4 m ahead and 0.5 m below: 51.34 degrees down, 21.64 below the axis; tan 21.64 / tan 25 = 0.851."""
    there = seen((0.0, 0.0), 0.0, 0.0, (0.4, 0.0))
    assert (there.horizontal, there.vertical) == pytest.approx((0.0, 0.851), abs=0.001)


def test_what_is_to_starboard_is_right_in_the_image_and_what_is_nearer_is_lower_and_larger() -> None:
    far, near = seen((0.0, 0.0), 0.0, 0.0, (2.0, 0.5)), seen((0.0, 0.0), 0.0, 0.0, (1.0, 0.25))
    assert far.horizontal > 0 and near.vertical > far.vertical and near.size > far.size
    left = seen((0.0, 0.0), 0.0, 0.0, (2.0, -0.5))
    assert left is not None and left.horizontal == pytest.approx(-far.horizontal)


@pytest.mark.parametrize("dock_index", range(4))
def test_it_looks_towards_its_dock_however_the_hull_lies(dock_index: int) -> None:
    for heading_rad in (0.0, 1.0, -2.5):
        bearing_rad = heading_rad + dock_direction_rad(dock_index)
        target_m = (3 + math.cos(bearing_rad), 4 + math.sin(bearing_rad))
        there = seen((3.0, 4.0), heading_rad, dock_direction_rad(dock_index), target_m)
        assert there is not None and there.horizontal == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("target_m", [(-1.0, 0.0), (0.0, 1.0), (0.2, 0.0), (7.0, 0.0)])
def test_what_is_behind_beside_underneath_or_too_far_is_not_seen(target_m: tuple[float, float]) -> None:
    assert seen((0.0, 0.0), 0.0, 0.0, target_m) is None


@pytest.mark.parametrize("dock_index", range(4))
@pytest.mark.parametrize("drift_m_s", [(0.0, 0.0), (0.01, -0.02)])
def test_a_docking_by_the_fields_law_ends_at_the_amussel(
    dock_index: int, drift_m_s: tuple[float, float]
) -> None:
    """From two metres off, through the servo's wait of 27 s, in which the boat drifts, and a search if need be."""
    target_m = (NORTH_M + 2.0, EAST_M + 0.3)
    apad = GenerationBVehicle(SimulatedAPad(replace(POOL.apad, drift_m_s=drift_m_s)))
    heading_rad = math.atan2(0.3, 2.0) - dock_direction_rad(dock_index)
    apad.receive(Hold(0, NORTH_M, EAST_M, heading_rad), 0)
    apad.receive(DockingOrder(True, dock_index, 0.2, 0.3, 0.15, 0.2), 20_000)
    for now_ms in range(20_000, 140_000, 100):
        shown = apad.advance(now_ms)
        done = [it for it in shown if isinstance(it, StatusPublished) and it.status is PrimitiveStatus.DONE]
        if done:
            break
        pose = apad.pose
        there = seen((pose.north_m, pose.east_m), pose.heading_rad, dock_direction_rad(dock_index), target_m)
        if there is not None:
            apad.detect(there.horizontal, there.vertical, now_ms)
    assert done and apad.stage is Stage.OFF
    assert math.dist((apad.pose.north_m, apad.pose.east_m), target_m) == pytest.approx(0.4, abs=0.05)
