"""A command that SIGTERM or SIGHUP asks to end ends as with Ctrl-C."""

from __future__ import annotations

import argparse
import os
import signal

import pytest

from agents.hosting.interrupts import ENDING
from apad_bridge.commands import main as command
from apad_bridge.runs.exits import Exit


@pytest.mark.parametrize("number", ENDING)
def test_a_terminated_command_says_so_by_its_exit_code(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def is_terminated(_: argparse.Namespace) -> int:
        os.kill(os.getpid(), number)
        signal.pause()
        return Exit.DONE

    top = argparse.ArgumentParser()
    top.set_defaults(run=is_terminated, command="run")
    monkeypatch.setattr(command, "parser", lambda: top)
    assert command.main([]) == Exit.INTERRUPTED
