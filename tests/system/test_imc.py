"""A run over ROS beside consoles that watch and order: one scripted with an independent IMC codec, and a stranger's."""

from __future__ import annotations

import json
import math
import queue
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from imc_codec import Codec, header_of, name_of
from patient import PATIENCE_S
from programs import MUSSELBED, begun, lines_of, wait_until
from scenario_files import write_scenario

from apad_bridge.scenario.area.local_frame import LocalFrame

pytestmark = pytest.mark.system
NEPTUS = 0x4001
USV = 3
FRAME = LocalFrame(43.9330937, 15.4443468)
CONSOLE = Path(__file__).parents[1] / "counterparts" / "imc_console" / "console.py"
START, STOP = 0, 1
READY, EXECUTING = 1, 3
SUCCESS, FAILURE = 1, 2


class Console:
    """What a console hears, and its orders. `await_message` waits for one that was not heard before."""

    def __init__(self, codec: Codec) -> None:
        self.codec = codec
        self.apad = 0
        """The aPad's id, once it was announced: another run on this machine may have the first."""
        self.heard: list[Any] = []
        self.gateway: tuple[str, int] | None = None
        self._requests = 0
        self.link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.link.bind(("127.0.0.1", 0))
        self.link.settimeout(1.0)

    def await_message(self, name: str, holds: Callable[[Any], bool] = lambda _: True) -> Any:
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            try:
                packet, self.gateway = self.link.recvfrom(65_535)
            except TimeoutError:
                continue
            message = self.codec.read(packet)
            self.heard.append(message)
            if name_of(message) == "Announce" and message.sys_type == USV:
                self.apad = header_of(message).src
            if name_of(message) == name and holds(message):
                return message
        raise AssertionError(f"no such {name} came within {PATIENCE_S:g} s")

    def order(self, message: Any, src: int = NEPTUS) -> None:
        assert self.gateway is not None
        self.link.sendto(self.codec.pack(message, src, self.apad), self.gateway)

    def start(self, north_m: float, east_m: float, speed_m_s: float = 0.5) -> Any:
        """Starts a plan with one go-to; returns the answer."""
        latitude, longitude = map(math.radians, FRAME.to_geographic(north_m, east_m))
        make = self.codec.make
        goto = make("Goto", lat=latitude, lon=longitude, speed=speed_m_s)
        plan = make(
            "PlanSpecification",
            plan_id="over there",
            maneuvers=[make("PlanManeuver", maneuver_id="1", data=goto)],
        )
        return self.control(START, plan, "over there")

    def control(self, op: int, arg: Any = None, plan_id: str = "") -> Any:
        self._requests += 1
        number = self._requests
        self.order(self.codec.make("PlanControl", op=op, arg=arg, plan_id=plan_id, request_id=number))
        return self.await_message("PlanControl", lambda it: it.request_id == number)


@pytest.fixture(scope="module")
def codec(tmp_path_factory: pytest.TempPathFactory) -> Codec:
    return Codec(tmp_path_factory.mktemp("imc"))


@pytest.fixture
def console(codec: Codec) -> Iterator[Console]:
    opened = Console(codec)
    yield opened
    opened.link.close()


@contextmanager
def run_beside(tmp_path: Path, host: str, port: int) -> Iterator[Path]:
    """Six aMussels in a fenced pool, flown over ROS ten times faster than real time, with a gateway beside the run."""
    path = write_scenario(
        tmp_path / "imc.yaml",
        duration_s=20_000,
        theta=1,
        fleet={"count": 6, "start": {"charge": [0.9, 1.0]}},
        area={"fence": [[-2, -2], [30, -2], [30, 23], [-2, 23]]},
    )
    fly = (*MUSSELBED, "run", path, "--speed", 10, "--out", tmp_path / "run", "--json")
    with begun(*fly, "--imc", "--imc-port", 0, "--neptus", f"{NEPTUS:#x}@{host}:{port}") as process:
        yield tmp_path / "run"
    assert process.returncode in (0, 130)


@pytest.fixture
def run_dir(tmp_path: Path, console: Console) -> Iterator[Path]:
    with run_beside(tmp_path, *console.link.getsockname()) as path:
        yield path


