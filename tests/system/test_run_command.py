"""`musselbed run` and `resume` as a person uses them: real processes, a real master, signals, and what is left behind."""

import json
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from killing import kill_9, kill_supervisor
from patient import PATIENCE_S, PATIENT_MUSSELBED
from programs import (
    MUSSELBED,
    Begin,
    code_here,
    docked,
    done,
    ended_well,
    left_full,
    lines_of,
    musselbed,
    processes_of,
    wait_until,
)
from rosbags.rosbag1 import Reader
from scenario_files import write_scenario
from stalled import stalled_s

from apad_bridge.records.journal import read_journal
from apad_bridge.ros.system.master import loopback_environment
from apad_bridge.scenario.run_options import APadKind, RunOptions, TimeSource
from apad_bridge.supervisor.control_protocol import listens

pytestmark = pytest.mark.system

REAL_APAD = "launch_scripts/scenarios/real-apad.yaml"
LONG_S = 36_000
"""Mission seconds that no test waits for: it ends the flight when it has seen what it waited for."""
Fly = Callable[..., tuple[subprocess.Popen[str], Path]]


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """Six aMussels close together at theta = 600: a round of four takes about a minute of mission time."""
    return write_scenario(
        tmp_path / "short.yaml",
        duration_s=150,
        theta=600,
        fleet={"count": 6, "start": {"charge": [0.5, 0.75]}},
        area={"polygon_m": [[0, 0], [6, 0], [6, 4], [0, 4]]},
        apad={"start_m": [3, 2]},
        mission={"docking": {"dock_s": 3, "undock_s": 1}},
        board={"float_timeout_s": 432000},
    )


@pytest.fixture
def fly(scenario: Path, tmp_path: Path, begin: Begin) -> Fly:
    """Starts a flight over ROS, and gives its directory."""

    def start(
        speed: float, *more: str, lasts_s: int = 150, command: Sequence[str] = MUSSELBED
    ) -> tuple[subprocess.Popen[str], Path]:
        out = tmp_path / f"run-{len(list(tmp_path.glob('run-*')))}"
        write_scenario(scenario, scenario, duration_s=lasts_s)
        return begin(*command, "run", scenario, "--speed", speed, "--out", out, "--json", *more), out

    return start


