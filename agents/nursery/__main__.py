"""The small process that starts, reaps and restarts agents, and outlives supervisors: python -m agents.nursery RUN_DIR

It is started by exec, so that it is small and has no threads, and in a session of its own, so that it dies alone. Its
agents die with it; another nursery goes on from the same run directory.

Agents share its memory page by page, and a page is copied as soon as one reference count in it moves. So it imports what
agents use last, into memory of its own, and runs all of it before it forks: that halves what an agent costs.
"""

from __future__ import annotations

# Not all of these are used here: they come before the memory is filled up, and what agents use comes after.
import array  # noqa: F401
import binascii  # noqa: F401
import bisect  # noqa: F401
import contextlib  # noqa: F401
import ctypes  # noqa: F401
import dataclasses  # noqa: F401
import decimal  # noqa: F401
import enum  # noqa: F401
import fcntl  # noqa: F401
import mmap  # noqa: F401
import os
import resource
import select  # noqa: F401
import signal
import socket
import struct  # noqa: F401
import sys
from typing import TYPE_CHECKING

import msgpack  # noqa: F401

from agents.lean import lean_dataclasses
from agents.nursery.memory_layout import fill_holes

if TYPE_CHECKING:
    from agents.nursery.server import NurseryServer


def main(arguments: list[str]) -> int:
    """`RUN_DIR [READY]`: READY is a descriptor that hears "ready", or why there is no nursery."""
    if not 1 <= len(arguments) <= 2:
        print("usage: python -m agents.nursery RUN_DIR [READY_DESCRIPTOR]", file=sys.stderr)
        return 2
    ready = int(arguments[1]) if len(arguments) == 2 else os.dup(sys.stderr.fileno())
    filling = fill_holes()
    try:
        caretaker = _prepare(arguments[0])
    except (OSError, ValueError) as error:
        os.write(ready, f"no nursery in {arguments[0]}: {error}\n".encode())
        return 1
    os.write(ready, b"ready\n")
    os.close(ready)
    caretaker.run()
    del filling
    return 0


def _prepare(run_dir: str) -> NurseryServer:
    with lean_dataclasses():
        import agents.hosting.agent_process  # noqa: F401 - what agents use, before what only the nursery does
    from agents.nursery.fleet_file import FleetFile

    file = FleetFile.read(run_dir)
    if file.fleet.whole is not None:
        with lean_dataclasses():
            from agents.mussel.logbook import Logbook  # noqa: F401
            from firmware_model.whole_board import WholeBoard  # noqa: F401
    from agents.nursery.children import AgentProcesses
    from agents.nursery.server import NurseryServer

    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    brood = AgentProcesses(run_dir, file)
    wakeup, waker = socket.socketpair()
    wakeup.setblocking(False)
    waker.setblocking(False)
    signal.set_wakeup_fd(waker.detach())
    caretaker = NurseryServer(run_dir, file, brood, wakeup)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGTERM, lambda *_: caretaker.end())
    brood.warm()
    return caretaker


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
