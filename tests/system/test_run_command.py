"""`musselbed run` and `resume` as a person uses them: real processes, a real master, signals, and what is left behind."""

import json
import re
import shutil
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


def newest_ms(run: Path) -> int:
    return int(read_journal(run / "journal.jsonl").last_ms)


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
        assert code_here("speed", changed, times, "--by", "Anna") == 0
    ended_well(process)
    assert [it["times"] for it in lines_of(changed, "speed")] == [
        0.0 if it == "step" else float(it) for it in told
    ]
    digests = {json.loads((it / "summary.json").read_text())["digest"] for it in (straight, changed)}
    assert len(digests) == 1


def test_while_a_person_stops_mission_time_stands_if_the_scenario_says_so(fly: Fly, scenario: Path) -> None:
    """For two seconds of wall time; half a second is a tick. Of a scenario that does not say so, see the next test."""
    write_scenario(scenario, scenario, time_stands_while_stopped=True)
    process, run = fly(2, lasts_s=LONG_S)
    wait_until(lambda: lines_of(run, "apad"), process)
    assert code_here("stop", run) == 0
    wait_until(lambda: "at rest" in [it["state"] for it in lines_of(run, "stop")], process)
    at_rest_ms, until_s = newest_ms(run), time.monotonic() + 2
    wait_until(lambda: time.monotonic() > until_s, process)
    assert newest_ms(run) == at_rest_ms
    # An order takes a second, whose last lines follow its answer, and the stop stays.
    assert code_here("remark", run, "gulls") == 0
    wait_until(lambda: newest_ms(run) > at_rest_ms, process)
    assert newest_ms(run) == at_rest_ms + 1000
    assert code_here("continue", run) == 0
    wait_until(lambda: newest_ms(run) > at_rest_ms + 5000, process)


