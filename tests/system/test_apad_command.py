"""`musselbed apad`: the simulated aPad alone, on a master that is there already."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import xmlrpc.client
from pathlib import Path
from typing import Any

import pytest

from apad_bridge.ros.system.master import loopback_environment, start_master

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-m", "apad_bridge.commands.main", "apad", "launch_scripts/scenarios/pool-12.yaml"]
PATIENCE_S = 300

pytestmark = pytest.mark.system


@pytest.mark.parametrize(
    ("generation", "service", "number"),
    [
        ("a", "/apad1/get_battery_level", signal.SIGINT),
        ("a", "/apad1/get_battery_level", signal.SIGHUP),
        ("b", "/apad1/commander/primitive/go2point", signal.SIGTERM),
    ],
)
def test_it_offers_its_generation_alone_and_ends_when_it_is_asked_to(
    generation: str, service: str, number: signal.Signals, tmp_path: Path
) -> None:
    master = start_master(tmp_path / "ros", timeout_s=120, orphan_s=60)
    try:
        environment = loopback_environment(tmp_path / "ros", master.uri)
        with subprocess.Popen(
            [*COMMAND, "--generation", generation],
            cwd=ROOT,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as apad:
            assert apad.stdout is not None and apad.stderr is not None
            assert apad.stdout.readline() == "ready\n", apad.stderr.read()
            with xmlrpc.client.ServerProxy(master.uri) as proxy:
                _, _, state = proxy.getSystemState("/test")  # type: ignore[misc]
                parameters: Any = proxy.getParam("/test", "/apad1")
            offered: Any = state
            origin = [parameters[2][it] for it in ("LocalOriginLat", "LocalOriginLon")]
            assert origin == [43.9330937, 15.4443468]  # as the legacy stack gives Biograd
            nodes = {node for kind in offered for _, nodes in kind for node in nodes}
            assert service in {name for name, _ in offered[2]}
            assert nodes - {"/rosout"} == {"/apad1_simulated"}
            apad.send_signal(number)
            assert apad.wait(PATIENCE_S) == 130, apad.stderr.read()
            with xmlrpc.client.ServerProxy(master.uri) as proxy:
                names: Any = proxy.getParamNames("/test")
            assert not [it for it in names[2] if "LocalOrigin" in it]
    finally:
        master.stop()


def test_without_a_master_it_says_so_in_a_line(tmp_path: Path) -> None:
    environment = {**os.environ, "ROS_MASTER_URI": "http://127.0.0.1:9"}
    done = subprocess.run(
        COMMAND, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 3
    assert "no ROS master answers at http://127.0.0.1:9" in done.stderr and done.stderr.count("\n") == 1
