"""The small process that starts, reaps and restarts agents, and outlives supervisors: python -m agents.nursery RUN_DIR

The supervisor starts it by exec, so that it is small and has no threads, and in a session of its own, so that it dies
alone. Its agents die with it; another nursery goes on from the same run directory.

Agents share its memory page by page, and a page is copied as soon as one reference count in it moves. So it runs all
code of an agent before it forks: Python's caches are filled then, in pages that all agents share.

No other process of this user may look into its memory or an agent's, by `ptrace` for example, but root's. Processes that
firmware leaves behind become its children, in whatever session they are, and end with the fleet.
"""

from __future__ import annotations

# Some of these imports serve agents only. Imported first, they leave the agents' own modules in pages next to each other,
# which saves an agent some 0.1 MB.
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
import select  # noqa: F401
import signal
import socket
import struct  # noqa: F401
import sys

import msgpack  # noqa: F401

from agents.hosting.descriptors import raise_descriptor_limit
from agents.hosting.started import adopt_orphans, close_memory, end_with_starter, outlive_starter
from agents.nursery.agent_processes import AgentProcesses
from agents.nursery.fleet_file import FleetFile
from agents.nursery.server import NurseryServer


def main(arguments: list[str]) -> int:
    """`RUN_DIR [READY]`: READY is a descriptor that receives "ready", or the reason why there is no nursery."""
    if not 1 <= len(arguments) <= 2:
        print("usage: python -m agents.nursery RUN_DIR [READY_DESCRIPTOR]", file=sys.stderr)
        return 2
    end_with_starter()
    close_memory()
    adopt_orphans()
    ready = int(arguments[1]) if len(arguments) == 2 else os.dup(sys.stderr.fileno())
    try:
        server = _prepare(arguments[0])
    except (OSError, ValueError) as error:
        os.write(ready, f"no nursery in {arguments[0]}: {error}\n".encode())
        return 1
    outlive_starter()
    os.write(ready, b"ready\n")
    os.close(ready)
    server.run()
    return 0


def _prepare(run_dir: str) -> NurseryServer:
    file = FleetFile.read(run_dir)
    raise_descriptor_limit()
    agents = AgentProcesses(run_dir, file)
    wakeup, waker = socket.socketpair()
    wakeup.setblocking(False)
    waker.setblocking(False)
    signal.set_wakeup_fd(waker.detach())
    server = NurseryServer(run_dir, file, agents, wakeup)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.signal(signal.SIGTERM, lambda *_: server.end())
    agents.warm()
    return server


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
