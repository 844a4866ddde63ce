"""A mission between two machines whose clocks differ, with a poor Wi-Fi or none: its cost, and if the logs merge whole.

The machines are network namespaces. The vehicle's has the master, the aPad of generation B, the watchdog and `rosbag
record`, with a clock that is ahead. In the row `ashore` the other one has `musselbed run`, which takes the aPad for a real
one, and `rosbag record`; the link loses and delays packets either way. In the row `aboard` supervisor and aMussels run on
the vehicle's computer. The shore only records then, and is cut off from the begin of the mission until shortly before its
end. What the preflight says of such a network is overridden, and a person is played who says `musselbed continue` when a
guard has stopped the aPad and its cause is over. The same scenario in virtual time is the peer.
"""

from __future__ import annotations

import contextlib
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from two_machines import (
    Link,
    Lose,
    Machine,
    Programs,
    interrupt,
    linked_machines,
    master_uri,
    why_no_two_machines,
)

from apad_bridge.events.event import Event
from apad_bridge.events.graph_events import MasterGone
from apad_bridge.events.guard_events import DangerOver, GuardReacted
from apad_bridge.events.person_events import PersonOrdered
from apad_bridge.events.run_events import RunEnded
from apad_bridge.events.vehicle_events import VehicleHeard, VehicleSilent
from apad_bridge.records.bag import recorded_messages
from apad_bridge.records.journal import JournalTail, read_journal
from apad_bridge.ros.types.messages import generated_folder
from apad_bridge.scenario.loader import from_data, load, resolve, write_resolved
from benchmarks.rows import told

ROOT = Path(__file__).parents[3]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
LINK = Link(loss=0.05, delay_s=0.2)
CALM = Link(loss=0.0, delay_s=0.0)
ABOARD = "aboard"
ROWS = {"ashore": LINK, ABOARD: Link(loss=1.0, delay_s=0.0)}
"""The rows: the link between vehicle and shore once it flies."""
END_S = 30.0
"""The shore is back so long before the mission ends."""
AHEAD_S = 2.0
"""The vehicle's clock is so far ahead of the bench's."""
THETA = 30
SHORT_MINUTES, SHORT_AGENTS = 0.2, 2
PATIENCE_S = 600.0
"""A program registers each of a hundred topics by a call to the master: a second each, over this link."""
GUARDS = {"position_age_s": 5}
"""Packets that are lost one after the other hold up all positions behind them: for more than 2 s every few minutes."""
RECORDED = "/apad1/.*|/musselbed/(apad|beliefs|heartbeat|mission)"
"""The topics of the vehicle's recorder; the bench's takes everything."""
DESPITE = ("delay", "loss", "clock", "gps", "nodes", "disk", "memory", "energy", "watchdog", "lag")
ON_RED = (*(word for it in DESPITE for word in ("--despite", it, "--accept", it)), "--accept", "origin")
"""The aPad flies on red, and where a check cannot tell; the simulated one names no origin of its places."""
LOOK_S = 1.0
CALM_S = 5.0
"""The person waits for so long after a guard's newest line."""


def measure(minutes: float = 60.0, short: bool = False, row: list[str] | None = None) -> dict[str, Any]:
    """Each row's flight and merged logs, beside the same scenario in virtual time.

    In the short tier the link is good until the flight has begun: to start over a poor one takes minutes. Its two
    aMussels have few topics to register.
    """
    if why := why_no_two_machines() or ("" if shutil.which("faketime") else "faketime is missing"):
        raise SystemExit(f"this machine cannot play two: {why}")
    if unknown := [it for it in row or () if it not in ROWS]:
        raise SystemExit(f"no such row: {', '.join(unknown)}; rows: {', '.join(ROWS)}")
    minutes = SHORT_MINUTES if short else minutes
    with tempfile.TemporaryDirectory(prefix="musselbed-network-") as folder:
        home = Path(folder)
        scenario = written_scenario(home, minutes, SHORT_AGENTS if short else None)
        peer = subprocess.run(
            [*MUSSELBED, "run", str(scenario), "--time", "asap", "--out", str(home / "asap"), "--json"],
            stdout=subprocess.PIPE,
            check=True,
            cwd=home,
        )
        told({"virtual_time": figures(json.loads(peer.stdout))})
        result: dict[str, Any] = {
            "minutes": minutes,
            "theta": THETA,
            "clock_ahead_s": AHEAD_S,
            "virtual_time": figures(json.loads(peer.stdout)),
        }
        for name in row or ROWS:
            (home / name).mkdir()
            with linked_machines(CALM if short or name == ABOARD else LINK) as (vehicle, shore, lose):
                flown = fly(home / name, scenario, minutes, vehicle, shore, lose, is_aboard=name == ABOARD)
            result[name] = {
                "link": asdict(ROWS[name]),
                "flight": figures(flown.summary),
                "run": told_by_journal(flown.run),
                "red": red(flown.run / "preflight.json"),
                "logs": merged(flown.bags, home / name / "whole.bag"),
            }
            told({name: result[name]["flight"]})
        return result


def written_scenario(home: Path, minutes: float, agents: int | None) -> Path:
    scenarios = ROOT / "launch_scripts" / "scenarios"
    data = resolve(load(scenarios / "real-apad.yaml"))
    data |= {"duration_s": 60.0 * minutes, "theta": THETA}
    data["apad"] |= {"generation": "b"}
    data["guards"] |= GUARDS
    if agents is not None:
        data["fleet"] |= {"count": agents, "start": {"charge": [0.3, 0.7]}}
    path = home / "scenario.yaml"
    write_resolved(path, from_data(data, "network"))
    return path


