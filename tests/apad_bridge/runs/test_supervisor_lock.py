import os
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from scenario_files import POOL_FILE

from apad_bridge.assembly.division import Member
from apad_bridge.commands.main import main
from apad_bridge.records.run_directory import RunDirectory
from apad_bridge.runs.display import MakeStatus
from apad_bridge.runs.several.lockstep import fly_in_step
from apad_bridge.runs.supervisor_lock import supervising, supervisor_of
from apad_bridge.scenario.choices import Hosting
from apad_bridge.scenario.loader import load
from apad_bridge.scenario.starts import starts_of
from apad_bridge.vehicle.link_errors import PeerFailed

REAL_APAD = str(Path(__file__).parents[3] / "launch_scripts" / "scenarios" / "real-apad.yaml")
LISTING = Path(__file__).parents[3] / "launch_scripts" / "examples" / "listing_1.py"


def test_a_living_supervisor_is_found_by_pid_and_start_time(tmp_path: Path) -> None:
    assert supervisor_of(tmp_path) is None
    with supervising(tmp_path):
        assert supervisor_of(tmp_path) == os.getpid()
    assert supervisor_of(tmp_path) is None


def test_a_pid_that_names_another_process_now_names_nobody(tmp_path: Path) -> None:
    (tmp_path / "supervisor.pid").write_text(f"{os.getpid()} 1\n")
    assert supervisor_of(tmp_path) is None


def test_one_that_died_and_was_not_reaped_is_no_supervisor(tmp_path: Path) -> None:
    code = (
        "import sys, os; from pathlib import Path; from apad_bridge.runs.supervisor_lock import supervising\n"
        "with supervising(Path(sys.argv[1])):\n    print('in', flush=True); os.read(0, 1); os._exit(9)"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert child.stdout.readline() == b"in\n"
    assert supervisor_of(tmp_path) == child.pid
    child.stdin.write(b"x")
    child.stdin.flush()
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)  # dead, and still a zombie
    assert supervisor_of(tmp_path) is None
    child.stdin.close()
    child.stdout.close()
    child.wait(60)


def test_a_run_has_one_supervisor_and_the_second_leaves_the_first_one_s_name(tmp_path: Path) -> None:
    with supervising(tmp_path):
        named = (tmp_path / "supervisor.pid").read_text()
        code = (
            "import sys; from pathlib import Path; from apad_bridge.runs.supervisor_lock import supervising\n"
            "with supervising(Path(sys.argv[1])):\n    print('in')"
        )
        second = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True)
        assert second.stdout == "" and f"has a living supervisor (pid {os.getpid()})" in second.stderr
        with pytest.raises(PeerFailed), supervising(tmp_path):
            pass
        assert (tmp_path / "supervisor.pid").read_text() == named
    with supervising(tmp_path):
        assert supervisor_of(tmp_path) == os.getpid()


def test_a_supervisor_s_child_does_not_keep_the_run_locked(tmp_path: Path) -> None:
    with supervising(tmp_path):
        child = subprocess.Popen(["sleep", "60"], close_fds=False)
    with supervising(tmp_path):
        pass
    child.kill()
    child.wait()


class Watching:
    """A ProgressDisplay that looks who supervises the run."""

    def __init__(self, run_dir: Path) -> None:
        self._run_dir = run_dir
        self.supervisors: set[int | None] = set()

    def print_message(self, text: str) -> None:
        pass

    def show_status(self, now_ms: int, status: MakeStatus) -> None:
        self.supervisors.add(supervisor_of(self._run_dir))
        with pytest.raises(PeerFailed), supervising(self._run_dir):
            pass


def test_a_flight_in_virtual_time_is_its_run_s_one_supervisor(tmp_path: Path) -> None:
    scenario = replace(load(POOL_FILE), duration_s=5.0)
    scenario = replace(scenario, fleet=replace(scenario.fleet, hosting=Hosting.ONE_PROCESS))
    member = Member(scenario.apad.name, scenario, starts_of(scenario))
    progress = Watching(tmp_path)
    fly_in_step([member], scenario.sharing, RunDirectory(tmp_path), progress)
    assert progress.supervisors == {os.getpid()}
    assert supervisor_of(tmp_path) is None


def test_ctrl_z_suspends_no_parent() -> None:
    code = (
        "import signal; from apad_bridge.runs.children import not_suspended\n"
        "with not_suspended():\n    signal.raise_signal(signal.SIGTSTP)\n    print('goes on')\n"
        "assert signal.getsignal(signal.SIGTSTP) is signal.SIG_DFL"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and done.stdout == "goes on\n"
    assert (
        done.stderr.strip() == "Ctrl-Z does not suspend a mission: it continues, and Ctrl-C ends it in order"
    )


def test_a_run_that_is_refused_leaves_no_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    several = tmp_path / "several.yaml"
    several.write_text(POOL_FILE.read_text() + "apads: [{name: apad2, start_m: [20, 20]}]\n")
    (tmp_path / "pool.csv").write_text(POOL_FILE.with_name("pool.csv").read_text())
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{unused.getsockname()[1]}")
        for command in (
            ["run", REAL_APAD, "--apad", "ros"],
            ["run", str(POOL_FILE), "--apad", "ros", "--time", "ros"],
            ["run", str(several), "--apad", "ros", "--time", "ros"],
            ["mission", REAL_APAD],
            ["fleet", str(POOL_FILE)],
            ["script", str(LISTING), "--scenario", REAL_APAD, "--apad", "ros"],
        ):
            with pytest.raises(SystemExit) as ended:
                main([*command, "--out", str(tmp_path / "run")])
            assert ended.value.code == 3
            assert capsys.readouterr().err.startswith("musselbed: no ROS master answers")
    assert not (tmp_path / "run").exists()