def truths_s(bag: Path) -> list[int]:
    """The seconds of the truths in a bag, which can be read to its end."""
    with Reader(bag) as reader:
        return [at_ns // 10**9 for it, at_ns, _ in reader.messages() if it.topic == "/musselbed/truth"]


def released_first(run: Path, held: list[int]) -> bool:
    """Who was docked before the resumption is not docked again before it was let go, and left full."""
    lines = lines_of(run, "resumed", "dock")
    after = lines[[it["kind"] for it in lines].index("resumed") + 1 :]
    firsts = [next(it for it in after if it["agent"] == agent_id) for agent_id in held]
    return not any(it["closed"] for it in firsts) and set(held) <= set(left_full(run))


@pytest.mark.parametrize(("word", "begun"), [(signal.SIGINT, "fleet"), (signal.SIGHUP, "supervisor.log")])
def test_a_run_that_is_told_to_end_while_it_starts_leaves_nothing(
    fly: Fly, word: signal.Signals, begun: str
) -> None:
    process, run = fly(5, lasts_s=LONG_S, command=PATIENT_MUSSELBED)
    wait_until((run / begun).exists, process)
    process.send_signal(word)
    stdout, _ = process.communicate(timeout=PATIENCE_S)
    # On a machine that stands still it may have begun to fly by then, and ends in order.
    assert process.returncode == 130 or json.loads(stdout)["ended_by"] == "the operator"
    wait_until(lambda: not processes_of(run))


def test_changes_of_the_speed_steps_and_standing_still_change_nothing_of_a_flight(fly: Fly) -> None:
    """Twelve changes, three of which let mission time stand still, and four steps. Slow ones, so that the flight lasts."""
    process, straight = fly(100)
    ended_well(process)
    process, changed = fly(2)
    wait_until((changed / "control.sock").is_socket, process)
    told = ["3", "2", "0", "step", "step", "4", "2", "0", "step", "5", "3", "0", "step", "2", "6", "300"]
    for times in told:
        musselbed("speed", changed, times, "--by", "Anna")
    ended_well(process)
    journaled = [it["times"] for it in lines_of(changed, "speed")]
    assert journaled == [0.0 if it == "step" else float(it) for it in told]
    summaries = [json.loads((it / "summary.json").read_text()) for it in (straight, changed)]
    assert summaries[0]["digest"] == summaries[1]["digest"]


def test_while_a_person_stops_mission_time_stands_if_the_scenario_says_so(fly: Fly, scenario: Path) -> None:
    """Two flights are stopped in the same second, for 1 s and for 3 s of wall time; half a second is a tick.

    Of a scenario that does not say so, time goes on: `test_a_person_stops_a_run_continues_and_aborts_it_by_commands`.
    """
    write_scenario(scenario, scenario, time_stands_while_stopped=True)
    ends = []
    for waits_s in (1, 3):
        process, run = fly(0.2)
        wait_until((run / "control.sock").is_socket, process)

        def newest_s(run: Path = run) -> int:
            return int(read_journal(run / "journal.jsonl").last_ms // 1000)

        musselbed("speed", run, "0")
        while (before_s := newest_s()) < 5:
            musselbed("speed", run, "step")
            wait_until(lambda before_s=before_s: newest_s() > before_s, process)
        musselbed("stop", run, code=3)  # it goes out with the next second
        musselbed("speed", run, "2")
        wait_until(lambda run=run: "at rest" in [it["state"] for it in lines_of(run, "stop")], process)
        at_rest_s, until_s = newest_s(), time.monotonic() + waits_s
        wait_until(lambda until_s=until_s: time.monotonic() > until_s, process)
        assert newest_s() == at_rest_s
        # An order takes a second, and the stop stays.
        for order in (("remark", run, "gulls"), ("continue", run), ("speed", run, "300")):
            musselbed(*order)
        ended_well(process)
        ends.append((at_rest_s, json.loads((run / "summary.json").read_text())["digest"]))
    assert len(set(ends)) == 1


def test_ctrl_c_ends_everything_in_order_within_5_s_with_a_valid_bag(fly: Fly) -> None:
    process, run = fly(20, lasts_s=LONG_S, command=PATIENT_MUSSELBED)
    wait_until(lambda: docked(run), process)
    asked_s, others_s = time.monotonic(), stalled_s()
    process.send_signal(signal.SIGINT)
    stdout, _ = ended_well(process, 130)
    # What others took of the machine is not ours: without them it would have been as much sooner.
    assert time.monotonic() - asked_s - (stalled_s() - others_s) < 5.0
    assert json.loads(stdout)["ended_by"] == "the operator"
    assert json.loads((run / "summary.json").read_text())["ended_by"] == "the operator"
    assert truths_s(run / "run.bag") == list(range(read_journal(run / "journal.jsonl").last_ms // 1000 + 1))
    assert not processes_of(run)


def test_a_person_stops_a_run_continues_and_aborts_it_by_commands(fly: Fly) -> None:
    process, run = fly(2, lasts_s=LONG_S)
    wait_until(lambda: docked(run), process)
    steers = "nobody steers: continue returns the aPad to the mission"
    stopped = (
        f"done: the aPad has taken the stop and slows; {steers}; to move it again: musselbed continue {run}"
    )
    for order, printed in (("stop", stopped), ("stop", stopped), ("continue", "done; the mission steers")):
        assert musselbed(order, run, "--by", "Anna").stdout.splitlines()[-1] == printed
    musselbed("remark", run, "gulls [red]")
    assert json.loads(musselbed("abort", run, "--by", "Anna", "--json").stdout)[run.name]["accepted"]
    stdout, _ = ended_well(process)
    assert json.loads(stdout)["ended_by"] == "a call: abort by Anna"
    orders = [line["order"] for line in lines_of(run, "operator")]
    assert orders == ["stop", "stop", "continue", "abort"]
    stopped_ms, continued_ms = (line["t"] for line in lines_of(run, "override"))
    assert continued_ms > stopped_ms
    between = [line for line in lines_of(run) if stopped_ms < line["t"] < continued_ms]
    assert not [line for line in between if line["kind"] == "plan" or line.get("name") == "go to point"]
    assert [line["text"] for line in lines_of(run, "remark")] == ["gulls [red]"]
    assert not (run / "control.sock").exists() and not processes_of(run)


def test_kill_9_of_the_supervisor_and_resume_goes_on_with_the_docks_as_they_were(
    fly: Fly, tmp_path: Path
) -> None:
    strategy = tmp_path / "mine.py"
    strategy.write_text("from apad_bridge.planning.strategies.paper_strategies import Cautious as Mine\n")
    # In a namespace that the shell of `resume` is told nothing of.
    process, run = fly(20, "__ns:=basin", "--strategy", f"{strategy}:Mine")
    wait_until(lambda: len(docked(run)) >= 2, process)
    kill_supervisor(run)
    strategy.unlink()  # the run has a copy
    before = docked(run)
    port = json.loads((run / "run.json").read_text())["xmlrpc_port"]

    summary = json.loads(musselbed("resume", run, "--json").stdout)
    stdout, _ = ended_well(process)
    assert json.loads((run / "run.json").read_text())["xmlrpc_port"] == port > 0
    assert json.loads(stdout)["services"] == summary["services"] == len(left_full(run))
    assert summary["amussels_lost"] == 0
    (restored,) = lines_of(run, "restored")
    told = restored["told"]
    assert told and [it for it in summary["events"] if it in told] == told, (
        "a program is told what people are"
    )
    assert released_first(run, before)
    collected = [it["strategy"] for it in lines_of(run, "plan") if it["what"] == "collect"]
    assert collected[-1] == "mine.py:Mine"
    assert not processes_of(run)


def test_a_run_resumes_after_a_restart_of_the_machine_with_a_master_an_apad_and_a_fleet_of_its_own(
    fly: Fly,
) -> None:
    process, run = fly(20)
    wait_until(lambda: docked(run), process)
    for pid in [process.pid, *processes_of(run)]:
        kill_9(pid)
    process.communicate(timeout=PATIENCE_S)
    wait_until(lambda: not processes_of(run), why="an agent outlived its nursery")
    before, seen = docked(run), lines_of(run, "apad")[-1]

    summary = json.loads(musselbed("resume", run, "--json").stdout)
    assert summary["end_reason"] == "mission time" and summary["amussels_lost"] == 0
    lines = lines_of(run, "resumed", "apad")
    first = lines[[it["kind"] for it in lines].index("resumed") + 1]
    # It is at rest where it was: within a second of its way, and its docks hold whom they held.
    assert abs(first["north_m"] - seen["north_m"]) < 1 and abs(first["east_m"] - seen["east_m"]) < 1
    assert first["battery"] == pytest.approx(seen["battery"], abs=0.01)
    assert released_first(run, before)
    assert not processes_of(run)


def test_a_node_that_another_ends_is_an_abort_with_its_records(fly: Fly, tmp_path: Path) -> None:
    """Its name is taken: the master then asks the former node to end, as `rosnode kill` does."""
    process, run = fly(5, lasts_s=LONG_S)
    wait_until(lambda: docked(run), process)
    tools = loopback_environment(tmp_path / "ros", json.loads((run / "run.json").read_text())["master_uri"])
    takes_name = "import rospy; rospy.init_node('musselbed_1', disable_signals=True)"
    done("/usr/bin/python3", "-c", takes_name, env=tools, code=None)
    stdout, stderr = ended_well(process, 3)
    summary = json.loads(stdout)
    assert summary["end_reason"] == "loss of the node" and "shutdown request" in summary["ended_by"]
    assert summary["ended_by"] in stderr
    assert "Traceback" not in (run / "supervisor.log").read_text()
    assert lines_of(run)[-1]["kind"] == "end" and truths_s(run / "run.bag")
    assert not processes_of(run)


def test_of_several_that_resume_a_run_at_once_one_flies_it_and_ctrl_c_in_the_first_terminal_ends_it_in_order(
    fly: Fly, begin: Begin
) -> None:
    """The others touch nothing."""
    process, run = fly(20, lasts_s=LONG_S)
    wait_until(lambda: len(docked(run)) >= 2, process)
    kill_supervisor(run)
    callers = [begin(*MUSSELBED, "resume", run, "--json") for _ in range(3)]
    # Whoever comes after the run's end is told of that, so it flies until the others have come.
    wait_until(lambda: [it.poll() for it in callers].count(None) <= 1, process)
    wait_until(lambda: listens(run), process)
    process.send_signal(signal.SIGINT)
    outputs = [it.communicate(timeout=PATIENCE_S) for it in (process, *callers)]

    codes = [it.returncode for it in (process, *callers)]
    assert codes.count(130) == 2 and codes[0] == 130 and set(codes) <= {130, 2, 3}, outputs
    for code, (stdout, stderr) in zip(codes, outputs, strict=True):
        if code == 130:
            assert json.loads(stdout)["ended_by"] == "the operator"
            assert "nobody" not in stderr and "killed" not in stderr
        else:
            assert "there is nothing to resume" in stderr and "Traceback" not in stderr
    assert "Traceback" not in (run / "supervisor.log").read_text()
    assert json.loads((run / "run.json").read_text())["epoch"] == 2
    assert lines_of(run)[-1]["kind"] == "end"
    (resumed,) = lines_of(run, "resumed")
    assert sorted(path.name for path in run.glob("*.bag")) == ["run-1.bag", "run.bag"]
    last_s = lines_of(run)[-1]["t"] // 1000
    assert truths_s(run / "run-1.bag") == list(range(resumed["t"] // 1000 + 1, last_s + 1))
    assert not processes_of(run)


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
    scenario: Path, tmp_path: Path, arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "never"
    write_scenario(scenario, scenario, time_stands_while_stopped=True)
    assert code_here("run", scenario, "--out", out, *arguments) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert said in line and not out.exists()


def test_a_run_directory_is_never_overwritten_and_a_dry_run_makes_none(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "taken"
    out.mkdir()
    (out / "precious.txt").write_text("data")
    assert code_here("run", scenario, "--time", "asap", "--out", out) == 2
    assert "not empty" in capsys.readouterr().err
    assert [path.name for path in out.iterdir()] == ["precious.txt"]
    assert code_here("run", scenario, "--dry-run", "--json", "--out", tmp_path / "dry") == 0
    plan = json.loads(capsys.readouterr().out)
    assert (plan["what"], len(plan["steps"])) == ("collect", 4)
    assert not (tmp_path / "dry").exists()


def test_without_a_master_a_run_on_somebody_s_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    assert code_here("run", REAL_APAD, "--apad", "ros", "--out", tmp_path / "none") == 3
    assert "no ROS master answers at http://127.0.0.1:9" in capsys.readouterr().err


def test_resume_refuses_what_cannot_be_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "virtual"
    short = write_scenario(tmp_path / "short.yaml", duration_s=20, fleet={"hosting": "one_process"})
    assert code_here("run", short, "--time", "asap", "--out", run) == 0

    def refused(code: int, directory: Path = run) -> str:
        capsys.readouterr()
        assert code_here("resume", directory) == code
        (line,) = capsys.readouterr().err.splitlines()
        return line

    assert "--time asap" in refused(2)
    (run / "summary.json").unlink()
    foreign = replace(RunOptions.load(run), apad=APadKind.ROS, time=TimeSource.WALL)
    foreign.on_master("http://127.0.0.1:9").save(run)
    line = refused(3)
    assert "the ROS master at http://127.0.0.1:9 is gone" in line and "start both again" in line
    (tmp_path / "ros").mkdir()
    (tmp_path / "ros" / "master.log").touch()
    replace(foreign, apads=("apad1", "apad2")).on_master("http://127.0.0.1:9").save(run)
    assert "a run of several aPads ends with it" in refused(3)
    journal = run / "journal.jsonl"
    journal.write_text(journal.read_text().replace('"format":2', '"format":1', 1))
    assert "has format 1" in refused(2)
    assert "no run" in refused(2, tmp_path)
