"""Faults of everything around a vehicle: a link that is cut, a supervisor that is killed, and clocks that differ.

Real processes fly, on two machines that are network namespaces. The vehicle's has the master, the simulated aPad, the
watchdog, and a reader of the wire. The bench's has `musselbed run`, which takes the aPad for a real one. The observer
judges what arrives at the aPad, from the reader's lines alone.

A flight in which nobody hears the bench is safe when the watchdog's stop arrives at the aPad. Clocks that differ end no
flight: there a person says `musselbed stop`, and the time runs from the order to its arrival.
"""

from __future__ import annotations

import json
import math
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from two_machines import Link, Programs, linked_machines, master_uri, why_no_two_machines
from wire_observer import Observer, Place

from apad_bridge.ros.types.messages import generated_folder
from apad_bridge.runs.children import supervisor_of
from apad_bridge.scenario.loader import from_data, resolve, write_resolved
from apad_bridge.scenario.schema import Scenario
from apad_bridge.supervisor.control import Act, Request, ask
from apad_bridge.vehicle.stack_messages import PoseReceived

ROOT = Path(__file__).parents[2]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
WATCHDOG_S = 10.0
"""Seconds of silence after which the watchdog has the aPad hold its place."""
REACTION_S = 3.0
OFF_S = 2.0
CORNERS = ((52.0, 50.0), (49.0, 9.0), (8.0, 11.0), (11.0, 52.0))
"""The aMussels' places, about which each try shifts them: a leg of 25 m takes the aPad 50 s."""
SHIFT_M = 2.0
UNDER_WAY_M = 2.0
STOP_M = 1.5
"""A vehicle at 0.5 m/s goes so far between the position that an order was made from and the order's arrival, at most."""
AFTER_S = 15.0
"""Each try goes on for so long after the stop, with a cut link healed, to see orders that come late."""
DESPITE = ("clock", "gps", "nodes", "disk", "memory", "energy")


@dataclass(frozen=True, slots=True)
class Wire:
    """The reader's lines: positions and orders on the aPad's wire, in the order of time."""

    lines: list[dict[str, Any]]

    @classmethod
    def of(cls, programs: Programs) -> Wire:
        told = programs.said("wire")
        whole = told[: told.rfind("\n") + 1].splitlines()[1:]
        return cls([json.loads(line) for line in whole])

    @property
    def way_m(self) -> float:
        """The way since the first order, as the crow flies."""
        first = next((number for number, it in enumerate(self.lines) if "order" in it), len(self.lines))
        places = [it["position_m"] for it in self.lines[first:] if "position_m" in it]
        return math.dist(places[0], places[-1]) if places else 0.0

    def judged(self, observer: Observer, since_s: float) -> float | None:
        """Has the observer judge each order; returns the time of the first stop after `since_s`, None without one."""
        stopped_s = None
        for it in self.lines:
            at_ms, stops = round(1000 * it["at_s"]), observer.stops
            if "position_m" in it:
                observer.hear(PoseReceived(at_ms, *it["position_m"], it["heading_rad"]))
            elif it["order"] == "stop_mission":
                observer.take_stop()
            elif it["place_m"] is None:
                observer.take_other(at_ms, it["order"])
            else:
                place_m: Place = (it["place_m"][0], it["place_m"][1])
                observer.take_goal(place_m, at_ms, is_hold=it["order"] != "primitive/go2point")
            if observer.stops > stops and stopped_s is None and it["at_s"] > since_s:
                stopped_s = it["at_s"]
        return stopped_s


@dataclass(frozen=True, slots=True)
class AtSea:
    """A flight under way."""

    run: Path
    lose: Callable[[float], None]


def cut_link(flight: AtSea) -> None:
    flight.lose(1.0)


def kill_supervisor(flight: AtSea) -> None:
    pid = supervisor_of(flight.run)
    assert pid is not None, "the run has no supervisor"
    os.kill(pid, signal.SIGKILL)


def say_stop(flight: AtSea) -> None:
    """Says it as `musselbed stop` does, without the start of a command, which takes long where the processor is busy."""
    ask(flight.run, Request(Act.STOP, "the benchmark"))


@dataclass(frozen=True, slots=True)
class Fault:
    inflict: Callable[[AtSea], None]
    limit_s: float
    """The time in which the aPad must be safe."""
    off_s: float = 0.0
    """From the beginning, the clock of the vehicle's machine is so far from the bench's, ahead in every other try."""


FAULTS = {
    "link cut": Fault(cut_link, WATCHDOG_S + REACTION_S),
    "supervisor killed": Fault(kill_supervisor, WATCHDOG_S + REACTION_S),
    "clock 2 s off": Fault(say_stop, REACTION_S, OFF_S),
}


