"""A fork ends as its orders say, also if they come before it has run a line of its own, and says why it ends."""

from __future__ import annotations

import os
import signal
import socket
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
from fleets import PAPER

from agents.fleet_config import resting_on_bottom
from agents.nursery import agent_processes, forked_agent
from agents.nursery.agent_processes import AgentProcesses, Boot, LivingAgent
from agents.nursery.fleet_file import FleetFile, RestartPolicy
from firmware_model.stimuli import ResetCause

FILE = FleetFile(
    replace(PAPER, agent_ids=(3,)),
    {3: resting_on_bottom(1.0, 2.0, 8.0, 0.5, 1.0)},
    RestartPolicy(orphan_s=5.0),
)


def test_an_order_to_end_that_comes_with_the_fork_ends_the_agent_and_runs_no_handler_of_its_nursery(
    tmp_path: Path,
) -> None:
    nursery = os.fork()
    if nursery == 0:
        status = 1
        try:
            status = start_one_that_is_to_end(tmp_path)
        finally:
            os._exit(status)
    _, status = os.waitpid(nursery, 0)
    assert os.waitstatus_to_exitcode(status) == signal.SIGTERM
    assert not (tmp_path / "handled").exists()


def start_one_that_is_to_end(run: Path) -> int:
    """In a nursery's process. Returns the signal that ended the agent."""
    fork = os.fork
    signal.alarm(20)  # its end ends its agent

    def fork_and_order_end() -> int:
        pid = fork()
        if pid == 0:
            os.kill(os.getpid(), signal.SIGTERM)
        return pid

    signal.signal(signal.SIGTERM, lambda *_: (run / "handled").touch())
    agent_processes.os.fork = fork_and_order_end
    (agent,) = AgentProcesses(str(run), FILE).start([Boot(3, 0, ResetCause.POWER_ON, (0, 0))])
    assert isinstance(agent, LivingAgent)
    _, status = os.waitpid(agent.pid, 0)
    assert signal.SIGTERM not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    return -os.waitstatus_to_exitcode(status)


@pytest.mark.parametrize(
    ("failure", "line"),
    [
        (MemoryError(), "out of memory"),
        (SystemError("no exception set"), "CPython failed, as it may without memory: no exception set"),
    ],
)
def test_an_agent_without_memory_says_so_in_one_line(
    failure: BaseException, line: str, tmp_path: Path
) -> None:

    def take_too_much(*_: object) -> None:
        raise failure

    agent = os.fork()
    if agent == 0:
        signal.alarm(20)
        os.dup2(os.open(tmp_path / "log", os.O_WRONLY | os.O_CREAT), 2)
        sys.stderr = os.fdopen(2, "w")
        ours, theirs = socket.socketpair()
        vars(forked_agent)["serve"] = take_too_much
        forked_agent.live(
            os.getppid(), b"amussel-3", theirs.fileno(), 3, 64, ours, memoryview(b""), cast(Any, None)
        )
    _, status = os.waitpid(agent, 0)
    assert os.waitstatus_to_exitcode(status) == 1
    assert (tmp_path / "log").read_text() == f"amussel-3: {line}\n"
