from __future__ import annotations

from dataclasses import replace

import pytest

from apad_bridge.scenario.schema import APad, APadBattery


@pytest.fixture
def config() -> APad:
    """The pool scenario's aPad, at (0, 0)."""
    battery = APadBattery(
        full_v=16.0, empty_v=10.5, capacity_wh=230, start_fraction=1.0, hotel_w=25, charging_w_per_dock=10
    )
    return APad(
        start_m=(0.0, 0.0),
        max_speed_m_s=1.0,
        max_acceleration_m_s2=0.3,
        max_yaw_rate_rad_s=0.5,
        mass_kg=25,
        drag_n_per_m2_s2=40,
        thruster_max_n=30,
        thruster_w_per_n=6,
        battery=battery,
    )


@pytest.fixture
def small_battery(config: APad) -> APad:
    """A battery of 360 J: 14.4 s of hotel load."""
    return replace(config, battery=replace(config.battery, capacity_wh=0.1))
