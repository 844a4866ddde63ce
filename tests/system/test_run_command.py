"""`musselbed run` and `resume` as a person uses them: real processes, a real master, signals, and what is left behind."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from journals import lines_in
from killing import kill_9, kill_supervisor, pid_of_supervisor, standing_still
from patient import PATIENCE_S, PATIENT_MUSSELBED
from rosbags.rosbag1 import Reader
from scenario_files import POOL_FILE
from stalled import stalled_s

from apad_bridge.records.journal import read_journal
from apad_bridge.ros.system.master import loopback_environment
from apad_bridge.scenario.run_options import APadKind, RunOptions, TimeSource
from apad_bridge.supervisor.control_client import listens

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[2]
MUSSELBED = [sys.executable, "-m", "apad_bridge.commands.main"]
REAL_APAD = "launch_scripts/scenarios/real-apad.yaml"
LONG_S = 36_000
"""Mission seconds that no test waits for: it ends the flight when it has seen what it waited for."""


def wait_for(what: Callable[[], Any], why: str, patience_s: float = PATIENCE_S) -> Any:
    """Polls the file system, which announces nothing, until `what` gives something."""
    until_s = time.monotonic() + patience_s
    poller = threading.Event()
    while not (found := what()):
        assert time.monotonic() < until_s, why
        poller.wait(0.02)
    return found


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """Six aMussels close together at theta = 600: a round of four takes about a minute of mission time."""
    data = yaml.safe_load(POOL_FILE.read_text())
    data.update(name="short", duration_s=150, theta=600)
    data["fleet"].update(count=6, start={"charge": [0.5, 0.75]})
    data["area"]["polygon_m"] = [[0, 0], [6, 0], [6, 4], [0, 4]]
    data["apad"]["start_m"] = [3, 2]
    data["mission"]["docking"].update(dock_s=3, undock_s=1)
    data["board"]["float_timeout_s"] = 432000
    path = tmp_path / "short.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def last(scenario: Path, duration_s: int) -> None:
    scenario.write_text(yaml.safe_dump(yaml.safe_load(scenario.read_text()) | {"duration_s": duration_s}))


def musselbed(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*MUSSELBED, *map(str, arguments)], capture_output=True, text=True, timeout=PATIENCE_S, cwd=ROOT
    )


@pytest.fixture
def fly(scenario: Path, tmp_path: Path) -> Iterator[Callable[..., tuple[subprocess.Popen[str], Path]]]:
    """Starts a flight over ROS; whatever still runs of it is ended by its pid afterwards."""
    started: list[subprocess.Popen[str]] = []

    def start(
        speed: float, *more: str, command: Sequence[str] = MUSSELBED
    ) -> tuple[subprocess.Popen[str], Path]:
        out = tmp_path / f"run-{len(started)}"
        process = subprocess.Popen(
            [*command, "run", str(scenario), "--speed", str(speed), "--out", str(out), "--json", *more],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        started.append(process)
        return process, out

    yield start
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)


def docked(run: Path) -> list[int]:
    """Agents that the journal says are docked now, in docking order."""
    held: list[int] = []
    for line in lines_in(run / "journal.jsonl") if (run / "journal.jsonl").exists() else []:
        if line["kind"] == "dock":
            held = [*held, line["agent"]] if line["closed"] else [a for a in held if a != line["agent"]]
    return held


def left_full(run: Path) -> list[int]:
    """The aMussels that left a dock full, in order."""
    lines = lines_in(run / "journal.jsonl")
    return [line["agent"] for line in lines if line["kind"] == "released" and line["full"]]


def charging(run: Path) -> list[int]:
    """Agents that the journal says are charging now, in the order in which they began."""
    began: dict[int, int] = {}
    for line in lines_in(run / "journal.jsonl") if (run / "journal.jsonl").exists() else []:
        if line["kind"] == "truth":
            if line["state"] != "CHARGING":
                began.pop(line["id"], None)
            else:
                began.setdefault(line["id"], line["agent_ms"])
    return sorted(began, key=lambda agent_id: began[agent_id])


def children_of(run: Path) -> list[str]:
    """Command lines of living processes that belong to the run: they name its directory, or are its agents."""
    return list(processes_of(run).values())


def processes_of(run: Path) -> dict[int, str]:
    """The same, by pid."""
    found = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            except OSError:
                continue
            if str(run) in line:
                found[int(entry.name)] = line
    return found


def decisions(run: Path) -> list[tuple[str, list[int]]]:
    lines = lines_in(run / "journal.jsonl")
    return [(line["what"], [s["agent"] for s in line["steps"]]) for line in lines if line["kind"] == "plan"]


@pytest.mark.parametrize(
    ("word", "begun"),
    [
        (signal.SIGINT, "fleet"),
        (signal.SIGINT, "supervisor.log"),
        (signal.SIGTERM, "fleet"),
        (signal.SIGHUP, "supervisor.log"),
    ],
)
def test_a_run_that_is_told_to_end_while_it_starts_leaves_nothing(
    fly: Callable[..., tuple[subprocess.Popen[str], Path]], scenario: Path, word: signal.Signals, begun: str
) -> None:
    last(scenario, LONG_S)
    process, run = fly(5, command=PATIENT_MUSSELBED)
    wait_for((run / begun).exists, f"there is no {begun}")
    process.send_signal(word)
    stdout, _ = process.communicate(timeout=PATIENCE_S)
    # On a machine that stands still it may have begun to fly by then, and ends in order.
    assert process.returncode == 130 or json.loads(stdout)["ended_by"] == "the operator"
    wait_for(lambda: children_of(run) == [], f"still there: {children_of(run)}")


def test_over_ros_and_in_virtual_time_it_decides_alike(fly: Any, scenario: Path, tmp_path: Path) -> None:
    process, run = fly(50)
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, stderr
    over_ros = json.loads(stdout)

    virtual = tmp_path / "virtual"
    asap = musselbed("run", scenario, "--time", "asap", "--out", virtual, "--json")
    assert asap.returncode == 0, asap.stderr
    in_virtual_time = json.loads(asap.stdout)

    assert decisions(run) == decisions(virtual)
    assert (
        over_ros["services"] == in_virtual_time["services"] == len(left_full(run)) == len(left_full(virtual))
    )
    # ROS keeps no order between topics: a word may be heard one tick (1 s of 150) later. A tick is 0.7 points of uptime for
    # one aMussel, and 0.5 m of way.
    for key in ("mean", "max", "min"):
        assert over_ros["uptime_paper"][key] == pytest.approx(in_virtual_time["uptime_paper"][key], abs=1.5)
    assert over_ros["cost_m"] == pytest.approx(in_virtual_time["cost_m"], abs=2.0)
    assert children_of(run) == []
    with Reader(run / "run.bag") as bag:
        assert {"/musselbed/truth", "/musselbed/beliefs", "/musselbed/apad", "/musselbed/mission"} <= set(
            bag.topics
        )


def test_changes_of_the_speed_steps_and_standing_still_change_nothing_of_a_flight(fly: Any) -> None:
    """Twelve changes, three of which let mission time stand still, and four steps. Slow ones, so that the flight lasts."""
    process, straight = fly(50)
    assert process.wait(PATIENCE_S) == 0
    process, changed = fly(2)
    wait_for((changed / "control.sock").is_socket, "no supervisor takes orders")
    told = ["3", "2", "0", "step", "step", "4", "2", "0", "step", "5", "3", "0", "step", "2", "6", "300"]
    for times in told:
        done = musselbed("speed", changed, times, "--by", "Anna")
        assert done.returncode == 0, f"{times}: {done.stdout}{done.stderr}"
    assert process.wait(PATIENCE_S) == 0
    journaled = [it["times"] for it in lines_in(changed / "journal.jsonl") if it["kind"] == "speed"]
    assert journaled == [0.0 if it == "step" else float(it) for it in told]
    summaries = [json.loads((it / "summary.json").read_text()) for it in (straight, changed)]
    assert summaries[0]["digest"] == summaries[1]["digest"]


@pytest.mark.parametrize("key", ["time_stands_while_stopped: true", ""])
def test_while_a_person_stops_mission_time_stands_if_the_scenario_says_so(
    fly: Any, scenario: Path, key: str
) -> None:
    """Two flights are stopped in the same second, for 1 s and for 10 s of wall time; half a second is a tick."""
    scenario.write_text(scenario.read_text() + key + "\n")
    ends = []
    for waits_s in (1, 10) if key else (4,):
        process, run = fly(0.2)
        wait_for((run / "control.sock").is_socket, "no supervisor takes orders")

        def newest_s(run: Path = run) -> int:
            return int(read_journal(run / "journal.jsonl").last_ms // 1000)

        def stop_lines(run: Path = run) -> dict[str, int]:
            return {it["state"]: it["t"] for it in lines_in(run / "journal.jsonl") if it["kind"] == "stop"}

        assert musselbed("speed", run, "0").returncode == 0
        while newest_s() < 8:
            before_s = newest_s()
            assert musselbed("speed", run, "step").returncode == 0
            wait_for(lambda before_s=before_s: newest_s() > before_s, "no step came")
        assert musselbed("stop", run).returncode == 3  # it goes out with the next second
        assert musselbed("speed", run, "2").returncode == 0
        wait_for(lambda: "at rest" in stop_lines(), "the hull did not come to rest")
        at_rest_s = newest_s()
        until_s = time.monotonic() + waits_s
        wait_for(lambda until_s=until_s: time.monotonic() > until_s, "")
        assert (newest_s() == at_rest_s) is bool(key)
        # An order takes a second, and the stop stays.
        assert musselbed("remark", run, "gulls").returncode == 0
        for order in (("continue",), ("speed", "300")):
            assert musselbed(order[0], run, *order[1:]).returncode == 0
        assert process.wait(PATIENCE_S) == 0
        ends.append((at_rest_s, json.loads((run / "summary.json").read_text())["digest"]))
    assert len(set(ends)) == 1


def test_ctrl_c_ends_everything_in_order_within_5_s_with_a_valid_bag(fly: Any, scenario: Path) -> None:
    last(scenario, LONG_S)
    process, run = fly(20, command=PATIENT_MUSSELBED)
    wait_for(lambda: docked(run), "nothing was docked")
    asked_s, others_s = time.monotonic(), stalled_s()
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=2 * PATIENCE_S)
    # What others took of the machine is not ours: without them it would have been as much sooner.
    assert time.monotonic() - asked_s - (stalled_s() - others_s) < 5.0
    assert process.returncode == 130, stderr
    assert json.loads(stdout)["ended_by"] == "the operator"
    assert json.loads((run / "summary.json").read_text())["ended_by"] == "the operator"
    last_s = read_journal(run / "journal.jsonl").last_ms // 1000
    with Reader(run / "run.bag") as bag:
        truths_s = [at_ns // 10**9 for it, at_ns, _ in bag.messages() if it.topic == "/musselbed/truth"]
    assert truths_s == list(range(last_s + 1))
    assert children_of(run) == []


def test_a_person_stops_a_run_continues_and_aborts_it_by_commands(fly: Any, scenario: Path) -> None:
    last(scenario, LONG_S)
    process, run = fly(2)
    wait_for(lambda: docked(run), "nothing was docked")
    steers = "nobody steers: continue returns the aPad to the mission"
    stopped = (
        f"done: the aPad has taken the stop and slows; {steers}; to move it again: musselbed continue {run}"
    )
    for order, printed in (("stop", stopped), ("stop", stopped), ("continue", "done; the mission steers")):
        answered = musselbed(order, run, "--by", "Anna")
        assert (answered.returncode, answered.stdout.splitlines()[-1]) == (0, printed), answered.stderr
    assert musselbed("remark", run, "gulls [red]").returncode == 0
    assert json.loads(musselbed("abort", run, "--by", "Anna", "--json").stdout)[run.name]["accepted"]
    stdout, stderr = process.communicate(timeout=2 * PATIENCE_S)
    assert process.returncode == 0, stderr
    assert json.loads(stdout)["ended_by"] == "a call: abort by Anna"
    lines = lines_in(run / "journal.jsonl")
    assert [line["order"] for line in lines if line["kind"] == "operator"] == [
        "stop",
        "stop",
        "continue",
        "abort",
    ]
    stopped_ms, continued_ms = (line["t"] for line in lines if line["kind"] == "override")
    between = [line for line in lines if stopped_ms < line["t"] < continued_ms]
    assert not [line for line in between if line["kind"] == "plan" or line.get("name") == "go to point"]
    assert [line["text"] for line in lines if line["kind"] == "remark"] == ["gulls [red]"]
    assert not (run / "control.sock").exists() and children_of(run) == []


def test_kill_9_of_the_supervisor_and_resume_goes_on_with_the_docks_as_they_were(
    fly: Any, tmp_path: Path
) -> None:
    strategy = tmp_path / "mine.py"
    strategy.write_text("from apad_bridge.planning.paper_strategies import Cautious as Mine\n")
    # In a namespace that the shell of `resume` is told nothing of.
    process, run = fly(20, "__ns:=basin", "--strategy", f"{strategy}:Mine")
    wait_for(lambda: len(docked(run)) >= 2, "no two were docked")
    kill_supervisor(run)
    strategy.unlink()  # the run has a copy
    before = docked(run)
    port = json.loads((run / "run.json").read_text())["xmlrpc_port"]

    resumed = musselbed("resume", run, "--json")
    assert resumed.returncode == 0, resumed.stderr
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, stderr
    assert json.loads((run / "run.json").read_text())["xmlrpc_port"] == port > 0
    summary = json.loads(resumed.stdout)
    assert json.loads(stdout)["services"] == summary["services"] == len(left_full(run))
    assert set(before) <= set(left_full(run))
    assert summary["amussels_lost"] == 0

    lines = lines_in(run / "journal.jsonl")
    at = next(n for n, line in enumerate(lines) if line["kind"] == "resumed")
    told = next(line for line in lines if line["kind"] == "restored")["told"]
    assert told and [it for it in summary["events"] if it in told] == told, (
        "a program is told what people are"
    )
    after = [line for line in lines[at:] if line["kind"] == "dock"]
    # Who was docked is not docked again before it has been let go: the first dock event of each is its release.
    for agent_id in before:
        assert next(line for line in after if line["agent"] == agent_id)["closed"] is False
    assert [it["strategy"] for it in lines if it["kind"] == "plan" and it["what"] == "collect"][
        -1
    ] == "mine.py:Mine"
    assert children_of(run) == []


def test_ctrl_c_in_the_first_terminal_ends_a_resumed_run_in_order(fly: Any, scenario: Path) -> None:
    last(scenario, LONG_S)
    process, run = fly(5)
    wait_for(lambda: docked(run), "nothing was docked")
    kill_supervisor(run)
    command = [*MUSSELBED, "resume", str(run), "--json"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    ) as resumed:
        wait_for(lambda: listens(run), "nobody resumed it")
        process.send_signal(signal.SIGINT)
        outputs = [it.communicate(timeout=PATIENCE_S) for it in (process, resumed)]
    assert [process.returncode, resumed.returncode] == [130, 130], outputs
    summaries = [json.loads(stdout) for stdout, _ in outputs]
    assert [it["ended_by"] for it in summaries] == ["the operator"] * 2
    assert not any("nobody" in text or "killed" in text for _, text in outputs), outputs
    assert "Traceback" not in (run / "supervisor.log").read_text()
    assert lines_in(run / "journal.jsonl")[-1]["kind"] == "end"
    assert children_of(run) == []


def test_a_run_resumes_after_a_restart_of_the_machine_with_a_master_an_apad_and_a_fleet_of_its_own(
    fly: Any,
) -> None:
    process, run = fly(20)
    wait_for(lambda: docked(run), "nothing was docked")
    for pid in [process.pid, *processes_of(run)]:
        kill_9(pid)
    process.communicate(timeout=PATIENCE_S)
    wait_for(lambda: not children_of(run), "an agent outlived its nursery")
    before = docked(run)
    seen = [it for it in lines_in(run / "journal.jsonl") if it["kind"] == "apad"][-1]

    resumed = musselbed("resume", run, "--json")
    assert resumed.returncode == 0, resumed.stderr
    summary = json.loads(resumed.stdout)
    assert summary["end_reason"] == "mission time" and summary["amussels_lost"] == 0
    lines = lines_in(run / "journal.jsonl")
    after = lines[next(n for n, line in enumerate(lines) if line["kind"] == "resumed") :]
    first = next(it for it in after if it["kind"] == "apad")
    # It is at rest where it was: within a second of its way, and its docks hold whom they held.
    assert abs(first["north_m"] - seen["north_m"]) < 1 and abs(first["east_m"] - seen["east_m"]) < 1
    assert first["battery"] == pytest.approx(seen["battery"], abs=0.01)
    docks = [line for line in after if line["kind"] == "dock"]
    for agent_id in before:
        assert next(line for line in docks if line["agent"] == agent_id)["closed"] is False
    assert set(before) <= set(left_full(run))
    assert children_of(run) == []


@pytest.mark.parametrize("how", ["rosnode kill", "its name taken"])
def test_a_node_that_another_ends_is_an_abort_with_its_records(
    fly: Any, scenario: Path, tmp_path: Path, how: str
) -> None:
    last(scenario, LONG_S)
    process, run = fly(5)
    wait_for(lambda: docked(run), "nothing was docked")
    uri = json.loads((run / "run.json").read_text())["master_uri"]
    takes_name = "import rospy; rospy.init_node('musselbed_1', disable_signals=True)"
    command = {
        "rosnode kill": ["/usr/bin/rosnode", "kill", "/musselbed_1"],
        "its name taken": ["/usr/bin/python3", "-c", takes_name],
    }[how]
    tools = loopback_environment(tmp_path / "ros", uri)
    done = subprocess.run(command, env=tools, capture_output=True, text=True, timeout=PATIENCE_S)
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 3, (done, stderr)
    summary = json.loads(stdout)
    assert summary["end_reason"] == "loss of the node" and "shutdown request" in summary["ended_by"]
    assert summary["ended_by"] in stderr
    assert "Traceback" not in (run / "supervisor.log").read_text()
    assert lines_in(run / "journal.jsonl")[-1]["kind"] == "end"
    with Reader(run / "run.bag"):
        pass
    assert children_of(run) == []


def test_of_several_that_resume_a_run_at_once_one_flies_it_and_the_others_touch_nothing(
    fly: Any, scenario: Path
) -> None:
    last(scenario, LONG_S)
    process, run = fly(20)
    wait_for(lambda: len(docked(run)) >= 2, "no two were docked")
    kill_supervisor(run)
    command = [*MUSSELBED, "resume", str(run), "--json"]
    callers = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
        for _ in range(3)
    ]
    # Whoever comes after the run's end is told of that, so it flies until the others have come.
    wait_for(lambda: [it.poll() for it in callers].count(None) <= 1, "two fly it")
    wait_for(lambda: listens(run), "nobody flies it")
    assert musselbed("abort", run).returncode == 0
    outputs = [caller.communicate(timeout=PATIENCE_S) for caller in callers]
    process.communicate(timeout=PATIENCE_S)

    codes = [caller.returncode for caller in callers]
    assert codes.count(0) == 1 and set(codes) <= {0, 2, 3}, outputs
    for code, (_, stderr) in zip(codes, outputs, strict=True):
        assert code == 0 or ("there is nothing to resume" in stderr and "Traceback" not in stderr)
    assert json.loads((run / "run.json").read_text())["epoch"] == 2
    lines = lines_in(run / "journal.jsonl")
    assert [line["kind"] for line in lines].count("resumed") == 1
    assert sorted(path.name for path in run.glob("*.bag")) == ["run-1.bag", "run.bag"]
    with Reader(run / "run-1.bag") as bag:
        truths_s = [at_ns // 10**9 for it, at_ns, _ in bag.messages() if it.topic == "/musselbed/truth"]
    resumed_s = next(line["t"] for line in lines if line["kind"] == "resumed") // 1000
    assert truths_s == list(range(resumed_s + 1, lines[-1]["t"] // 1000 + 1))
    assert children_of(run) == []


def test_kill_9_of_an_agent_while_it_charges_and_it_goes_on_charging(fly: Any) -> None:
    process, run = fly(20)
    agent_id = wait_for(lambda: kill_one_that_charges(run), "nothing charges")
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, stderr
    assert json.loads(stdout)["services"] == len(left_full(run))
    assert agent_id in left_full(run)
    lines = lines_in(run / "journal.jsonl")
    died = next(line for line in lines if line["kind"] == "died")
    assert (died["id"], died["cause"]) == (agent_id, "BROWN_OUT")
    truths = [line for line in lines if line["kind"] == "truth" and line["id"] == agent_id]
    boot = next(
        n for n, t in enumerate(truths) if t["state"] == "BOOTING" and t["agent_ms"] >= died["agent_ms"] > 0
    )
    # Its battery's anchor and its place in the dock are what they were: the charge went on under the reset.
    assert truths[boot]["primary"] == truths[boot - 1]["primary"]
    assert truths[boot]["docked"] is truths[boot - 1]["docked"] is True
    assert truths[boot + 1]["state"] == "CHARGING"


def kill_one_that_charges(run: Path) -> int | None:
    """Kills the agent that began to charge last; None while there is none."""
    if not charging(run):
        return None
    # A supervisor that goes on may release it before the kill.
    with standing_still(pid_of_supervisor(run)):
        agent_id = next(reversed(charging(run)), None)
        pid = None if agent_id is None else pid_of_agent(run, agent_id)
        if pid is not None:
            kill_9(pid)
    return None if pid is None else agent_id


def test_kill_9_of_the_nursery_and_another_goes_on_from_its_file(fly: Any) -> None:
    process, run = fly(20)
    before = wait_for(lambda: docked(run), "nothing was docked")
    kill_9(pid_of_nursery(run))
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, stderr
    assert json.loads(stdout)["services"] == len(left_full(run))
    assert set(before) <= set(left_full(run))
    lines = lines_in(run / "journal.jsonl")
    assert {line["id"] for line in lines if line["kind"] == "died"} == set(range(1, 7))
    assert children_of(run) == []


def pid_of_nursery(run: Path) -> int:
    """The one process of the run's nursery that is no agent: its name is not an aMussel's."""
    (pid,) = [
        int(entry.name)
        for entry in Path("/proc").iterdir()
        if entry.name.isdigit()
        and f"agents.nursery\0{run}" in cmdline(entry)
        and not (entry / "comm").read_text().startswith("amussel-")
    ]
    return pid


def cmdline(entry: Path) -> str:
    try:
        return (entry / "cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return ""


def pid_of_agent(run: Path, agent_id: int) -> int | None:
    """The agent's process, by its name among the children of the run's nursery."""
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            stat = (entry / "stat").read_text()
            parent = int(stat.rpartition(")")[2].split()[1])
            nursery = (Path("/proc") / str(parent) / "cmdline").read_bytes().decode(errors="replace")
        except (OSError, ValueError):
            continue
        if f"({agent_name(agent_id)})" in stat and str(run) in nursery:
            return int(entry.name)
    return None


def agent_name(agent_id: int) -> str:
    return f"amussel-{agent_id}"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--time", "asap", "--apad", "ros"), "leave out --apad ros"),
        (("--time", "ros"), "it needs --apad ros"),
        (("--speed", "0"), "--speed must be 0.01 to 10000, not 0.0"),
        (("--speed", "5", "--apad", "ros"), "a real vehicle moves in real time"),
        (("--apad", "ros"), "time_stands_while_stopped: only one simulated aPad"),
        (("--apad", "ros", "--time", "ros"), "time_stands_while_stopped: only one simulated aPad"),
        (("--strategy", "gready"), "known: "),
        (("--theta", "0"), "theta"),
    ],
)
def test_a_mistake_gets_one_line_and_exit_2_before_anything_starts(
    scenario: Path, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    out = tmp_path / "never"
    scenario.write_text(scenario.read_text() + "time_stands_while_stopped: true\n")
    result = musselbed("run", scenario, "--out", out, *arguments)
    assert result.returncode == 2
    assert said in result.stderr
    assert "Traceback" not in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not out.exists()


def test_a_run_directory_is_never_overwritten(scenario: Path, tmp_path: Path) -> None:
    out = tmp_path / "taken"
    out.mkdir()
    (out / "precious.txt").write_text("data")
    result = musselbed("run", scenario, "--time", "asap", "--out", out)
    assert result.returncode == 2
    assert "not empty" in result.stderr
    assert [path.name for path in out.iterdir()] == ["precious.txt"]


def test_without_a_master_a_run_on_somebody_s_says_so(tmp_path: Path) -> None:
    result = subprocess.run(
        [*MUSSELBED, "run", REAL_APAD, "--apad", "ros", "--out", str(tmp_path / "none")],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        cwd=ROOT,
        env={**os.environ, "ROS_MASTER_URI": "http://127.0.0.1:9"},
    )
    assert result.returncode == 3
    assert "no ROS master answers at http://127.0.0.1:9" in result.stderr


def test_a_dry_run_plans_and_commands_nothing(scenario: Path, tmp_path: Path) -> None:
    result = musselbed("run", scenario, "--dry-run", "--json", "--out", tmp_path / "dry")
    assert result.returncode == 0, result.stderr
    plan = json.loads(result.stdout)
    assert plan["what"] == "collect"
    assert len(plan["steps"]) == 4
    assert not (tmp_path / "dry").exists()


def test_resume_refuses_what_cannot_be_resumed(scenario: Path, tmp_path: Path) -> None:
    run = tmp_path / "virtual"
    assert musselbed("run", scenario, "--time", "asap", "--out", run).returncode == 0
    again = musselbed("resume", run)
    assert again.returncode == 2
    assert "--time asap" in again.stderr
    (run / "summary.json").unlink()
    foreign = replace(RunOptions.load(run), apad=APadKind.ROS, time=TimeSource.WALL)
    foreign.on_master("http://127.0.0.1:9").save(run)
    alone = musselbed("resume", run)
    assert alone.returncode == 3 and len(alone.stderr.splitlines()) == 1
    assert (
        "the ROS master at http://127.0.0.1:9 is gone" in alone.stderr and "start both again" in alone.stderr
    )
    (tmp_path / "ros").mkdir()
    (tmp_path / "ros" / "master.log").touch()
    replace(foreign, apads=("apad1", "apad2")).on_master("http://127.0.0.1:9").save(run)
    member = musselbed("resume", run)
    assert member.returncode == 3 and len(member.stderr.splitlines()) == 1
    assert "a run of several aPads ends with it" in member.stderr
    assert children_of(run) == []
    journal = run / "journal.jsonl"
    journal.write_text(journal.read_text().replace('"format":2', '"format":1', 1))
    older = musselbed("resume", run)
    assert older.returncode == 2
    assert "has format 1" in older.stderr and older.stderr.count("\n") == 1
    nothing = musselbed("resume", tmp_path)
    assert nothing.returncode == 2
    assert "no run" in nothing.stderr
