"""The shadow beside a mission that flies over ROS: it sees their decisions, and nothing of it is on the graph but ears."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from xmlrpc.client import ServerProxy

import pytest
from graphs import lines_of, served_pool, somebodys_graph, wait_until

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
PATIENCE_S = 300.0
SPEED = 4
NODE = "/musselbed_shadow"


class Observer:
    """Asks the master, again and again, what nodes of the shadow's name publish, subscribe to and serve."""

    def __init__(self, uri: str) -> None:
        self.published: set[str] = set()
        self.heard: set[str] = set()
        self.served: set[str] = set()
        self._uri = uri
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._watch)

    def __enter__(self) -> Observer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        self._thread.join(PATIENCE_S)

    def _watch(self) -> None:
        while not self._is_over.wait(0.1):
            self._look()

    def _look(self) -> None:
        with ServerProxy(self._uri) as master:
            _, _, state = master.getSystemState("/observer")  # type: ignore[misc]
        for names, found in zip(state, (self.published, self.heard, self.served), strict=True):  # type: ignore[arg-type]
            found |= {name for name, nodes in names if any(it.startswith(NODE) for it in nodes)}


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return served_pool(tmp_path / "shadowed.yaml", 8, 3600)


@pytest.fixture
def graph(scenario: Path, tmp_path: Path) -> Iterator[dict[str, str]]:
    """Somebody's master with an aPad on it, and a /clock `SPEED` times as fast as the wall's; gives the environment."""
    with somebodys_graph(scenario, tmp_path, SPEED) as environment:
        yield environment


def start(words: list[str], environment: dict[str, str]) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [*MUSSELBED, *words, "--json"], stdout=pipe, stderr=pipe, text=True, env=environment, cwd=ROOT
    )


def collected_in(run: Path) -> list[int]:
    """The aMussels whose dockings its journal has so far."""
    return [line["agent"] for line in lines_of(run) if line["kind"] == "dock" and line["closed"]]


def test_it_hears_a_mission_and_is_heard_by_nobody(
    scenario: Path, graph: dict[str, str], tmp_path: Path
) -> None:
    out = tmp_path / "mission-run"
    with Observer(graph["ROS_MASTER_URI"]) as observer:
        shadow = start(["shadow", str(scenario)], graph)
        assert shadow.stderr is not None
        assert any("listening" in line for line in shadow.stderr)
        fleet = start(["fleet", str(scenario), "--time", "ros", "--out", str(tmp_path / "fleet-run")], graph)
        mission = start(["mission", str(scenario), "--time", "ros", "--out", str(out)], graph)
        wait_until(lambda: len(collected_in(out)) >= 4, mission)
        abort = [*MUSSELBED, "abort", str(out)]
        assert subprocess.run(abort, env=graph, cwd=ROOT, timeout=PATIENCE_S).returncode == 0
        _, mistakes = mission.communicate(timeout=PATIENCE_S)
        assert mission.returncode == 0, mistakes
        said, mistakes = shadow.communicate(timeout=PATIENCE_S)
        fleet.send_signal(signal.SIGINT)
        fleet.communicate(timeout=PATIENCE_S)
    assert shadow.returncode == 0, mistakes

    # Ears alone: rospy itself serves the two services of a node's own log.
    assert observer.published == set()
    assert all(it.startswith(NODE) for it in observer.served)
    assert {"/apad1/position", "/musselbed/heard", "/musselbed/mission"} <= observer.heard

    told = json.loads(said)
    theirs = [it["theirs"]["agent_id"] for it in told["decisions"] if it["theirs"]["kind"] == "collect"]
    # In this order. On a busy machine a docking may fail, and the mission decides for that aMussel again later.
    decided = iter(theirs)
    assert all(agent_id in decided for agent_id in collected_in(out)), (theirs, collected_in(out))
    assert told["agreed"] >= 1
    assert any(it["estimate"] is not None for it in told["decisions"] if it["theirs"]["kind"] == "collect")
