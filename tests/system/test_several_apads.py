"""Two aPads on one master, by one command: each serves its own share, and the graph says who is whose."""

import json
import os
import re
import signal
import subprocess
import time
import xmlrpc.client
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from journals import facts_of
from killing import kill_9, standing_still
from layout_topics import named_topics
from programs import MUSSELBED, begun, left_full, lines_of, processes_of, wait_until
from scenario_files import SOUND_FILE, write_scenario

from apad_bridge.assembly.division import members
from apad_bridge.runs.in_memory import open_lockstep
from apad_bridge.runs.supervisor_lock import supervisor_of
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of
from apad_bridge.viewers.layouts.kinds import KINDS
from apad_bridge.viewers.layouts.layout_content import layout_fleet

pytestmark = pytest.mark.system

SPEED = 20
LONG_S = 3600
"""Mission seconds that no test waits for: it ends the flight when it has seen what it waited for."""
APADS = ("apad1", "apad2")
FELT_MS = 20_000
"""A second of wall time: an aMussel of another flight has felt its dock by then."""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """Six aMussels in two heaps at theta = 600, an aPad beside each."""
    rows = (f"{n},{1 + n / 3:.2f},{2 if n % 2 else 57},0.6" for n in range(1, 7))
    (tmp_path / "two.csv").write_text("\n".join(["id,north,east,battery", *rows]) + "\n")
    return write_scenario(
        tmp_path / "two.yaml",
        duration_s=LONG_S,
        theta=600,
        area={"polygon_m": [[0, 0], [4, 0], [4, 60], [0, 60]]},
        fleet={"count": 6, "start": str(tmp_path / "two.csv")},
        apad={"start_m": [2, 3]},
        apads=[{"name": "apad2", "start_m": [2, 56]}],
        mission={"batch": 2, "docking": {"dock_s": 3, "undock_s": 1}},
        # A tenth of the paper's: nobody runs empty and sinks before its docking, however long a busy machine lets this fly.
        board={"float_timeout_s": 432000, "discharge_per_min": 0.0001042713},
    )


@contextmanager
def flown(scenario: Path, run: Path) -> Iterator[subprocess.Popen[str]]:
    """The flight; at last the supervisors themselves are asked to end: no parent counts the seconds that they take."""
    with begun(*MUSSELBED, "run", scenario, "--speed", SPEED, "--out", run, "--json") as flying:
        yield flying
        for pid in map(supervisor_of, (run / apad for apad in APADS)) if flying.poll() is None else ():
            os.kill(pid or flying.pid, signal.SIGINT)
        flying.wait(480)


def graph_of(run: Path, flying: "subprocess.Popen[str]", named: set[str]) -> dict[str, Any]:
    """Topics and services by name, and their nodes, once both supervisors and whatever is `named` are on the graph."""
    wait_until((run / "apad2" / "run.json").exists, flying)
    uri = wait_until(lambda: json.loads((run / "apad2" / "run.json").read_text())["master_uri"], flying)
    # A supervisor offers this once it has heard the other's claims, and then what it shows of its mission.
    wanted = named | {f"/musselbed/{apad}/retire" for apad in APADS}

    def found() -> dict[str, Any]:
        with xmlrpc.client.ServerProxy(uri) as master:
            _, _, (publishers, _, services) = master.getSystemState("/test")
        names = dict([*publishers, *services])
        return names if wanted <= names.keys() else {}

    return dict(wait_until(found, flying, why="they never came to be on one graph"))


def process_of(run: Path, words: str) -> int:
    (pid,) = processes_of(f"{run}/apad2", words)
    return pid


def misrouted(summary: dict[str, Any]) -> list[str]:
    """What was dropped of packets and contacts. Other drops are a busy machine's, as of an answer that comes too late."""
    return [why for why in summary["dropped"] if re.search("packet|felt|not of this fleet", why)]


def ids(run: Path, kind: str, **wanted: Any) -> set[int]:
    """The aMussels of the lines of this kind with these values."""
    return {it.get("id", it.get("agent")) for it in lines_of(run, kind) if wanted.items() <= it.items()}


