"""The asker's side of a person's orders, beside a supervisor that is slow, still, or another program."""

import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from apad_bridge.commands import main
from apad_bridge.events.person_orders import Act
from apad_bridge.mission.call_queue import ANSWER_S
from apad_bridge.supervisor import control_protocol
from apad_bridge.supervisor.control_protocol import (
    PATIENCE_S,
    SOCKET_NAME,
    Answer,
    Request,
    answer_of,
    ask,
)
from apad_bridge.supervisor.control_server import REPORTED_S
from apad_bridge.supervisor.line_server import CLIENT_S
from apad_bridge.vehicle.link_errors import PeerFailed


@pytest.fixture
def still(tmp_path: Path) -> Iterator[socket.socket]:
    """The socket of a supervisor that was stopped: the kernel takes connections for it, and nobody answers."""
    (tmp_path / "scenario.yaml").touch()
    with socket.socket(socket.AF_UNIX) as supervisor:
        supervisor.bind(str(tmp_path / SOCKET_NAME))
        supervisor.listen(8)
        yield supervisor


def test_a_client_waits_longer_than_a_supervisor_takes() -> None:
    assert PATIENCE_S >= ANSWER_S + REPORTED_S + CLIENT_S


def test_a_person_hears_soon_that_a_still_supervisor_does_not_answer(
    still: socket.socket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(control_protocol, "LATE_S", 0.05)
    monkeypatch.setattr(control_protocol, "PATIENCE_S", 0.2)
    assert main.main(["stop", str(tmp_path), "--json"]) == 3
    told = capsys.readouterr()
    asked, late = told.err.splitlines()
    assert asked == f"asking the supervisor of {tmp_path}"
    assert "no answer from the supervisor" in late and "use the vehicle's own switch" in late
    assert told.out.startswith("{") and "does not answer" in told.out


def test_an_answer_in_time_is_not_told_as_late(
    still: socket.socket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control_protocol, "LATE_S", 30.0)
    with answering(still, b'{"accepted": true, "message": "", "after_s": {"taken": 0.5}}\n'):
        answer = ask(tmp_path, Request(Act.STOP, "Anna"), lambda: pytest.fail("it is not late"))
    assert answer == Answer(True, "", after_s={"taken": 0.5})


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (b"", "it closed the connection"),
        (b"HTTP/1.1 400 Bad Request\n", "does not answer"),
        (b'{"accepted": "no", "message": ""}\n', "neither yes nor no"),
        (b'{"accepted": true, "message": "", "colour": 1}\n', "does not answer"),
        (b"[]\n", "does not answer"),
    ],
)
def test_another_programs_answer_is_no_answer(
    still: socket.socket, tmp_path: Path, line: bytes, why: str
) -> None:
    with answering(still, line), pytest.raises(PeerFailed, match=why):
        ask(tmp_path, Request(Act.STOP, "Anna"))


@pytest.mark.parametrize(
    ("request_", "mistake"),
    [
        (Request(Act.REMARK, "Anna", "x" * 2001), "a remark has at most 2000 characters"),
        (Request(Act.STOP, ""), "a name has 1 to 100 characters"),
        (Request(Act.BACK_IN, "Anna", lookout="x" * 101), "a name has 1 to 100 characters"),
        (Request(Act.GO_TO, "Anna", goal_m=(float("nan"), 0.0)), "finite"),
        (Request(Act.GO_TO, "Anna", goal_m=(1.0, 0.0), speed_m_s=float("inf")), "finite"),
        (Request(Act.GO_TO, "x" * 100, "x" * 2000, goal_m=(1.0, 0.0), speed_m_s=0.4), ""),
    ],
)
def test_a_request_names_its_own_mistake(request_: Request, mistake: str) -> None:
    assert mistake in request_.mistake and bool(mistake) == bool(request_.mistake)


def test_without_a_supervisor_the_answer_is_a_refusal(tmp_path: Path) -> None:
    assert "no supervisor takes orders" in answer_of(tmp_path, Request(Act.STOP, "Anna")).message


def test_a_supervisor_whose_queue_is_full_still_listens(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as supervisor:
        descriptor = os.open(tmp_path, os.O_DIRECTORY)
        supervisor.bind(f"/proc/self/fd/{descriptor}/{SOCKET_NAME}")
        os.close(descriptor)
        supervisor.listen(0)
        with control_protocol._connected(tmp_path, 1.0):  # the one that waits in its queue
            assert control_protocol.listens(tmp_path)
    (tmp_path / SOCKET_NAME).unlink()
    assert not control_protocol.listens(tmp_path)


class answering:
    """Answers one client of the socket with a line, from a thread, while it is entered."""

    def __init__(self, supervisor: socket.socket, line: bytes) -> None:
        self._supervisor, self._line = supervisor, line
        self._thread = threading.Thread(target=self._answer)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._thread.join(30)

    def _answer(self) -> None:
        self._supervisor.settimeout(30)
        client, _ = self._supervisor.accept()
        with client, client.makefile("rb") as lines:
            lines.readline()
            client.sendall(self._line)
