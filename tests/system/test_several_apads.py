"""Two aPads on one master, by one command: each serves its own share, and the graph says who is whose."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from journals import facts_of, lines_in
from killing import kill_9
from layout_topics import named_topics
from scenario_files import POOL_FILE, SOUND_FILE

from apad_bridge.assembly.division import members
from apad_bridge.runs.children import supervisor_of
from apad_bridge.runs.in_memory import open_lockstep
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of
from apad_bridge.viewers.layouts.fleet import layout_fleet
from apad_bridge.viewers.layouts.kinds import KINDS

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
PATIENCE_S = 240.0
"""A busy machine needs more than a minute to start the processes of two aPads."""
SPEED = 20
LONG_S = 3600
"""Mission seconds that no test waits for: it ends the flight when it has seen what it waited for."""
APADS = ("apad1", "apad2")
FELT_MS = 20_000
"""A second of wall time: an aMussel of another flight has felt its dock by then."""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """Six aMussels in two heaps at theta = 600, an aPad beside each."""
    data = yaml.safe_load(POOL_FILE.read_text())
    data.update(name="two", duration_s=60, theta=600)
    data["area"]["polygon_m"] = [[0, 0], [4, 0], [4, 60], [0, 60]]
    starts = [
        "id,north,east,battery",
        *(f"{n},{1 + n / 3:.2f},{2 if n % 2 else 57},0.6" for n in range(1, 7)),
    ]
    (tmp_path / "two.csv").write_text("\n".join(starts) + "\n")
    data["fleet"].update(count=6, start="two.csv")
    data["apad"]["start_m"] = [2, 3]
    data["apads"] = [{"name": "apad2", "start_m": [2, 56]}]
    data["mission"].update(batch=2)
    data["mission"]["docking"].update(dock_s=3, undock_s=1)
    data["board"]["float_timeout_s"] = 432000
    # A tenth of the paper's: nobody runs empty and sinks before its docking, however long a busy machine lets this fly.
    data["board"]["discharge_per_min"] = 0.0001042713
    path = tmp_path / "two.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def last(scenario: Path, duration_s: int) -> None:
    data = yaml.safe_load(scenario.read_text())
    data.update(duration_s=duration_s)
    scenario.write_text(yaml.safe_dump(data))


def graph_of(run: Path, flying: "subprocess.Popen[str]", named: set[str]) -> dict[str, Any]:
    """Topics and services by name, and their nodes, once both supervisors and whatever is `named` are on the graph."""
    until_s, pause = time.monotonic() + PATIENCE_S, threading.Event()
    uri = None
    while time.monotonic() < until_s and flying.poll() is None:
        if (options := run / "apad2" / "run.json").exists():
            uri = json.loads(options.read_text())["master_uri"]
        if uri:
            with xmlrpc.client.ServerProxy(uri) as master:
                _, _, (publishers, _, services) = master.getSystemState("/test")
            found = dict([*publishers, *services])
            # A supervisor offers this once it has heard the other's claims, and then what it shows of its mission.
            if sum(name.endswith("/retire") for name in found) == 2 and named <= found.keys():
                return found
        pause.wait(0.1)
    raise AssertionError("they never came to be on one graph")


def wait_until(what: Callable[[], object], flying: "subprocess.Popen[str]", why: str) -> None:
    """Polls the journals, which announce nothing; AssertionError when the flight ends before."""
    until_s, pause = time.monotonic() + 2 * PATIENCE_S, threading.Event()
    while not what():
        assert time.monotonic() < until_s and flying.poll() is None, why
        pause.wait(0.1)


def lines_of(run: Path, apad: str) -> list[dict[str, Any]]:
    path = run / apad / "journal.jsonl"
    return list(lines_in(path)) if path.exists() else []


def has_served(run: Path, apad: str) -> bool:
    return any(line["kind"] == "released" and line["full"] for line in lines_of(run, apad))


def misrouted(summary: dict[str, Any]) -> list[str]:
    """What was dropped of packets and contacts. Other drops are a busy machine's, as of an answer that comes too late."""
    return [why for why in summary["dropped"] if re.search("packet|felt|not of this fleet", why)]


