"""A stop sign that a signal handler sets in the middle of a wait of its own thread."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

from apad_bridge.supervisor.clock import StopSign

# A handler every 50 us, and waits hardly longer: with a threading.Event this deadlocks.
STORM = """
import signal
from apad_bridge.supervisor.clock import StopSign
signs = [StopSign()]
signal.signal(signal.SIGALRM, lambda *_: signs[0].set())
signal.setitimer(signal.ITIMER_REAL, 5e-5, 5e-5)
for _ in range(5000):
    signs[0] = StopSign()
    signs[0].wait(1e-4)
signal.setitimer(signal.ITIMER_REAL, 0)
print("through")
"""


def test_a_handler_may_set_it_at_any_moment() -> None:
    root = Path(__file__).parents[3]
    done = subprocess.run(
        [sys.executable, "-c", STORM], capture_output=True, text=True, timeout=60, cwd=root, check=True
    )
    assert done.stdout == "through\n"


def test_who_waits_is_woken_at_once() -> None:
    sign = StopSign()
    assert not sign.wait(0.001)
    other = threading.Thread(target=sign.set)
    other.start()
    assert sign.wait(30.0)
    other.join()
    assert sign.is_set() and sign.wait(30.0)
