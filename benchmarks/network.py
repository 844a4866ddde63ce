"""A mission over a poor Wi-Fi, between two machines whose clocks differ: what it costs, and whether the logs merge whole.

The machines are network namespaces. The vehicle's has the master, the aPad of generation B, the watchdog and `rosbag
record`, with a clock that is ahead; the bench's has `musselbed run`, which takes the aPad for a real one, and `rosbag
record`. The link between them loses and delays packets either way. What the preflight says of such a network is overridden,
and a person is played who says `musselbed continue` when a guard has stopped the aPad and its cause is over. The same
scenario in virtual time is the peer.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from two_machines import Link, Machine, two_machines, why_no_two_machines

from apad_bridge.records.bag import recorded_messages
from apad_bridge.records.event_kinds import EventKind
from apad_bridge.records.journal import JournalTail
from apad_bridge.ros.types.messages import generated_folder
from apad_bridge.scenario.loader import from_data, load, resolve, write_resolved

ROOT = Path(__file__).parents[1]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
LINK = Link(loss=0.05, delay_s=0.2)
AHEAD_S = 2.0
"""The vehicle's clock is so far ahead of the bench's."""
THETA = 30
PATIENCE_S = 600.0
"""A recorder of everything leaves each of a hundred topics by a call to the master: a second each, over this link."""
GUARDS = {"position_age_s": 5, "frozen_s": 8}
"""An order takes 2 s to this vehicle: five ways there and back. The scenario's own 2 s stop it at the start of each leg."""
RECORDED = "/apad1/.*|/musselbed/(apad|beliefs|heartbeat|mission)"
"""The topics of the vehicle's recorder; the bench's takes everything."""
DESPITE = ("delay", "loss", "clock", "gps", "nodes", "disk", "memory", "energy")
LOOK_S = 1.0
END_S = 10.0
CALM_S = 5.0
"""The person waits for so long after a guard's newest line."""


def measure(minutes: float = 60.0) -> dict[str, Any]:
    """The flight, its peer in virtual time, and the merged logs."""
    if why := why_no_two_machines() or ("" if shutil.which("faketime") else "faketime is missing"):
        raise SystemExit(f"this machine cannot play two: {why}")
    with tempfile.TemporaryDirectory(prefix="musselbed-network-") as folder:
        home = Path(folder)
        scenario = written_scenario(home, minutes)
        peer = subprocess.run(
            [*MUSSELBED, "run", str(scenario), "--time", "asap", "--out", str(home / "asap"), "--json"],
            stdout=subprocess.PIPE,
            check=True,
            cwd=home,
        )
        with two_machines(LINK) as (vehicle, bench):
            flown = fly(home, scenario, vehicle, bench)
        return {
            "minutes": minutes,
            "theta": THETA,
            "loss": LINK.loss,
            "delay_s": LINK.delay_s,
            "clock_ahead_s": AHEAD_S,
            "flight": figures(json.loads(flown)),
            "virtual_time": figures(json.loads(peer.stdout)),
            "run": told_by_journal(home / "run"),
            "red": red(home / "run" / "preflight.json"),
            "logs": merged(home),
        }


def written_scenario(home: Path, minutes: float) -> Path:
    scenarios = ROOT / "launch_scripts" / "scenarios"
    data = resolve(load(scenarios / "real-apad.yaml"))
    data |= {"duration_s": 60.0 * minutes, "theta": THETA}
    data["apad"] |= {"generation": "b"}
    data["guards"] |= GUARDS
    path = home / "scenario.yaml"
    write_resolved(path, from_data(data, "network"))
    return path


