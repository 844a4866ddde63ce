"""`musselbed preflight` on a vehicle that must not fly: each fault is red in the line that names it, and in no other.

Nodes of other processes spoil a simulated aPad while it runs: a relay that falsifies its positions and its battery, clients
that publish on its topics, and calls to the master that take registrations away.
"""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import xmlrpc.client
from dataclasses import dataclass
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
AT = (43.9330937, 15.4443468)
"""The origin of the shipped scenario, which the vehicle has, too."""
NORTH_KM_DEG = 1 / 111.1
"""Degrees of latitude in a kilometre, at 44 degrees north (WGS 84)."""


@dataclass
class Vehicle:
    """A simulated aPad behind a relay, with a watchdog, on a master; its processes end with the test."""

    folder: Path
    generation: str
    uri: str
    begin: Begin

    def __post_init__(self) -> None:
        self.scenario = self.write("healthy")
        self.environment = loopback_environment(self.folder / "ros", self.uri)
        hull = ["-m", "safety.nodes.hull", "--scenario", str(self.scenario), "--time", "wall"]
        self._start(sys.executable, *hull, "--generation", self.generation, path=CAMPAIGNS)
        self.node("relay")
        self.watchdog = self._start(
            "/usr/bin/python3",
            str(ROOT / "launch_scripts" / "vehicle_watchdog"),
            path=str(generated_folder()),
            says_ready=False,
        )

    def node(self, script: str, name: str = "") -> None:
        """Starts a node that takes orders."""
        words = [f"safety.nodes.{script}", name or script, str(self._socket(name or script))]
        self._start("/usr/bin/python3", "-m", *words, path=f"{CAMPAIGNS}:{generated_folder()}")

    def order(self, node: str, /, **order: Any) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as orders:
            orders.sendto(json.dumps(order).encode(), str(self._socket(node)))

    def publish_text(self, topic: str, text: str) -> None:
        """Some node's text, twice a second, by ROS's own tool."""
        command = ["/usr/bin/rostopic", "pub", "-r", "2", topic, "std_msgs/String", text]
        self._start(*command, path="", says_ready=False)

    def forget_origin(self) -> None:
        """The master has the vehicle's parameters no more."""
        with xmlrpc.client.ServerProxy(self.uri) as master:
            for it in ("Lat", "Lon"):
                master.deleteParam("/test", f"/apad1/LocalOrigin{it}")

    def take_away(self, part: str) -> None:
        """The topics and services below `part` have no node any more, for all that the master knows."""
        with xmlrpc.client.ServerProxy(self.uri) as proxy:
            master: Any = proxy
            _, _, kinds = master.getSystemState("/test")
            for kind, named in zip(("Publisher", "Subscriber", "Service"), kinds, strict=True):
                for name, node in (
                    (it, node) for it, nodes in named if it.startswith(part) for node in nodes
                ):
                    look_up, asked = ("lookupService", name) if kind == "Service" else ("lookupNode", node)
                    _, _, api = getattr(master, look_up)("/test", asked)
                    code, told, count = getattr(master, f"unregister{kind}")(node, name, api)
                    assert (code, count) == (1, 1), told

    def write(self, name: str, **changes: Any) -> Path:
        """The shipped scenario for a mission of ten minutes, with these changes."""
        return write_scenario(self.folder / f"{name}.yaml", REAL_APAD, duration_s=600, **changes)

    def _socket(self, name: str) -> Path:
        return self.folder / f"{name}.sock"

    def _start(self, *words: object, path: str, says_ready: bool = True) -> subprocess.Popen[str]:
        """A process in the vehicle's shell; `path` is where its Python looks for modules."""
        there = {"env": self.environment | {"PYTHONPATH": path}, "ends_by": signal.SIGTERM}
        process = self.begin(*words, **there)
        assert not says_ready or line_of(process)
        return process


@dataclass(frozen=True)
class Page:
    """A preflight's exit code, and its findings that are red, by check."""

    code: int
    red: dict[str, str]


def preflights(vehicle: Vehicle, **asked: list[str | Path]) -> dict[str, Page]:
    """Runs `musselbed preflight` with each of these lists of words at the same time, for they mostly wait."""
    there: dict[str, Any] = {
        "env": vehicle.environment | {"PYTHONPATH": str(ROOT)},
        "stdin": subprocess.DEVNULL,
    }
    started, pages = {}, {}
    for name, words in asked.items():
        (vehicle.folder / name).mkdir()
        command = (*MUSSELBED, "preflight", *words, "--lookout", "Ana", "--json")
        started[name] = vehicle.begin(*command, **there, cwd=vehicle.folder / name)
    for name, process in started.items():
        out, errors = process.communicate(timeout=PATIENCE_S)
        assert out, errors
        red = {
            it["check"].removeprefix("/apad1 "): f"{it['found']} | {it['mend']}"
            for it in json.loads(out)["findings"]
            if it["status"] in ("FAIL", "CANNOT TELL")
        }
        pages[name] = Page(process.returncode, red)
    return pages


