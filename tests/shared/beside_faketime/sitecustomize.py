"""For a Python below libfaketime, by PYTHONPATH: Debian 12's lets every `time.sleep` of Python 3.11 fail (EINVAL).

It mistakes the absolute monotonic time by which this Python sleeps. A wait for an event goes another way, which it knows.
"""

import threading
import time


def sleep(seconds: float) -> None:
    threading.Event().wait(seconds)


time.sleep = sleep