def test_a_person_stops_a_run_continues_and_ends_everything_in_order_within_5_s_with_a_valid_bag(
    fly: Fly, capsys: pytest.CaptureFixture[str]
) -> None:
    process, run = fly(5, lasts_s=LONG_S, command=PATIENT_MUSSELBED)
    wait_until(lambda: docked(run), process)
    stopped = (
        "done: the aPad has taken the stop and slows; nobody steers: continue returns the aPad to the mission; "
        f"to move it again: musselbed continue {run}"
    )
    for order, printed in (("stop", stopped), ("stop", stopped), ("continue", "done; the mission steers")):
        assert code_here(order, run, "--by", "Anna") == 0
        assert capsys.readouterr().out.splitlines()[-1] == printed
    assert code_here("remark", run, "gulls [red]") == 0
    asked_s, others_s = time.monotonic(), stalled_s()
    process.send_signal(signal.SIGINT)
    stdout, _ = ended_well(process, 130)
    # What others took of the machine is not ours: without them it would have been as much sooner.
    assert time.monotonic() - asked_s - (stalled_s() - others_s) < 5.0
    for summary in (stdout, (run / "summary.json").read_text()):
        assert json.loads(summary)["ended_by"] == "the operator"
    assert [line["order"] for line in lines_of(run, "operator")] == ["stop", "stop", "continue"]
    assert [line["text"] for line in lines_of(run, "remark")] == ["gulls [red]"]
    stopped_ms, continued_ms = (line["t"] for line in lines_of(run, "override"))
    between = [line for line in lines_of(run) if stopped_ms < line["t"] < continued_ms]
    assert between and not [
        line for line in between if line["kind"] == "plan" or line.get("name") == "go to point"
    ]
    assert truths_s(run / "run.bag") == list(range(newest_ms(run) // 1000 + 1))
    assert not (run / "control.sock").exists() and not processes_of(run)


def test_of_several_that_resume_a_killed_run_one_flies_it_with_its_docks_and_ctrl_c_in_the_first_terminal_ends_it(
    fly: Fly, begin: Begin, tmp_path: Path
) -> None:
    """The others touch nothing."""
    strategy = tmp_path / "mine.py"
    strategy.write_text("from apad_bridge.planning.strategies.paper_strategies import Cautious as Mine\n")
    # In a namespace that the shell of `resume` is told nothing of.
    process, run = fly(20, "__ns:=basin", "--strategy", f"{strategy}:Mine", lasts_s=LONG_S)
    wait_until(lambda: len(docked(run)) >= 2, process)
    kill_supervisor(run)
    strategy.unlink()  # the run has a copy
    before, port = docked(run), json.loads((run / "run.json").read_text())["xmlrpc_port"]
    callers = [begin(*MUSSELBED, "resume", run, "--json") for _ in range(3)]
    # Whoever comes after the run's end is told of that, so it flies until the others have come.
    wait_until(lambda: [it.poll() for it in callers].count(None) <= 1, process)
    wait_until(lambda: listens(run) and set(before) <= set(left_full(run)), process)
    process.send_signal(signal.SIGINT)
    outputs = [it.communicate(timeout=PATIENCE_S) for it in (process, *callers)]

    codes = [it.returncode for it in (process, *callers)]
    assert codes.count(130) == 2 and codes[0] == 130 and set(codes) <= {130, 2, 3}, outputs
    (restored,), (resumed,) = lines_of(run, "restored"), lines_of(run, "resumed")
    for code, (stdout, stderr) in zip(codes, outputs, strict=True):
        if code != 130:
            assert "there is nothing to resume" in stderr and "Traceback" not in stderr
            continue
        summary = json.loads(stdout)
        assert summary["ended_by"] == "the operator" and summary["amussels_lost"] == 0
        assert summary["services"] == len(left_full(run))
        # A program is told what people are.
        assert restored["told"] and [it for it in summary["events"] if it in restored["told"]] in (
            [],
            restored["told"],
        )
        assert "nobody" not in stderr and "killed" not in stderr
    assert "Traceback" not in (run / "supervisor.log").read_text()
    options = json.loads((run / "run.json").read_text())
    assert (options["epoch"], options["xmlrpc_port"]) == (2, port) and port > 0
    assert released_first(run, before)
    assert [it["strategy"] for it in lines_of(run, "plan") if it["what"] == "collect"][-1] == "mine.py:Mine"
    last = lines_of(run)[-1]
    assert last["kind"] == "end"
    assert sorted(path.name for path in run.glob("*.bag")) == ["run-1.bag", "run.bag"]
    assert truths_s(run / "run-1.bag") == list(range(resumed["t"] // 1000 + 1, last["t"] // 1000 + 1))
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
    assert released_first(run, before) and not processes_of(run)


def test_a_node_that_another_ends_is_an_abort_with_its_records(fly: Fly, tmp_path: Path) -> None:
    """Its name is taken: the master then asks the former node to end, as `rosnode kill` does."""
    process, run = fly(5, lasts_s=LONG_S)
    wait_until(lambda: lines_of(run, "apad"), process)
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


@pytest.mark.parametrize(
    ("shipped", "arguments", "code", "said"),
    [
        ("", ("--time", "asap", "--apad", "ros"), 2, "leave out --apad ros"),
        ("", ("--time", "ros"), 2, "it needs --apad ros"),
        ("", ("--speed", "0"), 2, "--speed must be 0.01 to 10000, not 0.0"),
        ("", ("--speed", "5", "--apad", "ros"), 2, "a real vehicle moves in real time"),
        ("", ("--apad", "ros"), 2, "time_stands_while_stopped: only one simulated aPad"),
        ("", ("--apad", "ros", "--time", "ros"), 2, "time_stands_while_stopped: only one simulated aPad"),
        ("", ("--strategy", "gready"), 2, "known: "),
        ("", ("--theta", "0"), 2, "theta"),
        (REAL_APAD, ("--apad", "ros"), 3, "no ROS master answers at http://127.0.0.1:9"),
    ],
)
def test_a_mistake_gets_one_line_before_anything_starts(
    scenario: Path,
    tmp_path: Path,
    shipped: str,
    arguments: tuple[str, ...],
    code: int,
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    out = tmp_path / "never"
    write_scenario(scenario, scenario, time_stands_while_stopped=True)
    assert code_here("run", shipped or scenario, "--out", out, *arguments) == code
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert said in line and not (out / "journal.jsonl").exists()


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


def test_resume_refuses_what_cannot_be_resumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "virtual"
    short = write_scenario(tmp_path / "short.yaml", duration_s=20, fleet={"hosting": "one_process"})
    assert code_here("run", short, "--time", "asap", "--out", run) == 0
    foreign = replace(RunOptions.load(run), apad=APadKind.ROS, time=TimeSource.WALL)
    journal = (run / "journal.jsonl").read_text()
    (tmp_path / "ros").mkdir()
    damages: list[tuple[Callable[[], object], int, str]] = [
        (lambda: None, 2, "--time asap"),
        (
            lambda: foreign.on_master("http://127.0.0.1:9").save(run),
            3,
            "the ROS master at http://127.0.0.1:9 is gone.*start both again",
        ),
        (
            lambda: replace(foreign, apads=("apad1", "apad2")).on_master("http://127.0.0.1:9").save(run),
            3,
            "a run of several aPads ends with it",
        ),
        (
            lambda: (run / "journal.jsonl").write_text(journal.replace('"format":2', '"format":1', 1)),
            2,
            "has format 1",
        ),
        (lambda: (shutil.rmtree(run), run.mkdir()), 2, "no run"),
    ]
    for damage, code, words in damages:
        damage()
        capsys.readouterr()
        assert code_here("resume", run) == code
        (line,) = capsys.readouterr().err.splitlines()
        assert re.search(words, line), line
        (run / "summary.json").unlink(missing_ok=True)
        (tmp_path / "ros" / "master.log").touch()
