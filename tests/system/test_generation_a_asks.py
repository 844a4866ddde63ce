"""What the simulated aPad of generation A answers and hears beside its action, over real TCPROS."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from apad_bridge.ros.simulated_node.apad_process import start_apad_node, stop_apad_node
from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]


def test_it_is_asked_configured_charged_and_drained(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    loader.write_resolved(scenario, loader.load(POOL_FILE))
    with ExitStack() as stack:
        master = start_master(tmp_path / "ros", timeout_s=120, orphan_s=60)
        stack.callback(master.stop)
        stack.callback(stop_apad_node, start_apad_node(scenario, master.uri, tmp_path / "apad.log"))
        done = subprocess.run(
            [sys.executable, "-m", "tests.system.ask_generation_a"],
            env=loopback_environment(tmp_path / "ros", master.uri),
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=300,
        )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["enabled"] == 3 and told["anchored"]
    # The first free slot, whatever the number of the aMussel; there is no fifth coil.
    assert told["coils_free"] == [False] * 5
    assert told["coils_held"] == [True, False, False, False, False]
    assert told["docks"] == [[1, 2, 3], ["amussel7"]] and told["charge_info"] == ["charger", "amussel7"]
    assert told["result_of_change"] is False and "dock 0 is open" in told["refused"]
    full, drained, charged = told["battery"]
    assert drained == pytest.approx(full - 30, abs=0.01) and charged == pytest.approx(full - 20, abs=0.01)
