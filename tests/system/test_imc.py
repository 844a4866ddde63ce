"""A run over ROS beside a stranger's console, which shares no code with musselbed: it watches and orders by IMC."""

from __future__ import annotations

import json
import math
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from queue import Queue
from typing import Any

import pytest
from imc_codec import Codec, header_of, name_of
from patient import PATIENCE_S
from programs import MUSSELBED, Begin, lines_of, wait_until
from scenario_files import write_scenario

from apad_bridge.scenario.area.local_frame import LocalFrame

pytestmark = pytest.mark.system
NEPTUS = 0x4001
FRAME = LocalFrame(43.9330937, 15.4443468)
CONSOLE = Path(__file__).parents[1] / "counterparts" / "imc_console" / "console.py"
FAULTS = ("--swap", "--duplicate", "1", "--bad-crc", "0.2", "--seed", "1")
"""It sends in the other byte order, each packet twice, and some of them damaged."""


class Console:
    """A process of `tests/counterparts/imc_console`: lines in, and a line of JSON for each answer and each event."""

    def __init__(self, begin: Begin) -> None:
        words = (sys.executable, "-u", CONSOLE, "--port", 0, "--discovery-port", 0, *FAULTS)
        self._process = begin(*words, stdin=-1)
        self.lines: list[dict[str, Any]] = []
        self._new: Queue[dict[str, Any]] = Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._new.put(json.loads(line))

    def sees(self, event: str, holds: Callable[[dict[str, Any]], bool] = lambda _: True) -> dict[str, Any]:
        """The next event of this kind for which it holds."""
        while True:
            self.lines.append(line := self._new.get(timeout=PATIENCE_S))
            if line.get("event", line.get("answer")) == event and holds(line):
                return line

    def say(self, line: str) -> dict[str, Any]:
        self._process.stdin.write(line + "\n")  # type: ignore[union-attr]
        self._process.stdin.flush()  # type: ignore[union-attr]
        return self.sees(line.split()[0])

    def ask(self, line: str) -> dict[str, Any]:
        """Gives an order; returns the vehicle's reply to it."""
        number = self.say(line)["request_id"]
        return self.sees("reply", lambda it: it["request_id"] == number)


def test_a_strangers_console_watches_a_run_moves_the_apad_inside_the_fence_alone_and_aborts(
    tmp_path: Path, begin: Begin
) -> None:
    console, run = Console(begin), tmp_path / "run"
    port = console.sees("ready")["udp"][1]
    scenario = write_scenario(
        tmp_path / "imc.yaml",
        duration_s=20_000,
        theta=1,
        fleet={"count": 6, "start": {"charge": [0.9, 1.0]}},
        area={"fence": [[-2, -2], [30, -2], [30, 23], [-2, 23]]},
    )
    fly = (*MUSSELBED, "run", scenario, "--speed", 10, "--out", run, "--json")
    flight = begin(*fly, "--imc", "--imc-port", 0, "--neptus", f"{NEPTUS:#x}@127.0.0.1:{port}")
    apad = console.sees("system", lambda it: it["system"].startswith("apad1"))["system"]

    def goes(order: str, north_m: float, east_m: float, more: str = "0.5 m/s") -> str:
        return "{} {} {:.7f} {:.7f} {}".format(order, apad, *FRAME.to_geographic(north_m, east_m), more)

    def is_near(place_m: tuple[float, float]) -> None:
        """Waits until the console sees the aPad there."""
        console.sees(
            "state",
            lambda it: (
                it["system"] == apad
                and math.dist(FRAME.to_local(it["lat_deg"], it["lon_deg"]), place_m) < 1.0
            ),
        )

    console.sees("mode", lambda it: it.get("plan_id") == "mission")
    # Outside the fence: refused with the reason, and the mission goes on as if nothing had been asked.
    refused = console.ask(goes("goto", 40.0, 10.0))
    assert refused["result"] == "FAILURE" and "fence" in refused["info"]
    # Inside: the aPad goes there, and the console sees it there.
    assert console.ask(goes("goto", 5.0, 6.0))["result"] == "SUCCESS"
    is_near((5.0, 6.0))
    # Stopped on the way, which is long for a busy machine too; then it is sent elsewhere.
    assert console.ask(goes("goto", 25.0, 18.0, "0.1 m/s"))["result"] == "SUCCESS"
    assert console.ask(f"stop {apad}")["result"] == "SUCCESS"
    console.say(goes("keep", 10.0, 10.0, "0.5 m/s radius=2 via=bare"))
    is_near((10.0, 10.0))
    console.say(f"abort {apad}")
    console.sees("mode", lambda it: it["mode"] == "BLOCKED")
    orders = [(it["order"], it["by"]) for it in lines_of(run, "operator")]
    assert orders == [(it, "IMC 0x4001") for it in ("go to", "go to", "stop", "hold", "abort")]
    assert [it["guard"] for it in lines_of(run, "refused")] == ["fence"]
    # The mission lost the aPad to the first accepted order, and not before.
    assert [it["t"] for it in lines_of(run, "override")] == [lines_of(run, "operator")[0]["t"]]
    assert not [it for it in console.lines if it.get("event") in ("bad_datagram", "warning", "conflict")]
    # The log is written at each heartbeat, and the summary after the journal's last line.
    codec, (log,) = Codec(tmp_path), run.glob("imc/*/*/Data.lsf")

    def logged() -> list[Any]:
        return codec.read_log(log.read_bytes())

    wait_until(lambda: "Abort" in map(name_of, logged()) and (run / "summary.json").exists())
    assert {header_of(it).src for it in logged() if name_of(it) == "Abort"} == {NEPTUS}
    times_s = [header_of(it).timestamp for it in logged()]
    assert len(times_s) > 100 and times_s == sorted(times_s)
    assert json.loads((run / "summary.json").read_text())["end_reason"] == "a call"
    assert flight.wait(PATIENCE_S) == 0
