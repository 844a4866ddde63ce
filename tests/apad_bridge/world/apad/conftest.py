from __future__ import annotations

from dataclasses import replace

import pytest
from scenario_files import POOL_FILE

from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import APad


@pytest.fixture
def config() -> APad:
    """The pool scenario's aPad, at (0, 0)."""
    return replace(load(POOL_FILE).apad, start_m=(0.0, 0.0))


@pytest.fixture
def small_battery(config: APad) -> APad:
    """A battery of 360 J: 14.4 s of hotel load."""
    return replace(config, battery=replace(config.battery, capacity_wh=0.1))