def ends_of(run: Path) -> list[str]:
    return [line.split(",")[0] for line in (run / "ends.csv").read_text().splitlines()[1:]]


def test_each_serves_its_share_and_nobody_else_and_a_node_that_stands_still_costs_no_patience(
    scenario: Path, tmp_path: Path
) -> None:
    """Three seconds are a minute of mission time here. A vehicle's answers are awaited for seconds of it."""
    run = tmp_path / "run"
    # Layouts name what is there; of a run's bag a layout also names the aPad's state, which has one name in all bags.
    fleet = layout_fleet(load(scenario), starts_of(load(scenario)))
    by_layout = [named_topics(kind.write(fleet)) - {"/musselbed/apad"} for kind in KINDS.values()]
    assert all(any("apad2" in name for name in named) for named in by_layout)
    with flown(scenario, run) as flying:
        graph = graph_of(run, flying, {"/amussel2/charge_info"}.union(*by_layout))
        wait_until(lambda: lines_of(run / "apad2", "plan"), flying)
        with standing_still(process_of(run, "apad_node")):
            until_s = time.monotonic() + 3.0  # the fault itself takes this time
            wait_until(lambda: time.monotonic() > until_s, flying)
        wait_until(lambda: all(left_full(run / apad) for apad in APADS), flying)
    stdout, stderr = flying.communicate()
    assert flying.returncode == 130, stderr
    # What is of one aPad stands below its name: calls for one fleet do not end at the other.
    assert not graph.keys() & {f"/musselbed/{name}" for name in ("retire", "beliefs", "apad")}
    assert {name: sorted(graph[name]) for name in ("/musselbed/claims", "/clock")} == {
        "/musselbed/claims": ["/musselbed_1", "/musselbed_2"],
        "/clock": ["/musselbed_clock"],
    }
    assert graph["/musselbed/apad2/retire"] == graph["/musselbed/apad2/beliefs"] == ["/musselbed_2"]
    summary = json.loads(stdout)
    # What people were told while it flew: nothing, unless the machine was too busy to keep up.
    assert isinstance(summary.pop("events"), list)
    assert summary == {**json.loads((run / "summary.json").read_text()), "run": str(run)}
    for apad, own in zip(APADS, ({1, 3, 5}, {2, 4, 6}), strict=True):
        served, told = left_full(run / apad), summary["apads"][apad]
        assert ids(run / apad, "truth") == own and served and {*served, *ids(run / apad, "dock")} <= own
        assert (told["services"], told["ended_by"], misrouted(told)) == (len(served), "the operator", [])
        assert not lines_of(run / apad, "vehicle_silent")
    assert summary["services"] == sum(summary["apads"][apad]["services"] for apad in APADS)
    assert summary["causes"] == {} and summary["amussels_lost"] == 0
    assert not [why for why in summary["dropped"] if "silent" in why]
    assert "fell silent" not in stderr + (run / "apad2" / "journal.jsonl").read_text()
    assert ends_of(run) == list("123456") and not processes_of(run)


