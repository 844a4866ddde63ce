"""`musselbed preflight` on a vehicle that must not fly: what it measures over ROS is red in the lines that name it.

Nodes of other processes spoil a simulated aPad while it runs: a relay that falsifies its positions and its battery, and
aMussels in its docks. Which measurement is red, and why: `tests/apad_bridge/doctor`.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from programs import MUSSELBED, ROOT, Begin, line_of
from scenario_files import write_scenario

from apad_bridge.ros.system.master import Master, loopback_environment
from apad_bridge.ros.types.messages import generated_folder

pytestmark = pytest.mark.system
CAMPAIGNS = f"{ROOT}:{ROOT / 'tests' / 'campaigns'}"
"""A path with the nodes of the campaign of stops."""
REAL_APAD = ROOT / "launch_scripts" / "scenarios" / "real-apad.yaml"
PATIENCE_S = 300


class Vehicle:
    """A simulated aPad behind a relay, with a watchdog, on a master; its processes end with the test."""

    def __init__(self, folder: Path, generation: str, uri: str, begin: Begin) -> None:
        self.folder, self.scenario, self._begin = folder, folder / "healthy.yaml", begin
        write_scenario(self.scenario, REAL_APAD, duration_s=600)
        self.environment = loopback_environment(folder / "ros", uri)
        hull = ("-m", "safety.nodes.hull", "--scenario", self.scenario, "--time", "wall")
        assert line_of(self._start(sys.executable, *hull, "--generation", generation, path=CAMPAIGNS))
        self.node("relay")
        watchdog = ROOT / "launch_scripts" / "vehicle_watchdog"
        self.watchdog = self._start("/usr/bin/python3", watchdog, path=str(generated_folder()))

    def node(self, script: str, name: str = "") -> None:
        """Starts a node that takes orders."""
        words = (f"safety.nodes.{script}", name or script, self._socket(name or script))
        path = f"{CAMPAIGNS}:{generated_folder()}"
        assert line_of(self._start("/usr/bin/python3", "-m", *words, path=path))

    def order(self, node: str, /, **order: Any) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as orders:
            orders.sendto(json.dumps(order).encode(), str(self._socket(node)))

    def preflights(self, **asked: list[str | Path]) -> dict[str, dict[str, str]]:
        """The red findings of preflights with these words, by check. They run at the same time."""
        started = {}
        for name, words in asked.items():
            (self.folder / name).mkdir()
            command = (*MUSSELBED, "preflight", *words, "--lookout", "Ana", "--json")
            there = {"cwd": self.folder / name, "stdin": subprocess.DEVNULL}
            started[name] = self._start(*command, path=str(ROOT), **there)
        return {name: red(process) for name, process in started.items()}

    def _socket(self, name: str) -> Path:
        return self.folder / f"{name}.sock"

    def _start(self, *words: object, path: str, **there: Any) -> subprocess.Popen[str]:
        """A process in the vehicle's shell; `path` is where its Python looks for modules."""
        environment = self.environment | {"PYTHONPATH": path}
        process: subprocess.Popen[str] = self._begin(*words, env=environment, ends_by=signal.SIGTERM, **there)
        return process


def red(preflight: subprocess.Popen[str]) -> dict[str, str]:
    out, errors = preflight.communicate(timeout=PATIENCE_S)
    assert preflight.returncode == 3, errors
    return {
        it["check"].removeprefix("/apad1 "): f"{it['found']} | {it['mend']}"
        for it in json.loads(out)["findings"]
        if it["status"] in ("FAIL", "CANNOT TELL")
    }


def agree(found: dict[str, str], expected: dict[str, str]) -> None:
    """The page is red in these checks alone, each with its text."""
    assert found.keys() == expected.keys(), found
    assert [it for it, text in expected.items() if text not in found[it]] == [], found


def test_faults_of_scenario_and_vehicle_are_red_by_their_own_lines(
    tmp_path: Path, master: Master, begin: Begin
) -> None:
    it = Vehicle(tmp_path, "a", master.uri, begin)
    # A kilometre to the north, by degrees of 111.1 km (WGS 84 at 44 degrees north).
    wrong = write_scenario(
        tmp_path / "wrong.yaml",
        it.scenario,
        area={"origin": {"latitude_deg": 43.9330937 + 1 / 111.1}},
        guards={"battery_reserve": 0, "jump_m": 500, "leg_s": 300_000},
        apad={"generation": "b"},
    )
    agree(
        it.preflights(wrong=[wrong])["wrong"],
        {
            "origin": "1000 m from the scenario's",
            "reserve": "guards.battery_reserve is 0",
            "reaction": "guards.jump_m is 500 m",
            "limits": "guards.leg_s is 300000 s",
            "generation": "it is a, and the scenario's is b",
        },
    )
    it.order("relay", position={"kind": "yaw_nan"}, battery={"percent": 150})
    it.watchdog.send_signal(signal.SIGSTOP)
    it.node("stranger", "amussel3")
    it.order("amussel3", do="docked", name="amussel3")
    mapped = [f"/apad1/{leaf}:=/hull/{leaf}" for leaf in ("position", "battery_level")]
    pages = it.preflights(
        spoilt=[it.scenario], remapped=[it.scenario, "--remap", mapped[0], "--remap", mapped[1]]
    )
    it.watchdog.kill()
    of_vehicle = {
        "watchdog": "its topic has a publisher, and is silent",
        "docks held": "/amussel3/position_static comes at ",
    }
    of_topics = {
        "position": "are not finite or beyond every water: yaw_rad",
        "GPS": "there are not two positions to judge it by",
        "battery": "/apad1/battery_level says 150 %",
        "energy": "150 % is no charge of a battery",
    }
    agree(pages["spoilt"], of_vehicle | of_topics)
    # The same vehicle at the same time: by the topics of the hull itself its position and its battery are sound.
    agree(pages["remapped"], of_vehicle)
