"""A command that SIGTERM asks to end ends as with Ctrl-C."""

from __future__ import annotations

import argparse
import os
import signal

import pytest

from apad_bridge.commands import main as command
from apad_bridge.runs.children import terminated_as_interrupted
from apad_bridge.runs.exits import Exit


def test_what_was_begun_is_ended_at_sigterm() -> None:
    ended = []
    with pytest.raises(KeyboardInterrupt), terminated_as_interrupted():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            signal.pause()
        finally:
            ended.append("in order")
    assert ended == ["in order"]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_terminated_command_says_so_by_its_exit_code(monkeypatch: pytest.MonkeyPatch) -> None:
    def is_terminated(_: argparse.Namespace) -> int:
        os.kill(os.getpid(), signal.SIGTERM)
        signal.pause()
        return Exit.DONE

    top = argparse.ArgumentParser()
    top.set_defaults(run=is_terminated, command="run")
    monkeypatch.setattr(command, "parser", lambda: top)
    assert command.main([]) == Exit.INTERRUPTED
