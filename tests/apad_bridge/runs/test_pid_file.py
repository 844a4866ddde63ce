import os
import subprocess
import sys
from pathlib import Path

import pytest

from apad_bridge.runs.children import supervising, supervisor_of
from apad_bridge.vehicle.errors import PeerFailed


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
        "import sys, os; from pathlib import Path; from apad_bridge.runs.children import supervising\n"
        "with supervising(Path(sys.argv[1])):\n    print('in', flush=True); os.read(0, 1); os._exit(9)"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert child.stdout is not None
    assert child.stdin is not None
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
            "import sys; from pathlib import Path; from apad_bridge.runs.children import supervising\n"
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