def taken_over(run: Path) -> bool:
    """True if apad1 took all of apad2 on, and one of them has felt its dock."""
    first, second = lines_of(run, "apad1"), lines_of(run, "apad2")
    took = {line["id"] for line in first if line["kind"] == "took_on"}
    docked = {line["agent"] for line in first if line["kind"] == "dock" and line["closed"]}
    felt = {line["id"] for line in second if line["kind"] == "truth" and line["docked"]}
    return took == {2, 4, 6} and bool(docked & took) and docked & took <= felt


def ended(run: Path, flying: "subprocess.Popen[str]") -> tuple[str, str]:
    """Asks the supervisors themselves: they end in order, and no parent counts the seconds that they take."""
    supervisors = [supervisor_of(run / apad) for apad in APADS]
    for pid in supervisors:
        if pid is None:
            flying.send_signal(signal.SIGINT)
        else:
            os.kill(pid, signal.SIGINT)
    return flying.communicate(timeout=2 * PATIENCE_S)


def wait_for_plan(journal: Path, flying: "subprocess.Popen[str]") -> None:
    until_s, pause = time.monotonic() + PATIENCE_S, threading.Event()
    while time.monotonic() < until_s and flying.poll() is None:
        if journal.exists() and '"kind":"plan"' in journal.read_text():
            return
        pause.wait(0.05)
    flying.kill()
    raise AssertionError(f"it never planned anything: {flying.communicate()}")


