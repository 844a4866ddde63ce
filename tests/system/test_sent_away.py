"""Another party commands a real aPad of generation A, which here is a simulated one on somebody else's master."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from apad_bridge.ros.system.master import Master, loopback_environment, start_master
from apad_bridge.scenario import loader

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, "-m", "apad_bridge.commands.main")
SUCCEEDED = 3
Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def master(tmp_path: Path) -> Iterator[Master]:
    running = start_master(tmp_path / "ros", timeout_s=120, orphan_s=60)
    yield running
    running.stop()


@pytest.fixture
def start(tmp_path: Path, master: Master) -> Iterator[Start]:
    """Starts a program on the master; it is asked to end, by its pid, at the end."""
    with ExitStack() as stack:

        def started(*words: object) -> subprocess.Popen[str]:
            child = subprocess.Popen(
                [str(it) for it in words],
                cwd=ROOT,
                env=loopback_environment(tmp_path / "ros", master.uri),
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )

            def end() -> None:
                if child.poll() is None:
                    child.send_signal(signal.SIGINT)
                child.communicate(timeout=180)

            stack.callback(end)
            return child

        yield started


def test_a_mission_stands_aside_for_anothers_go_to_until_it_is_given_back(
    tmp_path: Path, start: Start
) -> None:
    data = loader.resolve(loader.load(ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml"))
    data["apad"] |= {"generation": "a", "start_m": [14, 10.5]}
    data["mission"] |= {"speed_m_s": 0.8}
    scenario = tmp_path / "scenario.yaml"
    loader.write_resolved(scenario, loader.from_data(data, "pool"))
    vehicle = start(*COMMAND, "apad", scenario)
    assert vehicle.stdout is not None and vehicle.stdout.readline() == "ready\n"
    # A near place: a mission lets the other's order end for a minute, which is short where machines are busy.
    somebody = start(sys.executable, "-m", "tests.system.send_away", 17.0, 10.5)
    assert somebody.stdout is not None and somebody.stdout.readline() == "listening\n"
    start(
        *COMMAND,
        "run",
        scenario,
        "--apad",
        "ros",
        "--hosting",
        "one_process",
        "--out",
        tmp_path / "run",
        "--json",
    )
    said, errors = somebody.communicate(timeout=600)
    assert said, errors
    told = json.loads(said)
    assert told["state"] == SUCCEEDED, "the other's go-to was cut short"
    assert told["away_m"] < 1.0, "the mission took the aPad back by itself"
    assert told["given_back"]
    assert "plan" not in told["aside"]