def fly(home: Path, scenario: Path, vehicle: Machine, bench: Machine) -> str:
    """Flies it; returns the summary's JSON. The two bags are in `home`."""
    uri = f"http://{vehicle.address}:11311"
    sleeping = str(ROOT / "tests" / "shared" / "beside_faketime")
    at_sea = vehicle.environment(uri) | {"ROS_HOME": str(home / "ros"), "PYTHONPATH": sleeping}
    ashore = bench.environment(uri) | {"ROS_HOME": str(home / "ros")}
    ahead = ["faketime", "--exclude-monotonic", "-f", f"+{AHEAD_S:g}s"]
    messages = str(generated_folder())
    workspace = {"PYTHONPATH": f"{sleeping}:{messages}", "ROS_PACKAGE_PATH": messages}
    with ExitStack() as stack:

        def start(
            machine: Machine, environment: dict[str, str], name: str, *words: str
        ) -> subprocess.Popen[str]:
            stdout = stack.enter_context((home / f"{name}.log").open("w+"))
            process = subprocess.Popen(
                machine.command(*words),
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=subprocess.STDOUT,
                env=environment,
                cwd=home,
                text=True,
                start_new_session=True,
            )
            stack.callback(end, process)
            return process

        start(vehicle, at_sea, "master", *ahead, "/usr/bin/rosmaster", "--core")
        wait_until(lambda: answers(vehicle, uri))
        start(vehicle, at_sea, "apad", *ahead, *MUSSELBED, "apad", str(scenario))
        wait_until(lambda: "ready" in (home / "apad.log").read_text())
        watchdog = [
            *ahead,
            "/usr/bin/python3",
            str(ROOT / "launch_scripts" / "vehicle_watchdog"),
            "--apad",
            "/apad1",
        ]
        start(vehicle, at_sea | workspace, "watchdog", *watchdog, "--silence-s", "10")
        record = ["/usr/bin/rosbag", "record", "-O"]
        recorders = [
            start(vehicle, at_sea, "apad-bag", *ahead, *record, "apad.bag", "-e", RECORDED),
            start(bench, ashore, "station-bag", *record, "station.bag", "-a"),
        ]
        run = [*MUSSELBED, "run", str(scenario), "--apad", "ros", "--out", "run", "--json"]
        run += [word for it in DESPITE for word in ("--despite", it)]
        with (home / "run.log").open("w") as errors:
            flight = subprocess.Popen(
                bench.command(*run),
                stdout=subprocess.PIPE,
                stderr=errors,
                env=ashore,
                cwd=home,
                text=True,
                start_new_session=True,
            )
            stack.callback(end, flight)
            with person(home / "run"):
                said, _ = flight.communicate()
        if flight.returncode != 0:
            raise SystemExit(f"the flight ended with {flight.returncode}: {(home / 'run.log').read_text()}")
        for recorder in recorders:
            os.killpg(recorder.pid, signal.SIGINT)
        # The recorder outlives `rosbag`, which started it, and then gives its bag the final name.
        wait_until(lambda: (home / "apad.bag").exists() and (home / "station.bag").exists())
        return said


@contextlib.contextmanager
def person(run: Path) -> Iterator[None]:
    """While entered, says `musselbed continue` when a guard stopped the aPad and nothing more came of it for `CALM_S`."""
    ended = threading.Event()

    def watch() -> None:
        while not (run / "journal.jsonl").exists():
            if ended.wait(LOOK_S):
                return
        journal = JournalTail(run / "journal.jsonl")
        stopped_s: float | None = None
        while not ended.wait(LOOK_S):
            if any(it["kind"] in STOPPED for it in journal.read_new().lines):
                stopped_s = time.monotonic()
            if stopped_s is not None and time.monotonic() - stopped_s > CALM_S:
                subprocess.run(
                    [*MUSSELBED, "continue", str(run), "--by", "the benchmark"], stdout=subprocess.DEVNULL
                )
                stopped_s = None
        journal.close()

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


STOPPED = (EventKind.GUARD, EventKind.GUARD_OVER, EventKind.VEHICLE_SILENT, EventKind.VEHICLE_HEARD)


