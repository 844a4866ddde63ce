"""A process that another of ours started. Until it is ready, the end of its starter ends it; afterwards it outlives it.

    python -m agents.hosting.started MODULE [arguments]

runs a module as such a process. While the module is imported, a signal that asks the process to end ends it in silence.
Who becomes such a process by `replace_process` ends in silence too before it has run a line of its new program.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Mapping
from typing import NoReturn

PYTHON = (sys.executable, "-P")
"""The interpreter of each process of ours. The present folder is not searched: it may hold a package named like ours."""
_VARIABLE = "MUSSELBED_STARTER"
_PR_SET_PDEATHSIG = 1
_PR_SET_DUMPABLE = 4
_PR_SET_CHILD_SUBREAPER = 36
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_LIBC = ctypes.CDLL(None)  # once: each makes a class, which only the search for garbage cycles frees


def environment() -> dict[str, str]:
    """The variable by which a process that this one starts knows its starter."""
    return {_VARIABLE: str(os.getpid())}


def end_with_starter() -> None:
    """From now on the starter's end kills this process, at once if it has ended. Does nothing for one started by hand."""
    if (starter := os.environ.pop(_VARIABLE, None)) is None:
        return
    _LIBC.prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    if os.getppid() != int(starter):
        os._exit(1)


def outlive_starter() -> None:
    """From now on this process outlives its starter."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, 0, 0, 0, 0)


def close_memory() -> None:
    """From now on no other process but root's may trace this one or a fork of it, nor read or write its memory."""
    _LIBC.prctl(_PR_SET_DUMPABLE, 0, 0, 0, 0)


def adopt_orphans() -> None:
    """From now on a descendant whose parent ends becomes a child of this process, and not of the machine's first one."""
    _LIBC.prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def replace_process(module: str, arguments: list[str], variables: Mapping[str, str]) -> NoReturn:
    """Makes this process run another module of ours, with these further variables in its environment.

    The signals that ask it to end wait until the new interpreter knows what they mean.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    command = [*PYTHON, "-m", __name__, module, *arguments]
    os.execve(command[0], command, {**os.environ, **variables})


def main() -> None:
    # Imported here, because nurseries import this module and are to stay small.
    import logging
    import runpy

    from agents.hosting.interrupts import leave_at_once

    leave_at_once()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
    end_with_starter()
    logging.raiseExceptions = False  # a log on a full disk must not fill another one with tracebacks
    _, module, *arguments = sys.argv
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
