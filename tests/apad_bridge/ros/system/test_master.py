"""The embedded master: its own process, session, port and files; it joins no other master, and ends by itself."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socketserver
import subprocess
import sys
import threading
import xmlrpc.client
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from patient import PATIENCE_S

from apad_bridge.ros.system.master import (
    Master,
    MasterFailed,
    loopback_environment,
    start_master,
    why_gone_of,
)

pytestmark = pytest.mark.system
ROOT = Path(__file__).parents[4]


@pytest.fixture
def master(tmp_path: Path) -> Iterator[Master]:
    running = start_master(tmp_path / "ros", timeout_s=PATIENCE_S, orphan_s=0)
    yield running
    running.stop()


@contextlib.contextmanager
def pidfd_of(pid: int) -> Iterator[int]:
    pidfd = os.pidfd_open(pid)
    try:
        yield pidfd
    finally:
        os.close(pidfd)


def signalled(pid: int, number: signal.Signals, waits_for: int) -> None:
    """The signal has come to the process, which is a child of ours."""
    os.kill(pid, number)
    os.waitid(os.P_PID, pid, waits_for)


def pid_that_answers(uri: str) -> int:
    with xmlrpc.client.ServerProxy(uri) as proxy:
        code, _, pid = proxy.getPid("/test")  # type: ignore[misc]
    assert code == 1
    return int(pid)


def wait_until_gone(pidfd: int, timeout_s: float = PATIENCE_S) -> bool:
    """A pidfd becomes readable when its process ends."""
    readable, _, _ = select.select([pidfd], [], [], timeout_s)
    return bool(readable)


def listening_addresses(port: int) -> set[str]:
    """The local addresses that listen on `port`, in the kernel's hexadecimal."""
    tables = (Path("/proc/net") / it for it in ("tcp", "tcp6"))
    rows = [line.split() for table in tables for line in table.read_text().splitlines()[1:]]
    listening = [local.split(":") for _, local, _, state, *_ in rows if state == "0A"]
    return {address for address, local_port in listening if int(local_port, 16) == port}


def test_it_answers_from_a_session_of_its_own_on_loopback_only(master: Master) -> None:
    assert pid_that_answers(master.uri) == master.pid != os.getpid()
    assert os.getsid(master.pid) == master.pid
    port = urlsplit(master.uri).port
    assert port is not None and listening_addresses(port) == {"0100007F"}


def test_a_master_that_was_stopped_and_continued_goes_on(master: Master, tmp_path: Path) -> None:
    """It is not gone meanwhile: nobody asks for another one."""
    with pidfd_of(master.pid) as ended:
        signalled(master.pid, signal.SIGSTOP, os.WSTOPPED)
        assert not wait_until_gone(ended, 1.5), "longer than any wait of the master's own"
        assert why_gone_of(tmp_path / "ros", master.uri) is None
        signalled(master.pid, signal.SIGCONT, os.WCONTINUED)
        assert not wait_until_gone(ended, 2.0)
        assert pid_that_answers(master.uri) == master.pid


def test_a_run_knows_its_own_master_from_another_one_at_its_port(master: Master, tmp_path: Path) -> None:
    assert why_gone_of(tmp_path / "ros", master.uri) is None
    assert why_gone_of(tmp_path / "another run" / "ros", master.uri) == (
        f"the run's own ROS master at {master.uri} is gone (another program answers there)"
    )


@pytest.mark.parametrize(
    "answer", [b"HTTP/1.0 200 OK\r\nContent-Type: text/xml\r\n\r\n<html", b"SSH-2.0-OpenSSH_9.2\r\n", b""]
)
def test_a_program_that_is_no_master_has_the_port_of_one_that_is_gone(tmp_path: Path, answer: bytes) -> None:
    class OtherProgram(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            while not self.rfile.readline().endswith(b"</methodCall>\n"):
                pass
            self.wfile.write(answer)

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), OtherProgram) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,)).start()
        uri = f"http://127.0.0.1:{server.server_address[1]}/"
        why = why_gone_of(tmp_path / "ros", uri)
        server.shutdown()
    assert why.startswith(f"the run's own ROS master at {uri} is gone (")


