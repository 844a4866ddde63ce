"""What the simulated aPad of generation A answers and hears beside its action, over real TCPROS."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from graphs import somebodys_graph
from programs import done, with_helpers
from scenario_files import POOL_FILE

pytestmark = pytest.mark.system


def test_it_is_asked_configured_charged_and_drained(tmp_path: Path) -> None:
    with somebodys_graph(POOL_FILE, tmp_path, 1) as graph:
        asked = done(sys.executable, "-m", "tests.system.ask_generation_a", env=with_helpers(graph))
    told = json.loads(asked.stdout.splitlines()[-1])
    drained_and_charged = told.pop("battery")
    assert "dock 0 is open" in told.pop("refused")
    # The first free slot, whatever the number of the aMussel; there is no fifth coil.
    assert told == {
        "anchored": True,
        "coils_free": [False] * 5,
        "coils_held": [True, False, False, False, False],
        "docks": [[1, 2, 3], ["amussel7"]],
        "charge_info": ["charger", "amussel7"],
        "result_of_change": False,
    }
    assert drained_and_charged == pytest.approx([-30, 10], abs=0.1)
