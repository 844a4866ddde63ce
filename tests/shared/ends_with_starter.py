"""Runs a program that ends with its starter, whatever kills that one, with all of its process group.

    python ends_with_starter.py PROGRAM [arguments]     (started in a session of its own, with a pipe as standard input)

The end of standard input is the starter's end. It asks the group to end then, and kills what is left of it after a while.
Signals for the group reach the program as if this process were not there, and its exit code is the program's.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys

_END_S = 10.0


def main() -> int:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: None)  # unlike SIG_IGN, no program inherits it
    program = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL)
    ended = os.pidfd_open(program.pid)
    ready, _, _ = select.select([ended, sys.stdin], [], [])
    if ended not in ready:
        os.killpg(0, signal.SIGTERM)
        select.select([ended], [], [], _END_S)
        os.killpg(0, signal.SIGKILL)
    code = program.wait()
    return 128 - code if code < 0 else code


if __name__ == "__main__":
    sys.exit(main())
