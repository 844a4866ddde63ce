"""A forked agent's first and last steps, in its own process."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import sys

from agents.hosting.agent_loop import WindowHandler, serve
from agents.mussel.firmware_failure import FirmwareFailed

FIRMWARE_FAILED = 65
"""The exit status of an agent whose firmware's process failed."""
FIRMWARE_HUNG = 66
"""The exit status of an agent whose firmware's process did not end its turn."""
FIRMWARE_SPUN = 67
"""The exit status of an agent whose firmware let no time of its own pass, until its board's watchdog fired."""
_PR_SET_PDEATHSIG = 1
_PR_SET_NAME = 15
_LIBC = ctypes.CDLL(None)
_PRCTL = _LIBC.prctl
_SET_SIGNAL = _LIBC.signal
_SET_MASK = _LIBC.sigprocmask
_NO_SIGNALS = ctypes.create_string_buffer(128)
"""An empty `sigset_t`; glibc's has 128 bytes."""
_DUP2, _CLOSERANGE, _GETPPID, _EXIT = os.dup2, os.closerange, os.getppid, os._exit
_SIG_DFL = 0
_SIG_SETMASK = int(signal.SIG_SETMASK)
_SIGKILL = int(signal.SIGKILL)
_SIGTERM = int(signal.SIGTERM)
_SIGCHLD = int(signal.SIGCHLD)


def live(
    nursery_pid: int,
    name: bytes,
    agent_end: int,
    link_fd: int,
    descriptors: int,
    link: socket.socket,
    buffer: memoryview,
    handler: WindowHandler,
) -> None:
    """Runs a forked agent until its end; it never returns. Its starter blocked the nursery's signals before the fork.

    The warm-up cannot run this function. So it takes what it needs from arguments and globals, because the first look-up
    of each attribute copies some five pages.
    """
    status = 1
    try:
        # A signal of before would run the nursery's handler here, which writes to a descriptor that this closes.
        _SET_SIGNAL(_SIGTERM, _SIG_DFL)
        _SET_SIGNAL(_SIGCHLD, _SIG_DFL)
        _SET_MASK(_SIG_SETMASK, _NO_SIGNALS, None)
        _DUP2(agent_end, link_fd, False)
        _CLOSERANGE(link_fd + 1, descriptors)
        _PRCTL(_PR_SET_PDEATHSIG, _SIGKILL, 0, 0, 0)
        if _GETPPID() != nursery_pid:
            _EXIT(0)  # the nursery died before its death could be a signal
        _PRCTL(_PR_SET_NAME, name, 0, 0, 0)
        serve(link, buffer, handler)
        status = 0
    except FirmwareFailed as failure:
        print(f"{name.decode()}: its firmware: {failure}", file=sys.stderr, flush=True)
        status = FIRMWARE_HUNG if failure.hung else FIRMWARE_SPUN if failure.by_watchdog else FIRMWARE_FAILED
    except MemoryError:
        # The machine, or a fault of the scenario, gives it no more. A traceback would look like a defect of ours.
        print(f"{name.decode()}: out of memory", file=sys.stderr, flush=True)
    except SystemError as failure:
        # CPython's own failure, as its compiler has without memory.
        print(
            f"{name.decode()}: CPython failed, as it may without memory: {failure}",
            file=sys.stderr,
            flush=True,
        )
    except BaseException:
        sys.excepthook(*sys.exc_info())
        sys.stderr.flush()
    finally:
        _EXIT(status)
