"""What a test or a benchmark starts ends with it, even where that one is killed and can end nothing itself."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from patient import PATIENCE_S

pytestmark = pytest.mark.system
PROGRAM = Path(__file__).parents[1] / "shared" / "ends_with_starter.py"
STARTER = """
import subprocess, sys
program = subprocess.Popen(sys.argv[1:], stdin=subprocess.PIPE, start_new_session=True)
program.wait()
"""
FAMILY = "(trap '' TERM; exec sleep 600) & echo $$ $!; wait"
"""A program with a child in its group, which does not obey SIGTERM."""


def started(*words: str) -> tuple[subprocess.Popen[str], list[int]]:
    """A starter, and descriptors of the program's processes, by which their end can be waited for."""
    starter = subprocess.Popen(
        [sys.executable, "-c", STARTER, sys.executable, str(PROGRAM), *words],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert starter.stdout is not None
    family = [os.pidfd_open(int(it)) for it in starter.stdout.readline().split()]
    return starter, family


def test_a_program_and_its_group_end_when_their_starter_is_killed() -> None:
    starter, family = started("sh", "-c", FAMILY)
    assert len(family) == 2
    starter.send_signal(signal.SIGKILL)
    starter.communicate()
    for it in family:
        assert select.select([it], [], [], PATIENCE_S)[0], "it outlives its starter"
        os.close(it)


@pytest.mark.parametrize(("words", "code"), [("exit 7", 7), ("kill -9 $$", 128 + signal.SIGKILL)])
def test_its_exit_code_is_the_program_s(words: str, code: int) -> None:
    program = subprocess.Popen([sys.executable, str(PROGRAM), "sh", "-c", words], stdin=subprocess.PIPE)
    assert program.wait(PATIENCE_S) == code
    program.communicate()