def why_no_flight() -> str:
    """Why this machine cannot fly them; empty if it can."""
    if why := why_no_two_machines():
        return f"two machines on one cannot be: {why}"
    return "" if shutil.which("faketime") else "faketime is missing: apt-get install faketime"


def try_once(fault: Fault, scenario: Scenario, number: int, rng: random.Random) -> dict[str, Any]:
    """Flies one try: a mission under way, the fault, and the time until the aPad is told to stop."""
    with tempfile.TemporaryDirectory(prefix="musselbed-safety-") as folder, ExitStack() as stack:
        home = Path(folder)
        path = written(home, scenario, rng)
        vehicle, bench, lose = stack.enter_context(linked_machines(Link()))
        programs = Programs(home, master_uri(vehicle), stack)
        reader = [sys.executable, "-m", "benchmarks.nodes.wire_reader", vehicle.address, "/apad1"]
        programs.start(vehicle, "wire", *reader, environment={"PYTHONPATH": str(ROOT)})
        programs.wait_until(lambda: "reading" in programs.said("wire"), "the wire is not read")
        off_s = fault.off_s * (1 if number % 2 == 0 else -1)
        clock = ["faketime", "--exclude-monotonic", "-f", f"{off_s:+g}s"] if off_s else []
        sleeping = str(ROOT / "tests" / "shared" / "beside_faketime")
        messages = str(generated_folder())
        programs.start_master(vehicle, *clock, environment={"PYTHONPATH": sleeping})
        apad = [*clock, *MUSSELBED, "apad", str(path)]
        programs.start(vehicle, "apad", *apad, environment={"PYTHONPATH": sleeping})
        programs.wait_until(lambda: "ready" in programs.said("apad"), programs.said("apad"))
        watchdog = [*clock, "/usr/bin/python3", str(ROOT / "launch_scripts" / "vehicle_watchdog")]
        watchdog += ["--apad", "/apad1", "--silence-s", f"{WATCHDOG_S:g}"]
        workspace = {"PYTHONPATH": f"{sleeping}:{messages}", "ROS_PACKAGE_PATH": messages}
        programs.start(vehicle, "watchdog", *watchdog, environment=workspace)
        run = [*MUSSELBED, "run", str(path), "--apad", "ros", "--out", "run"]
        run += [word for it in DESPITE for word in ("--despite", it)]
        flown = programs.start(bench, "run", *run)
        programs.wait_until(
            lambda: flown.poll() is not None or Wire.of(programs).way_m > UNDER_WAY_M,
            "the aPad does not move",
        )
        if flown.poll() is not None:
            raise SystemExit(f"the flight ended: {programs.said('run')}")
        time.sleep(rng.uniform(0.0, 5.0))
        begun_s = time.monotonic()
        fault.inflict(AtSea(programs.folder(bench) / "run", lose))
        stopped_s = _stopped_s(programs, scenario, begun_s, fault.limit_s + AFTER_S)
        lose(0.0)
        time.sleep(AFTER_S)
        observer = Observer.of(scenario, STOP_M)
        Wire.of(programs).judged(observer, begun_s)
    return {
        "outside": len(observer.outside) + len(observer.blind),
        "against_pilot": len(observer.against_pilot),
        "stops": observer.stops,
        "orders": observer.orders,
        "safe_s": None if stopped_s is None else round(stopped_s - begun_s, 1),
    }


def _stopped_s(programs: Programs, scenario: Scenario, begun_s: float, patience_s: float) -> float | None:
    while time.monotonic() < begun_s + patience_s:
        stopped_s = Wire.of(programs).judged(Observer.of(scenario, STOP_M), begun_s)
        if stopped_s is not None:
            return stopped_s
        time.sleep(0.2)
    return None


def written(home: Path, scenario: Scenario, rng: random.Random) -> Path:
    """The scenario with four low aMussels far from the aPad, as a file."""
    rows = ["id,north,east,battery"]
    for number, corner in enumerate(CORNERS, 1):
        north_m, east_m = (it + rng.uniform(-SHIFT_M, SHIFT_M) for it in corner)
        rows.append(f"{number},{north_m:.3f},{east_m:.3f},0.5")
    (home / "low.csv").write_text("\n".join(rows) + "\n")
    data = resolve(scenario)
    data["fleet"] |= {"count": len(CORNERS), "start": str(home / "low.csv")}
    path = home / "scenario.yaml"
    write_resolved(path, from_data(data, "safety"))
    return path
