"""The simulated aPad's process is ended, whatever it does and however busy the machine is."""

from __future__ import annotations

import signal
import subprocess
import sys

from apad_bridge.ros.system.master import end_process

DEAF = "import signal, sys; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('ready', flush=True); sys.stdin.read()"


def test_one_that_takes_no_word_is_killed_and_may_take_longer_to_be_gone_than_the_patience_with_it() -> None:
    child = subprocess.Popen([sys.executable, "-c", DEAF], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert child.stdin is not None and child.stdout is not None
    assert child.stdout.readline() == b"ready\n"
    assert end_process(child, patience_s=0.0) == -signal.SIGKILL
    child.stdin.close()
