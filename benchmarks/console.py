"""The live console: how late a flight's ticks are without a browser, and with 100 that follow it.

A flight of 24 aMussels at real time and theta 30, beside the simulated aPad's node, with a console. A tick's lateness is
the time at which a rospy node receives its beliefs, against a grid of seconds through the earliest of them. The browsers
are connections that read the console's stream.
"""

from __future__ import annotations

import json
import select
import socket
import subprocess
import sys
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import yaml
from rich.console import Console

from apad_bridge.ros.system.master import loopback_environment, start_master
from apad_bridge.supervisor.control import listens
from benchmarks.gateway import NODES, SCENARIO, TIMEOUT_S, Node, lateness_ms

AGENTS = 24
FLOWN_S = 60
BROWSERS = (0, 100)
WANTED_MS = 5.0


def measure() -> dict[str, Any]:
    result: dict[str, Any] = {"agents": AGENTS, "flown_s": FLOWN_S}
    for browsers in BROWSERS:
        result |= flight(browsers)
    first, last = (result[f"lateness_p95_ms_{it}"] for it in BROWSERS)
    return {**result, "difference_ms": last - first}


def show(result: dict[str, Any], console: Console) -> None:
    for browsers in BROWSERS:
        console.print(
            f"{browsers} browsers: ticks {result[f'lateness_p95_ms_{browsers}']:.1f} ms late (p95), "
            f"{result[f'lateness_p50_ms_{browsers}']:.1f} ms (p50), of {result[f'ticks_{browsers}']}; "
            f"{result[f'messages_{browsers}']} messages to browsers"
        )
    console.print(f"difference {result['difference_ms']:+.1f} ms; at most {WANTED_MS:g} ms are wanted")


def flight(browsers: int) -> dict[str, Any]:
    with ExitStack() as stack:
        home = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="musselbed-")))
        scenario, run = home / "flown.yaml", home / "run"
        data = yaml.safe_load(SCENARIO.read_text())
        data["duration_s"] = FLOWN_S
        data["area"] |= {"fence": [[-50, -50], [80, -50], [80, 80], [-50, 80]], "home_m": [14, 10.5]}
        data["guards"] = {"battery_reserve": 0.1}
        data["fleet"] |= {"count": AGENTS, "start": {"charge": [0.5, 0.9]}}
        scenario.write_text(yaml.safe_dump(data))
        master = start_master(home, timeout_s=20, orphan_s=0)
        stack.callback(master.stop)
        environment = loopback_environment(home, master.uri)
        environment["PYTHONPATH"] = str(NODES.parents[1])
        words = ["--scenario", str(scenario), "--time", "wall"]
        Node(stack, environment, "-m", "apad_bridge.ros.simulated_node.apad_node", *words)
        reader = Node(stack, environment, str(NODES / "tick_reader.py"))
        assert reader.line() == "reading"
        musselbed = [sys.executable, "-m", "apad_bridge.commands.main"]
        flying = subprocess.Popen(
            [*musselbed, "run", scenario, "--apad", "ros", "--time", "wall", "--json", "--out", run],
            env=environment,
            stdout=subprocess.DEVNULL,
        )
        stack.callback(flying.kill)
        while not (run.is_dir() and listens(run)):
            if flying.poll() is not None:
                raise RuntimeError("the flight did not begin")
            select.select([], [], [], 0.1)
        console = Node(stack, environment, *musselbed[1:], "console", str(run), "--json")
        clients = Clients(json.loads(console.line())["url"], browsers)
        stack.callback(clients.close)
        flying.wait(FLOWN_S + TIMEOUT_S)
        late_ms = lateness_ms(json.loads(reader.end()))
        return {
            f"ticks_{browsers}": len(late_ms),
            f"lateness_p50_ms_{browsers}": late_ms[len(late_ms) // 2],
            f"lateness_p95_ms_{browsers}": late_ms[int(0.95 * len(late_ms))],
            f"messages_{browsers}": clients.messages,
        }


class Clients:
    """Connections that read the stream of a console, as browsers do that are left open."""

    def __init__(self, url: str, count: int) -> None:
        address = urlsplit(url)
        assert address.hostname is not None and address.port is not None
        token = parse_qs(address.query)["token"][0]
        request = (
            f"GET /live?counts=0,0,0,0 HTTP/1.1\r\nHost: {address.netloc}\r\n"
            f"Cookie: musselbed_console_{address.port}={token}\r\n\r\n"
        ).encode()
        self.messages = 0
        self._links = [socket.create_connection((address.hostname, address.port)) for _ in range(count)]
        for link in self._links:
            link.sendall(request)
        self._ended, self._end = socket.socketpair()
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def close(self) -> None:
        self._end.close()
        self._thread.join()
        for link in (*self._links, self._ended):
            link.close()

    def _read(self) -> None:
        left = {self._ended, *self._links}
        while True:
            for link in select.select(list(left), [], [])[0]:
                if link is self._ended:
                    return
                data = link.recv(1 << 20)
                self.messages += data.count(b"data: ")
                if not data:
                    left.discard(link)