@dataclass(frozen=True, slots=True)
class Flown:
    summary: dict[str, Any]
    run: Path
    bags: tuple[Path, Path]
    """The vehicle's and the bench's."""


def fly(
    home: Path,
    scenario: Path,
    minutes: float,
    vehicle: Machine,
    shore: Machine,
    lose: Lose,
    *,
    is_aboard: bool,
) -> Flown:
    """Flies it to its end, `minutes` over its row's link; what it started ends with this process, too."""
    sleeping = {"PYTHONPATH": str(ROOT / "tests" / "shared" / "beside_faketime")}
    ahead = ["faketime", "--exclude-monotonic", "-f", f"+{AHEAD_S:g}s"]
    messages = str(generated_folder())
    workspace = {"PYTHONPATH": f"{sleeping['PYTHONPATH']}:{messages}", "ROS_PACKAGE_PATH": messages}
    with ExitStack() as stack:
        programs = Programs(home, master_uri(vehicle), stack, PATIENCE_S + 60 * minutes)
        programs.start_master(vehicle, *ahead, environment=sleeping)
        programs.start(vehicle, "apad", *ahead, *MUSSELBED, "apad", str(scenario), environment=sleeping)
        programs.wait_until(lambda: "ready" in programs.said("apad"), "the aPad did not start")
        watchdog = str(ROOT / "launch_scripts" / "vehicle_watchdog")
        words = [*ahead, "/usr/bin/python3", watchdog, "--apad", "/apad1", "--silence-s", "10"]
        programs.start(vehicle, "watchdog", *words, environment=workspace)
        record = ["/usr/bin/rosbag", "record", "-O"]
        # Under faketime its waits end at once: it takes all of a processor that it gets.
        apad_bag = ["nice", "-n", "19", *ahead, *record, "apad.bag", "-e", RECORDED]
        recorders = [
            programs.start(vehicle, "apad-bag", *apad_bag, environment=sleeping),
            programs.start(shore, "station-bag", *record, "station.bag", "-a"),
        ]
        run = [*MUSSELBED, "run", str(scenario), "--apad", "ros", "--out", "run", "--json", *ON_RED]
        errors = home / "run.log"
        bench, clock = (vehicle, ahead) if is_aboard else (shore, [])
        flight = programs.start(
            bench, "run", *clock, *run, errors=errors, environment=sleeping if is_aboard else {}
        )
        journal = programs.folder(bench) / "run" / "journal.jsonl"
        with person(journal.parent):
            programs.wait_until(
                lambda: flight.poll() is not None or (journal.exists() and read_journal(journal).last_ms > 0),
                "no flight began",
            )
            link = ROWS[ABOARD if is_aboard else "ashore"]
            lose(link.loss, link.delay_s)
            if is_aboard:
                back_s = time.monotonic() + 60 * minutes - min(END_S, 20 * minutes)
                programs.wait_until(
                    lambda: flight.poll() is not None or time.monotonic() > back_s, "the cut did not end"
                )
                lose(CALM.loss, CALM.delay_s)
            with closing(JournalTail(journal)) as tail:
                programs.wait_until(
                    lambda: flight.poll() is not None or any(tail.read_new().events(RunEnded)),
                    "the mission did not end",
                )
            # To leave a topic is a call to the master: a second for each of a hundred, over a poor link.
            lose(CALM.loss, CALM.delay_s)
            code = flight.wait()
        if code != 0:
            raise SystemExit(f"the flight ended with {code}: {errors.read_text()}")
        for recorder in recorders:
            interrupt(recorder)
        # The recorder outlives `rosbag`, which started it, and then gives its bag the final name.
        bags = [programs.folder(vehicle) / "apad.bag", programs.folder(shore) / "station.bag"]
        programs.wait_until(lambda: all(it.exists() for it in bags), "a recorder did not close its bag")
        return Flown(json.loads(programs.said("run")), programs.folder(bench) / "run", (bags[0], bags[1]))


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
            if any(journal.read_new().events(*STOPPED)):
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


STOPPED: tuple[type[Event], ...] = (GuardReacted, DangerOver, VehicleSilent, VehicleHeard)


def figures(summary: dict[str, Any]) -> dict[str, Any]:
    keys = ("ended_by", "services", "cost_m", "amussels_lost", "steps_given_up")
    return {key: summary[key] for key in keys} | {"uptime": summary["uptime_paper"]}


def told_by_journal(run: Path) -> dict[str, Any]:
    """The counts of guard stops by cause, of silences of the vehicle, and of a person's words that it may go on."""
    journal = read_journal(run / "journal.jsonl")
    return {
        "guards": Counter(it.cause for _, it in journal.events(GuardReacted)),
        "vehicle_silent": len(list(journal.events(VehicleSilent))),
        "master_gone": len(list(journal.events(MasterGone))),
        "person_asked": len(list(journal.events(PersonOrdered))),
    }


def red(preflight: Path) -> list[str]:
    return [it["check"] for it in json.loads(preflight.read_text())["findings"] if it["status"] == "FAIL"]


def merged(bags: tuple[Path, Path], out: Path) -> dict[str, Any]:
    """The result of `musselbed logs merge` for the two bags, and the number of messages of either that it lacks."""
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
