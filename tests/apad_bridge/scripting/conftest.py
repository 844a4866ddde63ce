from pathlib import Path

import pytest

from apad_bridge.scenario.loader import load
from apad_bridge.scenario.schema import Scenario


@pytest.fixture(scope="session")
def pool() -> Scenario:
    """12 aMussels in the paper's pool, the simulated aPad in their midst."""
    return load(Path(__file__).parents[3] / "launch_scripts/scenarios/pool-12.yaml")
