"""A run of the pool whose journal a test writes, and messages of ROS 2 as rosbags reads them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rosbags.typesys import Stores, get_typestore

from apad_bridge.records.journal import Entry
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.ros2.followed_run import FollowedRun
from apad_bridge.ros2.topics import TopicMessage
from apad_bridge.scenario.loader import write_resolved
from apad_bridge.scenario.run_options import APadKind, BenchPart, OnDeath, RunOptions, TimeSource
from apad_bridge.scenario.schema import Scenario


class Story:
    """The test is the run's supervisor, and has the clocks."""

    def __init__(
        self, path: Path, scenario: Scenario, time: TimeSource, speed: float, namespace: str
    ) -> None:
        RunOptions(BenchPart.WHOLE, APadKind.SIM, time, speed, OnDeath.WAIT, namespace=namespace).save(path)
        self.directory = RunDirectory(path)
        write_resolved(self.directory.scenario, scenario)
        self.directory.journal.touch()
        self.run = FollowedRun(self.directory, scenario)
        self.wall_ms: int | None = None
        """The Unix time at which the journal is written; None for now."""

    def write(self, t: int, kind: str, **fields: Any) -> None:
        with self.directory.journal.open("a") as journal:
            journal.write(json.dumps({"t": t, "kind": kind, **fields}) + "\n")
        if self.wall_ms is not None:
            os.utime(self.directory.journal, ns=(0, self.wall_ms * 1_000_000))

    def apad(
        self, t: int, north_m: float, east_m: float, heading_rad: float = 0.0, docks: tuple[int, ...] = ()
    ) -> None:
        self.write(
            t,
            "apad",
            north_m=north_m,
            east_m=east_m,
            heading_rad=heading_rad,
            voltage_v=15.5,
            battery=0.9,
            primitive="go to point",
            docks=[*docks, -1, -1, -1, -1][:4],
        )

    def belief(self, t: int, agent_id: int, charge: float = 0.75, **fields: Any) -> None:
        known = {"heard": t, "state": "ACTIVE", "secondary": 1.0, "north_m": 10.0, "east_m": 20.0}
        self.write(t, "belief", id=agent_id, charge=charge, **{**known, **fields})

    def truth(self, t: int, agent_id: int, **fields: Any) -> None:
        battery = [0, 600_000_000_000_000, 1, 0, 1]
        known = {"state": "ACTIVE", "primary": battery, "secondary": battery, "buoyancy": "FLOAT"}
        place = {"north_um": 1_500_000, "east_um": 2_500_000, "depth": [0, 0], "docked": False}
        self.write(t, "truth", id=agent_id, agent_ms=30 * t, **{**known, **place, **fields})

    def poll(self) -> list[Entry]:
        return self.run.poll()


@pytest.fixture
def begin(tmp_path: Path, pool: Scenario) -> Iterator[Callable[..., Story]]:
    """Begins a run; by default in virtual time, without a namespace."""
    begun: list[Story] = []

    def of(time: TimeSource = TimeSource.ASAP, speed: float = 1.0, namespace: str = "") -> Story:
        begun.append(Story(tmp_path, pool, time, speed, namespace))
        return begun[-1]

    yield of
    for it in begun:
        it.run.close()


@pytest.fixture
def story(begin: Callable[..., Story]) -> Story:
    return begin()


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The wall's clock of the followed run, as `now_s`."""
    clock = SimpleNamespace(now_s=5000.0)
    monkeypatch.setattr("apad_bridge.ros2.followed_run.time", SimpleNamespace(monotonic=lambda: clock.now_s))
    return clock


_STORE = get_typestore(Stores.ROS2_HUMBLE)
"""Another one than that of the code."""


@pytest.fixture
def read() -> Callable[[TopicMessage], Any]:
    return lambda it: _STORE.deserialize_cdr(it.data, it.kind.replace("/", "/msg/"))
