"""The bench before a vehicle of generation B that a stranger wrote from the published facts alone."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
VEHICLE = Path(__file__).with_name("generation_b") / "vehicle.py"
SCENARIOS = ROOT / "launch_scripts" / "scenarios"
LEANED_ON = "a_slow_service_delays_the_next or docks_by_camera or there_is_no_fifth_dock"
"""Its author's own tests of what the bench leans on."""
BLOCK_S = 6.0
"""Shorter than the published 27 s, and longer than a stop may wait."""
PATIENCE_S = 300


@pytest.fixture
def environment(tmp_path: Path) -> Iterator[dict[str, str]]:
    """The variables of a shell on the master where it is /apad1."""
    master = start_master(tmp_path / "ros", timeout_s=120, orphan_s=300)
    shell = loopback_environment(tmp_path / "ros", master.uri)
    words = [
        "/usr/bin/python3",
        VEHICLE,
        "--start",
        "14",
        "10.5",
        "--seed",
        "1",
        "--servo-block",
        str(BLOCK_S),
    ]
    vehicle = subprocess.Popen(words, env=shell, stdout=subprocess.PIPE, text=True)
    try:
        assert vehicle.stdout is not None and vehicle.stdout.readline() == "ready\n"
        yield shell | {"PYTHONPATH": str(ROOT)}
    finally:
        vehicle.terminate()
        vehicle.communicate(timeout=PATIENCE_S)
        master.stop()


def test_its_own_tests_pass() -> None:
    own = ["-p", "no:cacheprovider", "-c", "/dev/null", "--rootdir", ".", "-q", "-k", LEANED_ON, "."]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *own],
        cwd=VEHICLE.with_name("tests"),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"


def test_the_preflight_finds_it_fit_and_measures_what_the_facts_leave_open(
    tmp_path: Path, environment: dict[str, str]
) -> None:
    data = loader.resolve(loader.load(SCENARIOS / "real-apad.yaml"))
    by_eye = loader.resolve(loader.load(SCENARIOS / "pool-12-camera.yaml"))
    data["mission"]["docking"] = by_eye["mission"]["docking"]
    loader.write_resolved(tmp_path / "scenario.yaml", loader.from_data(data, "real"))
    asked = [
        "preflight",
        tmp_path / "scenario.yaml",
        "--lookout",
        "Ana",
        "--json",
        "--prove-docks",
        "--hands-clear",
    ]
    done = subprocess.run(
        [sys.executable, "-m", "apad_bridge.commands.main", *map(str, asked)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    found = {it["check"]: it for it in json.loads(done.stdout)["findings"]}
    assert [name for name, it in found.items() if it["status"] == "FAIL"] == ["/apad1 watchdog"], done.stdout
    # Both guess the type of `commander/docking`, of which only the fields are published.
    assert "commander/docking: md5" in found["/apad1 beside"]["found"]
    docks = found["/apad1 docks opened"]
    assert docks["status"] == "WARN" and "4 arms opened and closed" in docks["found"], docks
    waits_s = float(docks["found"].split("taken after ")[1].removesuffix(" s"))
    assert BLOCK_S - 1 < waits_s < BLOCK_S + 2, docks