def test_each_serves_its_share_and_nobody_else(scenario: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    last(scenario, LONG_S)
    # Layouts name what is there; of a run's bag a layout also names the aPad's state, which has one name in all bags.
    fleet = layout_fleet(load(scenario), starts_of(load(scenario)))
    by_layout = [named_topics(kind.write(fleet)) - {"/musselbed/apad"} for kind in KINDS.values()]
    assert all(any("apad2" in name for name in named) for named in by_layout)
    command = [*MUSSELBED, "run", str(scenario), "--speed", str(SPEED), "--out", str(run), "--json"]
    flying = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        graph = graph_of(run, flying, {"/amussel2/charge_info"}.union(*by_layout))
        wait_until(lambda: all(has_served(run, apad) for apad in APADS), flying, "one of them served nobody")
    finally:
        stdout, stderr = ended(run, flying)
    assert flying.returncode == 130, stderr
    assert sorted(graph["/musselbed/claims"]) == ["/musselbed_1", "/musselbed_2"]
    # What is of one aPad stands below its name: calls for one fleet do not end at the other.
    for name in ("retire", "beliefs", "apad"):
        assert f"/musselbed/{name}" not in graph
    assert graph["/musselbed/apad2/retire"] == graph["/musselbed/apad2/beliefs"] == ["/musselbed_2"]
    assert graph["/clock"] == ["/musselbed_clock"]

    summary = json.loads(stdout)
    # What people were told while it flew: nothing, unless the machine was too busy to keep up.
    assert isinstance(summary.pop("events"), list)
    assert summary == {**json.loads((run / "summary.json").read_text()), "run": str(run)}
    for apad, own in zip(APADS, ({1, 3, 5}, {2, 4, 6}), strict=True):
        lines = lines_in(run / apad / "journal.jsonl")
        assert {line["id"] for line in lines if line["kind"] == "truth"} == own
        assert {line["agent"] for line in lines if line["kind"] == "dock"} <= own
        served = [line["agent"] for line in lines if line["kind"] == "released" and line["full"]]
        assert served and set(served) <= own
        assert summary["apads"][apad]["services"] == len(served)
        assert misrouted(summary["apads"][apad]) == []
        assert summary["apads"][apad]["ended_by"] == "the operator"
    assert summary["services"] == sum(summary["apads"][apad]["services"] for apad in APADS)
    assert [line.split(",")[0] for line in (run / "ends.csv").read_text().splitlines()[1:]] == list("123456")
    assert not [entry for entry in Path("/proc").iterdir() if _names(entry, str(run))]


def test_both_end_with_their_missions(scenario: Path, tmp_path: Path) -> None:
    last(scenario, 20)
    run = tmp_path / "run"
    command = [*MUSSELBED, "run", str(scenario), "--speed", str(SPEED), "--out", str(run), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=2 * PATIENCE_S, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert [summary["apads"][apad]["ended_by"] for apad in APADS] == ["mission time"] * 2
    assert summary["counted_s"] == pytest.approx(6 * 20, abs=6)
    assert not [entry for entry in Path("/proc").iterdir() if _names(entry, str(run))]


def test_an_aPads_node_that_stands_still_for_seconds_costs_no_patience(
    scenario: Path, tmp_path: Path
) -> None:
    """Three seconds are a minute of mission time here. A vehicle's answers are awaited for seconds of it."""
    last(scenario, LONG_S)
    run = tmp_path / "run"
    command = [*MUSSELBED, "run", str(scenario), "--speed", str(SPEED), "--out", str(run), "--json"]
    flying = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        wait_for_plan(run / "apad2" / "journal.jsonl", flying)
        (node,) = (
            int(entry.name)
            for entry in Path("/proc").iterdir()
            if _names(entry, f"{run}/apad2") and _names(entry, "apad_node")
        )
        os.kill(node, signal.SIGSTOP)
        threading.Event().wait(3.0)  # the fault itself takes this time
        os.kill(node, signal.SIGCONT)
        wait_until(lambda: all(has_served(run, apad) for apad in APADS), flying, "one of them served nobody")
    finally:
        stdout, stderr = ended(run, flying)
    assert flying.returncode == 130, stderr
    summary = json.loads(stdout)
    assert summary["causes"] == {} and summary["amussels_lost"] == 0
    assert not [why for why in summary["dropped"] if "silent" in why]
    for apad in APADS:
        kinds = [line["kind"] for line in lines_of(run, apad)]
        assert "vehicle_silent" not in kinds
    assert "fell silent" not in stderr + (run / "apad2" / "journal.jsonl").read_text()


@pytest.mark.parametrize(
    ("victim", "why"),
    [
        ("apad_node", "the simulated aPad's node ended with status -9"),
        ("supervisor_process", "its supervisor died (SIGKILL)"),
    ],
)
def test_one_that_is_killed_leaves_its_aMussels_to_the_other(
    scenario: Path, tmp_path: Path, victim: str, why: str
) -> None:
    run = tmp_path / "run"
    near = yaml.safe_load(scenario.read_text())
    near.update(duration_s=LONG_S, theta=60)
    # So far off that it is killed long before it has come to any.
    near["apads"][0]["start_m"] = [2, 190]
    near["area"]["polygon_m"] = [[0, 0], [4, 0], [4, 200], [0, 200]]
    # Those of apad1 need nothing.
    starts = (tmp_path / "two.csv").read_text().replace(",57,", ",14,").replace(",2,0.6", ",2,1.0")
    (tmp_path / "two.csv").write_text(starts)
    scenario.write_text(yaml.safe_dump(near))
    command = [*MUSSELBED, "run", str(scenario), "--speed", str(SPEED), "--out", str(run), "--json"]
    flying = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        wait_for_plan(run / "apad2" / "journal.jsonl", flying)
        (pid,) = (
            int(entry.name)
            for entry in Path("/proc").iterdir()
            if _names(entry, f"{run}/apad2") and _names(entry, victim)
        )
        kill_9(pid)
        wait_until(lambda: taken_over(run), flying, "nobody of apad2 came into a dock of apad1")
    finally:
        stdout, stderr = ended(run, flying)
    assert flying.returncode == 3 and f"apad2: {why}" in stderr
    summary = json.loads(stdout)
    first, second = (lines_in(run / apad / "journal.jsonl") for apad in APADS)

    # The run of apad2 goes on until it is told to end: it keeps its aMussels, and nobody else records them.
    (reason,) = (line["reason"] for line in second if line["kind"] == "stands_down")
    assert why.startswith(reason)
    assert "dock" not in [line["phase"] for line in second if line["kind"] == "mission"]
    assert [summary["apads"][apad]["ended_by"] for apad in APADS] == ["the operator"] * 2
    assert {line["id"] for line in first if line["kind"] == "truth"} == {1, 3, 5}
    assert {line["id"] for line in second if line["kind"] == "truth"} == {2, 4, 6}
    counted_s = [summary["apads"][apad]["counted_s"] for apad in APADS]
    assert summary["counted_s"] == pytest.approx(sum(counted_s)) and min(counted_s) > 0

    # First given, then taken, each once; and then served by apad1, whose docks they feel.
    assert sorted(line["id"] for line in second if line["kind"] == "handed_on") == [2, 4, 6]
    assert sorted(line["id"] for line in first if line["kind"] == "took_on") == [2, 4, 6]
    assert summary["handed_on"] == 3 and summary["amussels_lost"] == 0
    felt = {line["id"] for line in second if line["kind"] == "truth" and line["docked"]}
    # One of them has felt its dock. Another may have come into one as the runs were told to end, one after the other.
    known_ms = second[-1]["t"] - FELT_MS
    docked = {it["agent"] for it in first if it["kind"] == "dock" and it["closed"] and it["t"] <= known_ms}
    assert felt and felt <= {2, 4, 6} and docked & {2, 4, 6} <= felt
    assert [misrouted(summary["apads"][apad]) for apad in APADS] == [[], []]
    assert [line.split(",")[0] for line in (run / "ends.csv").read_text().splitlines()[1:]] == list("123456")


def test_two_share_one_sea_over_ros_and_end_in_order_without_it(tmp_path: Path) -> None:
    """Up to the first timeslots each packet has the outcomes that it has in virtual time; then the sea is killed."""
    data = yaml.safe_load(SOUND_FILE.read_text())
    data.update(name="two-in-water", duration_s=LONG_S, apads=[{"name": "apad2", "start_m": [14, 15]}])
    data["fleet"]["start"] = str(SOUND_FILE.with_name("pool.csv"))
    path, run = tmp_path / "two.yaml", tmp_path / "run"
    path.write_text(yaml.safe_dump(data))
    scenario = load(path)
    beside = open_lockstep(members(scenario, starts_of(scenario)), scenario.sharing)
    beside.runner.run(until_ms=140_000)
    expected = {
        name: outcomes_of({"kind": kind, **fields} for _, kind, fields in facts_of(recorder))
        for name, recorder in beside.recorders.items()
    }
    assert all(any(len(heard) == 2 for heard in it.values()) for it in expected.values()), "one hears alone"

    def heard_by(name: str) -> bool:
        return expected[name].keys() <= outcomes_of(lines_of(run, name)).keys()

    command = [*MUSSELBED, "run", str(path), "--speed", str(SPEED), "--out", str(run), "--json"]
    flying = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    try:
        wait_until(lambda: all(map(heard_by, APADS)), flying, "the aMussels did not speak")
        processes = (it for it in Path("/proc").iterdir() if _names(it, str(run)))
        (sea,) = (int(it.name) for it in processes if _names(it, "sea_process"))
        kill_9(sea)
        _, stderr = flying.communicate(timeout=2 * PATIENCE_S)
    finally:
        if flying.poll() is None:
            ended(run, flying)
    for name in APADS:
        found = outcomes_of(lines_of(run, name))
        (end,) = (it for it in lines_of(run, name) if it["kind"] == "end")
        assert {it: found.get(it) for it in expected[name]} == expected[name]
        assert end["end_reason"] == "loss of the sea"
    assert flying.returncode == 3 and "loss of the sea" in stderr
    assert not [entry for entry in Path("/proc").iterdir() if _names(entry, str(run))]


def outcomes_of(lines: Iterable[Mapping[str, Any]]) -> dict[tuple[int, int], dict[int, str]]:
    """The outcome at each listener of each packet, by its sender and its begin."""
    return {
        (line["from"], line["began_ms"]): {heard[0]: heard[1] for heard in line["heard"]}
        for line in lines
        if line["kind"] == "packet"
    }


def _names(entry: Path, words: str) -> bool:
    """True if a process's command line names the run."""
    if not re.fullmatch(r"\d+", entry.name):
        return False
    try:
        return words in (entry / "cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return False