def test_two_masters_are_two_although_the_shell_names_the_first(
    master: Master, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", master.uri)
    monkeypatch.setenv("ROS_HOSTNAME", "no.such.host.invalid")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "nowhere"))
    second = start_master(tmp_path / "second", timeout_s=PATIENCE_S, orphan_s=0)
    with contextlib.ExitStack() as stack:
        stack.callback(second.stop)
        assert second.uri != master.uri
        assert pid_that_answers(second.uri) == second.pid != pid_that_answers(master.uri)
    assert pid_that_answers(master.uri) == master.pid


def test_stop_frees_the_port_and_may_be_said_twice(master: Master) -> None:
    assert master.alive
    master.stop()
    assert not master.alive
    with pytest.raises(ConnectionRefusedError):
        pid_that_answers(master.uri)
    master.stop()


def test_a_stopped_process_is_ended_by_force(master: Master) -> None:
    os.kill(master.pid, signal.SIGSTOP)
    master.stop(timeout_s=0.2)
    assert master.process.returncode == -signal.SIGKILL


@pytest.mark.parametrize("orphan_s", [0, 300], ids=["ends with it", "outlives it for that time"])
def test_a_master_whose_starter_was_killed(tmp_path: Path, orphan_s: int) -> None:
    code = (
        "import sys; from pathlib import Path; from apad_bridge.ros.system.master import start_master\n"
        f"master = start_master(Path({str(tmp_path)!r}), timeout_s={PATIENCE_S}, orphan_s={orphan_s})\n"
        "print(master.pid, master.uri, flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code]
    starter = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    pid, uri = starter.stdout.readline().split()
    with pidfd_of(int(pid)) as pidfd:
        starter.kill()
        starter.communicate(timeout=PATIENCE_S)
        if orphan_s:
            assert pid_that_answers(uri) == int(pid)
            signal.pidfd_send_signal(pidfd, signal.SIGTERM)
        assert wait_until_gone(pidfd)


def test_too_late_is_an_error_that_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A real master may bind its port before this process has the processor again, and is then in time."""
    home, silent = tmp_path / "late", tmp_path / "silent.py"
    silent.write_text("import sys\nsys.stdin.read()\n")
    monkeypatch.setattr("apad_bridge.ros.system.master._PROGRAM", silent)
    with pytest.raises(MasterFailed, match=r"did not bind a port in time: no node was started"):
        start_master(home, timeout_s=0.0)
    assert not any(str(home).encode() in command for command in commands_of_all_processes())


def commands_of_all_processes() -> Iterator[bytes]:
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):  # it ended while we looked
            yield path.read_bytes()


def test_a_program_that_fails_is_reported(tmp_path: Path) -> None:
    (tmp_path / "master.log").mkdir()
    with pytest.raises(MasterFailed, match=r"ended with exit code 1: no node was started; see .*master\.err"):
        start_master(tmp_path, timeout_s=PATIENCE_S)
    assert "IsADirectoryError" in (tmp_path / "master.err").read_text()


def test_nothing_of_the_callers_ros_reaches_a_node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("ROS_MASTER_URI", "ROS_NAMESPACE", "ROS_IPV6", "ROS_PACKAGE_PATH", "PYTHONPATH"):
        monkeypatch.setenv(name, "of the caller")
    environment = loopback_environment(tmp_path, "http://127.0.0.1:1/")
    ours = {name: value for name, value in environment.items() if name.startswith(("ROS_", "PYTHON"))}
    assert ours == {"ROS_IP": "127.0.0.1", "ROS_HOME": str(tmp_path), "ROS_MASTER_URI": "http://127.0.0.1:1/"}