def test_a_scripted_console_watches_a_run_moves_the_apad_inside_the_fence_alone_and_aborts(
    console: Console, run_dir: Path
) -> None:
    announced = console.await_message("Announce", lambda it: it.sys_type == USV)
    assert announced.sys_name.startswith("apad1")
    amussels = 0x9A00 + (console.apad - 0x2A01) * 4

    def of_apad(message: Any) -> bool:
        return bool(header_of(message).src == console.apad)

    console.await_message("PlanControlState", lambda it: it.state == EXECUTING and it.plan_id == "mission")
    console.await_message("FuelLevel", lambda it: header_of(it).src == amussels + 6)

    # Outside the fence: refused with the reason, and the mission goes on as if nothing had been asked.
    refused = console.start(40.0, 10.0)
    assert refused.type == FAILURE and "fence" in refused.info
    console.await_message("PlanControlState", lambda it: it.state == EXECUTING and it.plan_id == "mission")

    # Of a console that is not listed: not even answered.
    console.order(console.codec.make("Abort"), src=0x4002)

    # Inside: the aPad goes there, and the console sees it under way and there.
    assert console.start(5.0, 6.0).type == SUCCESS
    console.await_message("PlanControlState", lambda it: it.state == EXECUTING and it.plan_id == "over there")
    console.await_message(
        "EstimatedState", lambda it: of_apad(it) and math.dist((it.x, it.y), (5.0, 6.0)) < 1.0
    )
    arrived = console.await_message("PlanControlState", lambda it: it.state == READY)
    assert arrived.last_outcome == SUCCESS

    # Stopped on the way, which is long for a busy machine too, it stays; then it is sent elsewhere.
    assert console.start(25.0, 18.0, 0.1).type == SUCCESS
    console.await_message("EstimatedState", lambda it: of_apad(it) and it.x > 7.0)
    assert console.control(STOP).type == SUCCESS
    console.await_message("PlanControlState", lambda it: it.state == READY)
    latitude, longitude = map(math.radians, FRAME.to_geographic(10.0, 10.0))
    console.order(console.codec.make("StationKeeping", lat=latitude, lon=longitude, radius=2.0))
    console.await_message("LogBookEntry", lambda it: it.text == "hold: done")
    console.await_message(
        "EstimatedState", lambda it: of_apad(it) and math.dist((it.x, it.y), (10.0, 10.0)) < 1.0
    )

    console.order(console.codec.make("Abort"))
    console.await_message(
        "LogBookEntry", lambda it: it.text.startswith("the mission ended: a call: abort by IMC")
    )
    console.await_message("PlanControlState", lambda it: it.state == 0)
    orders = [(it["order"], it["by"]) for it in lines_of(run_dir, "operator")]
    assert orders == [(it, "IMC 0x4001") for it in ("go to", "go to", "stop", "hold", "abort")]

    assert [it["guard"] for it in lines_of(run_dir, "refused")] == ["fence"]
    # The mission lost the aPad to the first accepted order, and not before.
    assert [it["t"] for it in lines_of(run_dir, "override")] == [lines_of(run_dir, "operator")[0]["t"]]

    (log,) = run_dir.glob("imc/*/*/Data.lsf")

    def aborts() -> list[Any]:
        return [it for it in console.codec.read_log(log.read_bytes()) if name_of(it) == "Abort"]

    # The log is written at each heartbeat, and the summary after the journal's last line.
    wait_until(lambda: aborts() and (run_dir / "summary.json").exists())
    assert {header_of(it).src for it in aborts()} == {NEPTUS}
    times_s = [header_of(it).timestamp for it in console.codec.read_log(log.read_bytes())]
    assert len(times_s) > 100 and times_s == sorted(times_s)
    assert "not listed" in (run_dir / "imc.log").read_text()
    assert json.loads((run_dir / "summary.json").read_text())["end_reason"] == "a call"


class StrangersConsole:
    """A process of `tests/counterparts/imc_console`: lines in, and a line of JSON for each answer and each event."""

    def __init__(self, *options: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-u", CONSOLE, "--port", "0", "--discovery-port", "0", *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.lines: list[dict[str, Any]] = []
        self._new: queue.Queue[dict[str, Any]] = queue.Queue()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._new.put(json.loads(line))

    def await_line(self, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        deadline_s = time.monotonic() + PATIENCE_S
        while (left_s := deadline_s - time.monotonic()) > 0:
            self.lines.append(self._new.get(timeout=left_s))
            if holds(self.lines[-1]):
                return self.lines[-1]
        raise AssertionError(f"no such line came within {PATIENCE_S:g} s")

    def say(self, line: str) -> dict[str, Any]:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self.await_line(lambda it: it.get("answer") == line.split()[0])

    def ask(self, line: str) -> dict[str, Any]:
        """Gives an order; returns the vehicle's reply to it."""
        number = self.say(line)["request_id"]
        return self.await_line(lambda it: it.get("event") == "reply" and it["request_id"] == number)

    def close(self) -> None:
        with self._process:
            self._process.terminate()
            self._reader.join(PATIENCE_S)


def test_a_stranger_s_console_flies_the_apad_in_the_other_byte_order_and_what_comes_twice_counts_once(
    tmp_path: Path,
) -> None:
    console = StrangersConsole("--swap", "--duplicate", "1", "--bad-crc", "0.2", "--seed", "1")
    try:
        port = console.await_line(lambda it: it.get("event") == "ready")["udp"][1]
        with run_beside(tmp_path, "127.0.0.1", port) as run_dir:
            system = console.await_line(lambda it: it.get("event") == "system")["system"]
            console.await_line(lambda it: it.get("event") == "mode" and it.get("plan_id") == "mission")

            def place(north_m: float, east_m: float) -> str:
                return "{:.7f} {:.7f}".format(*FRAME.to_geographic(north_m, east_m))

            refused = console.ask(f"goto {system} {place(40.0, 10.0)} 0.5 m/s")
            assert refused["result"] == "FAILURE" and "fence" in refused["info"]
            assert console.ask(f"goto {system} {place(5.0, 6.0)} 0.5 m/s")["result"] == "SUCCESS"
            console.await_line(
                lambda it: (
                    it.get("event") == "state"
                    and it["system"] == system
                    and math.dist(FRAME.to_local(it["lat_deg"], it["lon_deg"]), (5.0, 6.0)) < 1.0
                )
            )
            assert console.ask(f"stop {system}")["result"] == "SUCCESS"
            console.say(f"abort {system}")
            console.await_line(lambda it: it.get("event") == "mode" and it["mode"] == "BLOCKED")
            wait_until(lambda: (run_dir / "summary.json").exists())
            orders = [it["order"] for it in lines_of(run_dir, "operator")]
            assert orders == ["go to", "stop", "abort"]
        assert not [it for it in console.lines if it.get("event") in ("bad_datagram", "warning", "conflict")]
    finally:
        console.close()
