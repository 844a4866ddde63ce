"""SIGINT, SIGTERM and SIGHUP: held back, let in, taken as a request to stop; and each torn in no other place."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from agents.hosting import started
from agents.hosting.interrupts import ENDING, INTERRUPTED, held_back, interruptible, let_in, received_by


def handlers() -> list[object]:
    return [signal.getsignal(number) for number in ENDING]


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_waits_until_it_is_let_in(number: int) -> None:
    reached, before = [], handlers()
    with pytest.raises(KeyboardInterrupt), interruptible(), held_back():
        signal.raise_signal(number)
        reached.append("begun")
        with let_in():
            reached.append("never")
    assert reached == ["begun"] and handlers() == before


@pytest.fixture
def handled() -> Iterator[Callable[[int, Any], None]]:
    """Sets handlers of signals, which are as they were after the test."""
    before = {number: signal.getsignal(number) for number in ENDING}
    yield signal.signal
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_acts_at_the_end_as_it_did_before(number: int, handled: Callable[[int, Any], None]) -> None:
    acted: list[int] = []
    handled(number, lambda it, _: acted.append(it))
    with held_back():
        with held_back():
            signal.raise_signal(number)
        assert acted == []
    assert acted == [number]
    signal.raise_signal(number)
    assert acted == [number, number]


def test_a_second_ctrl_c_does_not_tear_what_the_first_one_ends() -> None:
    ended = []
    with pytest.raises(KeyboardInterrupt), interruptible():
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGINT)
            ended.append("in order")
    assert ended == ["in order"]


def test_a_flight_takes_a_signal_that_came_while_it_started_and_lets_none_out() -> None:
    asked = []
    with interruptible(), held_back():
        signal.raise_signal(signal.SIGTERM)
        with received_by(lambda: asked.append("stop")):
            assert asked == ["stop"]
            signal.raise_signal(signal.SIGHUP)
            with held_back(), let_in():  # a wait in a flight is not torn: the flight is asked to stop
                signal.raise_signal(signal.SIGINT)
    assert asked == ["stop"] * 3


def test_an_error_of_ours_is_not_hidden_by_a_signal_that_was_held_back() -> None:
    with pytest.raises(ValueError, match="ours"), held_back():
        signal.raise_signal(signal.SIGINT)
        raise ValueError("ours")
    with held_back(), let_in():
        pass  # nothing is left of it


def test_nohup_stays_asked_for(handled: Callable[[int, Any], None]) -> None:
    handled(signal.SIGHUP, signal.SIG_IGN)
    with interruptible():
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def test_in_another_thread_nothing_is_held() -> None:
    before, seen = handlers(), []

    def run() -> None:
        with held_back(), let_in():
            seen.append(handlers())

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(20)
    assert seen == [before]


STARTER = """
import os, subprocess, sys
from agents.hosting import started
child = subprocess.Popen(
    [sys.executable, "-m", "agents.hosting.started", "{module}"], env={{**os.environ, **started.environment()}}
)
print(child.pid, flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("outlives", [False, True])
def test_a_child_that_is_not_ready_ends_with_its_starter(outlives: bool, tmp_path: Path) -> None:
    lines = ["import sys", "from agents.hosting.started import outlive_starter"]
    lines += ["outlive_starter()"] if outlives else []
    lines += ["open('begun', 'w').close()", "import select", "select.select([], [], [], 60)"]
    (tmp_path / "some_child.py").write_text("\n".join(lines))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.getcwd()])}
    starter = subprocess.Popen(
        [sys.executable, "-c", STARTER.format(module="some_child")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
        cwd=tmp_path,
    )
    assert starter.stdout is not None and starter.stdin is not None
    child = os.pidfd_open(int(starter.stdout.readline()))
    poll = select.poll()
    poll.register(child)
    while not (tmp_path / "begun").exists():
        assert not poll.poll(10), "the child ended by itself"
    starter.kill()
    starter.wait(60)
    starter.stdin.close()
    starter.stdout.close()
    assert bool(poll.poll(1_000 if outlives else 60_000)) is not outlives
    if outlives:
        signal.pidfd_send_signal(child, signal.SIGKILL)
    os.close(child)


RAISES = "import signal; signal.raise_signal({}); print('reached')"


@pytest.mark.parametrize(
    ("text", "starter", "code"),
    [
        *(pytest.param(RAISES.format(int(it)), "", INTERRUPTED, id=it.name) for it in ENDING),
        pytest.param("print('reached')", "1", 1, id="its starter ended before it began"),
    ],
)
def test_a_child_leaves_in_silence_while_it_is_imported(
    text: str, starter: str, code: int, tmp_path: Path
) -> None:
    (tmp_path / "slow_to_import.py").write_text(text)
    told = started.environment() | ({"MUSSELBED_STARTER": starter} if starter else {})
    done = subprocess.run(
        [sys.executable, "-m", "agents.hosting.started", "slow_to_import"],
        env={**os.environ, **told, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.getcwd()])},
        capture_output=True,
        timeout=60,
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, b"", b"")
