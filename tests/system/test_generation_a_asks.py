"""What the simulated aPad of generation A answers and hears beside its action, over real TCPROS."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from programs import done, with_helpers
from scenario_files import POOL_FILE

from apad_bridge.ros.simulated_node.apad_process import start_apad_node
from apad_bridge.ros.system.master import Master, end_process, loopback_environment

pytestmark = pytest.mark.system


def test_it_is_asked_configured_charged_and_drained(tmp_path: Path, master: Master) -> None:
    node = start_apad_node(POOL_FILE, master.uri, tmp_path / "apad.log")
    try:
        asked = (sys.executable, "-m", "tests.system.ask_generation_a")
        said = done(*asked, env=with_helpers(loopback_environment(tmp_path / "ros", master.uri))).stdout
    finally:
        end_process(node)
    told = json.loads(said.splitlines()[-1])
    assert told["enabled"] == 3 and told["anchored"]
    # The first free slot, whatever the number of the aMussel; there is no fifth coil.
    assert told["coils_free"] == [False] * 5
    assert told["coils_held"] == [True, False, False, False, False]
    assert told["docks"] == [[1, 2, 3], ["amussel7"]] and told["charge_info"] == ["charger", "amussel7"]
    assert told["result_of_change"] is False and "dock 0 is open" in told["refused"]
    full, drained, charged = told["battery"]
    assert drained == pytest.approx(full - 30, abs=0.01) and charged == pytest.approx(full - 20, abs=0.01)