def end(process: subprocess.Popen[str]) -> None:
    """Ends it and what it started in its session."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(END_S)


def answers(machine: Machine, uri: str) -> bool:
    """A master answers at `uri`."""
    host, port = uri.removeprefix("http://").split(":")
    words = [sys.executable, "-c", f"import socket; socket.create_connection(({host!r}, {port}), 1)"]
    return subprocess.run(machine.command(*words), stderr=subprocess.DEVNULL).returncode == 0


def wait_until(is_so: Callable[[], bool]) -> None:
    deadline_s, pause = time.monotonic() + PATIENCE_S, threading.Event()
    while not is_so():
        if time.monotonic() > deadline_s:
            raise SystemExit("a part of the network did not start")
        pause.wait(0.2)


def figures(summary: dict[str, Any]) -> dict[str, Any]:
    keys = ("ended_by", "services", "cost_m", "amussels_lost", "steps_given_up")
    return {key: summary[key] for key in keys} | {"uptime": summary["uptime_paper"]}


def told_by_journal(run: Path) -> dict[str, Any]:
    """The counts of guard stops by cause, of silences of the vehicle, and of a person's words that it may go on."""
    tail = JournalTail(run / "journal.jsonl")
    lines = tail.read_new().lines
    tail.close()
    return {
        "guards": Counter(it["cause"] for it in lines if it["kind"] == EventKind.GUARD),
        "vehicle_silent": sum(it["kind"] == EventKind.VEHICLE_SILENT for it in lines),
        "master_gone": sum(it["kind"] == EventKind.MASTER_GONE for it in lines),
        "person_asked": sum(it["kind"] == EventKind.OPERATOR for it in lines),
    }


def red(preflight: Path) -> list[str]:
    return [it["check"] for it in json.loads(preflight.read_text())["findings"] if it["status"] == "FAIL"]


def merged(home: Path) -> dict[str, Any]:
    """The result of `musselbed logs merge` for the two bags, and the number of messages of either that it lacks."""
    bags = [home / "apad.bag", home / "station.bag"]
    out = home / "whole.bag"
    done = subprocess.run(
        [*MUSSELBED, "logs", "merge", *map(str, bags), "--out", str(out), "--json"],
        stdout=subprocess.PIPE,
        check=True,
    )
    told = json.loads(done.stdout)
    first, second, whole = (contents(it) for it in (*bags, out))
    return {
        **told["messages"],
        "lacking": sum(((first | second) - whole).values()),
        "offset_s": statistics.median(it["offset_s"] for it in told["clock"] for _ in range(it["messages"])),
        "steps": len(told["steps_s"]),
        "gaps": len(told["gaps"]),
        "missing": {
            name: [it["missing_in_first"], it["missing_in_second"]]
            for name, it in told["topics"].items()
            if it["both"]
        },
        "figures": told["figures"],
    }


def contents(bag: Path) -> Counter[tuple[str, int]]:
    """Each message by topic and bytes, and how often it is there: counted beside the merging code, from the bag alone."""
    return Counter((it.connection.topic, hash(bytes(it.data))) for it in recorded_messages(bag))


def show(result: dict[str, Any], console: Console) -> None:
    table = Table(
        title=f"{result['minutes']:g} min at theta {result['theta']}: {100 * result['loss']:g} % of packets lost, "
        f"{1000 * result['delay_s']:g} ms each way, a clock {result['clock_ahead_s']:g} s ahead"
    )
    for column in ("", "services", "way [m]", "uptime %", "lost", "given up"):
        table.add_column(column, justify="left" if not column else "right")
    for name in ("flight", "virtual_time"):
        it = result[name]
        cells = (it["services"], f"{it['cost_m']:.1f}", f"{it['uptime']['mean']:.2f}", it["amussels_lost"])
        table.add_row(name.replace("_", " "), *map(str, cells), str(it["steps_given_up"]))
    console.print(table)
    run, logs = result["run"], result["logs"]
    console.print(f"red at the preflight, and overridden: {', '.join(result['red']) or 'nothing'}")
    console.print(
        f"guards {dict(run['guards'])}, the vehicle silent {run['vehicle_silent']} times, "
        f"a person asked {run['person_asked']} times"
    )
    console.print(
        f"logs: {logs['first']} messages on the aPad, {logs['second']} at the bench, {logs['both']} in both, "
        f"{logs['merged']} merged, of which {logs['lacking']} lack"
    )
    console.print(
        f"the bench's clock is {logs['offset_s']:+.3f} s from the aPad's (median), with {logs['steps']} steps "
        "that no clock made"
    )