def test_one_whose_supervisor_is_killed_leaves_its_aMussels_to_the_other(
    scenario: Path, tmp_path: Path
) -> None:
    """So does one whose simulated aPad dies: `tests/apad_bridge/runs/test_supervisor_watch.py`."""
    run, why = tmp_path / "run", "its supervisor died (SIGKILL)"
    first, second = (run / apad for apad in APADS)
    # So far off that it is killed long before it has come to any.
    far = [{"name": "apad2", "start_m": [2, 190]}]
    write_scenario(
        scenario, scenario, theta=60, apads=far, area={"polygon_m": [[0, 0], [4, 0], [4, 200], [0, 200]]}
    )
    # Those of apad1 need nothing.
    starts = (tmp_path / "two.csv").read_text().replace(",57,", ",14,").replace(",2,0.6", ",2,1.0")
    (tmp_path / "two.csv").write_text(starts)

    def taken_over() -> bool:
        """apad1 took all of apad2 on, and one of them has felt its dock."""
        took, docked = ids(first, "took_on"), ids(first, "dock", closed=True)
        return (
            took == {2, 4, 6} and bool(docked & took) and docked & took <= ids(second, "truth", docked=True)
        )

    with flown(scenario, run) as flying:
        wait_until(lambda: lines_of(second, "plan"), flying)
        kill_9(process_of(run, "supervisor_process"))
        wait_until(taken_over, flying, why="nobody of apad2 came into a dock of apad1")
    stdout, stderr = flying.communicate()
    assert flying.returncode == 3 and f"apad2: {why}" in stderr
    summary = json.loads(stdout)
    # The run of apad2 goes on until it is told to end: it keeps its aMussels, and nobody else records them.
    (stands_down,) = lines_of(second, "stands_down")
    assert why.startswith(stands_down["reason"])
    assert "dock" not in [line["phase"] for line in lines_of(second, "mission")]
    assert [summary["apads"][apad]["ended_by"] for apad in APADS] == ["the operator"] * 2
    assert (ids(first, "truth"), ids(second, "truth")) == ({1, 3, 5}, {2, 4, 6})
    counted_s = [summary["apads"][apad]["counted_s"] for apad in APADS]
    assert summary["counted_s"] == pytest.approx(sum(counted_s)) and min(counted_s) > 0
    # First given, then taken, each once; and then served by apad1, whose docks they feel.
    for journal, kind in ((second, "handed_on"), (first, "took_on")):
        assert sorted(line["id"] for line in lines_of(journal, kind)) == [2, 4, 6]
    assert summary["handed_on"] == 3 and summary["amussels_lost"] == 0
    felt = ids(second, "truth", docked=True)
    # One of them has felt its dock. Another may have come into one as the runs were told to end, one after the other.
    known_ms = lines_of(second)[-1]["t"] - FELT_MS
    docked = {it["agent"] for it in lines_of(first, "dock") if it["closed"] and it["t"] <= known_ms}
    assert felt and felt <= {2, 4, 6} and docked & {2, 4, 6} <= felt
    assert [misrouted(summary["apads"][apad]) for apad in APADS] == [[], []]
    assert ends_of(run) == list("123456")


def test_two_share_one_sea_over_ros_and_end_in_order_without_it(tmp_path: Path) -> None:
    """Up to the first timeslots each packet has the outcomes that it has in virtual time; then the sea is killed."""
    second = [{"name": "apad2", "start_m": [14, 15]}]
    path = write_scenario(tmp_path / "two.yaml", SOUND_FILE, duration_s=LONG_S, apads=second)
    run, scenario = tmp_path / "run", load(path)
    beside = open_lockstep(members(scenario, starts_of(scenario)), scenario.sharing)
    beside.runner.run(until_ms=140_000)
    expected = {
        name: outcomes_of({"kind": kind, **fields} for _, kind, fields in facts_of(recorder))
        for name, recorder in beside.recorders.items()
    }
    assert all(any(len(heard) == 2 for heard in it.values()) for it in expected.values()), "one hears alone"

    def heard_by(name: str) -> bool:
        return expected[name].keys() <= outcomes_of(lines_of(run / name)).keys()

    with flown(path, run) as flying:
        wait_until(lambda: all(map(heard_by, APADS)), flying, why="the aMussels did not speak")
        kill_9(*processes_of(run, "sea_process"))
        _, stderr = flying.communicate(timeout=480)
    for name in APADS:
        found = outcomes_of(lines_of(run / name))
        (end,) = lines_of(run / name, "end")
        assert {it: found.get(it) for it in expected[name]} == expected[name]
        assert end["end_reason"] == "loss of the sea"
    assert flying.returncode == 3 and "loss of the sea" in stderr
    assert not processes_of(run)


def outcomes_of(lines: Iterable[Mapping[str, Any]]) -> dict[tuple[int, int], dict[int, str]]:
    """The outcome at each listener of each packet, by its sender and its begin."""
    return {
        (line["from"], line["began_ms"]): {heard[0]: heard[1] for heard in line["heard"]}
        for line in lines
        if line["kind"] == "packet"
    }
