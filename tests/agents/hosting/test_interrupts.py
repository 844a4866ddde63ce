"""SIGINT, SIGTERM and SIGHUP: held back, let in, taken as a request to stop; and each torn in no other place."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import threading

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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_acts_at_the_end_as_it_did_before(number: int) -> None:
    acted: list[int] = []
    before = signal.signal(number, lambda it, _: acted.append(it))
    try:
        with held_back():
            with held_back():
                signal.raise_signal(number)
            assert acted == []
        assert acted == [number]
        signal.raise_signal(number)
        assert acted == [number, number]
    finally:
        signal.signal(number, before)


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


def test_nohup_stays_asked_for() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


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
def test_a_child_that_is_not_ready_ends_with_its_starter(outlives: bool, tmp_path: os.PathLike[str]) -> None:
    lines = ["import sys", "from agents.hosting.started import outlive_starter"]
    lines += ["outlive_starter()"] if outlives else []
    lines += ["open('begun', 'w').close()", "import select", "select.select([], [], [], 60)"]
    with open(os.path.join(tmp_path, "some_child.py"), "w") as module:
        module.write("\n".join(lines))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([os.fspath(tmp_path), os.getcwd()])}
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
    while not os.path.exists(os.path.join(tmp_path, "begun")):
        assert not poll.poll(10), "the child ended by itself"
    starter.kill()
    starter.wait(60)
    starter.stdin.close()
    starter.stdout.close()
    assert bool(poll.poll(1_000 if outlives else 60_000)) is not outlives
    if outlives:
        signal.pidfd_send_signal(child, signal.SIGKILL)
    os.close(child)


def test_a_child_whose_starter_ended_before_it_began_ends_too() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "agents.hosting.started", "this"],
        env={**os.environ, **started.environment(), "MUSSELBED_STARTER": "1"},
        capture_output=True,
        timeout=60,
    )
    assert done.returncode == 1 and done.stdout == b""


@pytest.mark.parametrize("number", ENDING)
def test_a_child_leaves_in_silence_while_it_is_imported(number: int, tmp_path: os.PathLike[str]) -> None:
    with open(os.path.join(tmp_path, "slow_to_import.py"), "w") as module:
        module.write(f"import signal; signal.raise_signal({int(number)}); print('reached')")
    done = subprocess.run(
        [sys.executable, "-m", "agents.hosting.started", "slow_to_import"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([os.fspath(tmp_path), os.getcwd()])},
        capture_output=True,
        timeout=60,
    )
    assert (done.returncode, done.stdout, done.stderr) == (INTERRUPTED, b"", b"")