def agree(page: Page, expected: dict[str, str]) -> None:
    """The page is red in these checks alone, each with its text; without any it is green."""
    assert page.red.keys() == expected.keys(), page.red
    for check, text in expected.items():
        assert text in page.red[check], (check, page.red[check])
    assert page.code == (3 if expected else 0)


def with_origin(latitude_deg: float, longitude_deg: float) -> dict[str, dict[str, Any]]:
    return {"area": {"origin": {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg}}}


@pytest.mark.parametrize("generation", ["a", "b"])
def test_each_fault_of_vehicle_and_scenario_is_red_by_its_own_line_and_a_healthy_vehicle_is_green(
    tmp_path: Path, generation: str, master: Master, begin: Begin
) -> None:
    is_a = generation == "a"
    north, east = AT
    it = Vehicle(tmp_path, generation, master.uri, begin)
    wrong = with_origin(north + NORTH_KM_DEG, east) | {
        "guards": {"battery_reserve": 0, "jump_m": 500, "leg_s": 300_000},
        "apad": {"generation": "b" if is_a else "a"},
    }
    # The rest of the scenario's faults are the same for both.
    of_scenario: dict[str, list[str | Path]] = {
        "negated": [it.write("negated", **with_origin(-north, -east))],
        "swapped": [it.write("swapped", **with_origin(east, north))],
        "astray": [it.scenario, "--remap", "/apad1/position:=/boat/position"],
    }
    pages = preflights(
        it, healthy=[it.scenario], wrong=[it.write("wrong", **wrong)], **(of_scenario if is_a else {})
    )
    agree(pages["healthy"], {})
    agree(
        pages["wrong"],
        {
            "origin": "1000 m from the scenario's",
            "reserve": "guards.battery_reserve is 0",
            "reaction": "guards.jump_m is 500 m",
            "limits": "guards.leg_s is 300000 s",
            "generation": "it is a, and the scenario's is b" if is_a else "it is b, and the scenario's is a",
        },
    )
    if is_a:
        agree(pages["negated"], {"origin": "from the scenario's: degrees given to one are other metres"})
        agree(pages["swapped"], {"origin": "latitude and longitude look swapped in area.origin"})
        assert pages["astray"].red["position"].startswith("none within") and pages["astray"].code == 3

    it.forget_origin()
    it.order("relay", position={"kind": "yaw_nan"}, battery={"percent": 150})
    it.watchdog.send_signal(signal.SIGSTOP)
    for amussel in ("amussel3", "amussel7") if is_a else ():
        it.node("stranger", amussel)
        it.order(amussel, do="docked", name=amussel)
    mapped = [f"/apad1/{leaf}:=/hull/{leaf}" for leaf in ("position", "battery_level")]
    pages = preflights(
        it,
        spoilt=[it.scenario],
        remapped=[it.scenario, "--remap", mapped[0], "--remap", mapped[1]],
    )
    of_vehicle = {"watchdog": "its topic has a publisher, and is silent"}
    if is_a:
        of_vehicle["docks held"] = "/amussel3/position_static comes at "
        assert "/amussel7/position_static comes at " in pages["spoilt"].red["docks held"]
    of_topics = {
        "position": "are not finite or beyond every water: yaw_rad",
        "GPS": "there are not two positions to judge it by",
        "origin": "is not set, and its positions name neither",
        "battery": "/apad1/battery_level says 150 %",
        "energy": "150 % is no charge of a battery",
    }
    agree(pages["spoilt"], of_vehicle | of_topics)
    # The same vehicle at the same time: by the topics of the hull itself its position and its battery are sound.
    agree(pages["remapped"], of_vehicle)

    it.order("relay", position={"kind": "north_sign"}, battery={})
    it.watchdog.send_signal(signal.SIGCONT)
    it.watchdog.terminate()
    it.watchdog.wait(PATIENCE_S)
    it.publish_text("/apad1/watchdog", "hello")
    it.node("relay", "second")
    it.take_away("/apad1/action_server" if is_a else "/apad1/commander")
    agree(
        preflights(it, bare=[it.scenario])["bare"],
        {
            "position": "2 nodes publish it, /relay, /second",
            "origin": "north has the wrong sign",
            "fence": "lies inside, 0.0 m from its edge",
            "watchdog": "'hello' is none of its states: another node publishes its topic",
            "generation": "no aPad of either generation answers: no node takes orders",
        },
    )
