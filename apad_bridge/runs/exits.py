"""The exit codes of all commands, and their meaning. `apad_bridge/commands/outcome.py` decides that of a run."""

from __future__ import annotations

import errno
import resource
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path

from apad_bridge.scenario.errors import UserError
from apad_bridge.vehicle.link_errors import PeerFailed

_SAYS_NO_MEMORY = ("failed to map segment", "annot allocate memory")
_ONE_REQUEST, _ONE_LIBRARY = 2 << 20, 64 << 20
"""Bytes: as much as an object of ours may ask for at once, and a package's library where it is loaded. CPython takes 1 MiB
at a time for its small objects; numpy's library of linear algebra is 25 MiB long."""
_OURS = tuple(Path(__file__).parents[2] / it for it in ("agents", "apad_bridge", "firmware_model"))
"""A file that is missing there is a bug of ours, or of the installation."""
LEAST_ADDRESS_SPACE = 160_000 * 1024
"""Bytes. The interpreter takes 141 440 kB with numpy, whose library of linear algebra may ask for ever with less."""


class Exit(IntEnum):
    DONE = 0
    BUG = 1
    USER_MISTAKE = 2
    PEER_FAILED = 3
    INTERRUPTED = 130


EXITS = (
    "0 done, 1 a bug of ours (with its traceback), 2 a user's mistake (one line that says what to do), "
    "3 a dependency failed or timed out, 130 ended by Ctrl-C, SIGTERM or SIGHUP, with complete records"
)


def refuse(*rules: tuple[object, str]) -> None:
    """UserError with the text, which says the mend, of the first of these rules (true where it is broken, text)."""
    if text := next((text for is_broken, text in rules if is_broken), None):
        raise UserError(text)


def require_yes(question: str, unattended: str, unconfirmed: str) -> None:
    """Asks a person to type yes. UserError: `unattended` without a terminal, `unconfirmed` for another answer."""
    if not sys.stdin.isatty():
        raise UserError(unattended)
    if input(f"{question} Type yes: ").strip().lower() != "yes":
        raise UserError(unconfirmed)


@contextmanager
def peers_may_fail(was_shown: Callable[[str], bool] = lambda line: False) -> Iterator[None]:
    """Turns a peer's failure into one line on stderr and its exit code; each command runs in one.

    A line of the failure that a person `was_shown` already, as it happened, is not printed again.
    """
    try:
        yield
    except PeerFailed as error:
        if not_shown := [it for it in error.lines if not was_shown(it)]:
            print(f"musselbed: {'; '.join(not_shown)}", file=sys.stderr)
        raise SystemExit(Exit.PEER_FAILED) from error


def shortage(error: OSError) -> str | None:
    """One line for what the machine is short of: a disk's room, memory, or open files. None for another error."""
    if error.errno in (errno.EMFILE, errno.ENFILE):
        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        return f"too many open files: `ulimit -n` allows {soft} here; raise it"
    if error.errno == errno.ENOMEM:
        return memory_shortage()
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return f"{error.filename or 'the output, or the disk of the run directory'}: {error.strerror}"
    return None


def fault_of_file(error: OSError) -> str | None:
    """One line for a file that a user's command cannot read or write; None where the error names none, or one of ours."""
    if error.filename is None or any(Path(str(error.filename)).is_relative_to(it) for it in _OURS):
        return None
    return f"{error.filename}: {error.strerror}"


def memory_shortage() -> str:
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft == resource.RLIM_INFINITY:
        return "not enough memory: end other programs, or fly fewer aMussels here"
    return f"not enough memory: `ulimit -v` allows {soft // 1024} kB here; raise it"


def is_short_of_address_space() -> bool:
    """True where the limit of this process lets no command load its libraries."""
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    return soft != resource.RLIM_INFINITY and soft < LEAST_ADDRESS_SPACE


def is_for_lack_of_memory(error: BaseException) -> bool:
    """True for an error that comes of too little memory, whatever its class says.

    The loader of a package's library says so in its text alone, and packages put their own errors before it. CPython may
    lose a MemoryError on its way: its import then raises SystemError, its compiler a ValueError of a missing field. So any
    error counts of a process whose address space has grown up to its limit.
    """
    link: BaseException | None = error
    while link is not None:
        if isinstance(link, MemoryError) or any(it in str(link) for it in _SAYS_NO_MEMORY):
            return True
        link = link.__cause__ or link.__context__
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    asked = _ONE_LIBRARY if isinstance(error, ImportError) else _ONE_REQUEST
    return soft != resource.RLIM_INFINITY and _greatest_address_space() + asked > soft


def _greatest_address_space() -> int:
    """Bytes that this process has had at most; 0 where the kernel does not tell."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmPeak:")), 0)
