"""Messages between a supervisor and the nursery, and their socket. Agents' sockets travel along as descriptors."""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

import msgpack

from agents.hosting.link_protocol import LIMIT_BYTES, LinkError

SOCKET_NAME = "nursery.sock"
_CREDENTIALS = struct.Struct("iII")
DESCRIPTORS_AT_ONCE = 200
"""The most descriptors in a message; the kernel's limit is 253."""
WATCHDOG_FIRED = "its board's watchdog fired"
"""The beginning of a death's reason that makes the watchdog the cause of the next boot, and not a brown-out."""


@dataclass(frozen=True, slots=True)
class Hello:
    """A supervisor's first message. Epochs rise: a supervisor with a higher one takes over, a lower one is refused."""

    epoch: int


@dataclass(frozen=True, slots=True)
class StartAgents:
    """Rows (agent_id, at_ms, ResetCause, epoch, sequence): boot at agent time `at_ms`, in the state at that key."""

    request: int
    rows: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class Kill:
    request: int
    agent_id: int


@dataclass(frozen=True, slots=True)
class End:
    """Ends every agent, and then the nursery itself."""


@dataclass(frozen=True, slots=True)
class Welcome:
    """The answer to Hello, with the truth socket's reading end. `rolls` messages of ChildList follow."""

    pid: int
    rolls: int


@dataclass(frozen=True, slots=True)
class ChildList:
    """Rows (agent_id, pid, epoch, sequence, granted_ms): pid 0 is a dead agent, the rest is its newest record.

    The message brings the links of the living agents in the order of the rows.
    """

    rows: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class Started:
    """Rows (agent_id, pid), with a link for each."""

    request: int
    rows: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class Killed:
    request: int
    agent_id: int


@dataclass(frozen=True, slots=True)
class NurseryEnded:
    """Every agent has ended, and the nursery ends."""


@dataclass(frozen=True, slots=True)
class Died:
    """An agent's process ended by itself, or somebody else killed it."""

    agent_id: int
    pid: int
    reason: str


@dataclass(frozen=True, slots=True)
class StartRefused:
    """`request` is 0 for messages without a number; `fenced` is true if a newer supervisor has taken over."""

    request: int
    agent_id: int
    fenced: bool
    reason: str


NurseryMessage = (
    Hello
    | StartAgents
    | Kill
    | End
    | Welcome
    | ChildList
    | Started
    | Killed
    | NurseryEnded
    | Died
    | StartRefused
)

_FIELDS: dict[type[Any], tuple[type | int, ...]] = {
    # A number n stands for rows of n numbers.
    Hello: (int,),
    StartAgents: (int, 5),
    Kill: (int, int),
    End: (),
    Welcome: (int, int),
    ChildList: (5,),
    Started: (int, 2),
    Killed: (int, int),
    NurseryEnded: (),
    Died: (int, int, str),
    StartRefused: (int, int, bool, str),
}
_KINDS = tuple(_FIELDS)
_CODES = {kind: code for code, kind in enumerate(_KINDS)}


def encode(message: NurseryMessage) -> bytes:
    data: bytes = msgpack.packb([_CODES[type(message)], *astuple(message)])
    if len(data) > LIMIT_BYTES:
        raise ValueError(f"a {type(message).__name__} of {len(data)} bytes: a link carries {LIMIT_BYTES}")
    return data


def decode(data: bytes) -> NurseryMessage:
    """The inverse of `encode`; LinkError for anything else."""
    try:
        wire = msgpack.unpackb(data)
    except (
        Exception
    ) as error:  # the unpacker's errors have no common base, and any of them is the peer's fault
        raise LinkError(f"not msgpack: {type(error).__name__}") from None
    if not isinstance(wire, list) or not wire or type(wire[0]) is not int or not 0 <= wire[0] < len(_KINDS):
        raise LinkError("not a message of the control link")
    kind = _KINDS[wire[0]]
    if len(wire) != len(_FIELDS[kind]) + 1:
        raise LinkError(f"a {kind.__name__} has other fields")
    fields = [_field(value, wanted, kind) for value, wanted in zip(wire[1:], _FIELDS[kind], strict=True)]
    message: NurseryMessage = kind(*fields)
    return message


def _field(value: Any, wanted: type | int, kind: type[Any]) -> Any:
    if isinstance(wanted, int):
        if not isinstance(value, list):
            raise LinkError(f"a {kind.__name__} has rows")
        return tuple([_row(row, wanted, kind) for row in value])
    if type(value) is not wanted or (isinstance(value, int) and value < 0):
        raise LinkError(f"a {kind.__name__} has other fields")
    return value


def _row(row: Any, wanted: int, kind: type[Any]) -> tuple[int, ...]:
    if not isinstance(row, list) or len(row) != wanted or any(type(n) is not int or n < 0 for n in row):
        raise LinkError(f"a row of a {kind.__name__} has {wanted} counts")
    return tuple(row)


def send(sock: socket.socket, message: NurseryMessage, descriptors: Sequence[int] = ()) -> None:
    """Sends within the socket's own time-out; OSError if the other end is gone or does not read."""
    data = encode(message)
    if descriptors:
        socket.send_fds(sock, [data], list(descriptors))
    else:
        sock.send(data)


def receive(sock: socket.socket) -> tuple[NurseryMessage, list[int]] | None:
    """A message and its descriptors, or None at the end of the link.

    Raises LinkError for bytes that are no message, after closing their descriptors.
    """
    data, descriptors, flags, _ = socket.recv_fds(sock, LIMIT_BYTES, DESCRIPTORS_AT_ONCE)
    try:
        if not data:
            return None
        if flags & (socket.MSG_TRUNC | socket.MSG_CTRUNC):
            raise LinkError(f"longer than {LIMIT_BYTES} bytes, or too many descriptors")
        return decode(data), descriptors
    except LinkError:
        for descriptor in descriptors:
            os.close(descriptor)
        raise


def listen(
    run_dir: str, name: str = SOCKET_NAME, kind: socket.SocketKind = socket.SOCK_SEQPACKET
) -> socket.socket:
    """A socket in a run directory, for its user alone; the nursery's. It replaces a socket that a dead process left.

    For a process with one thread: for a moment it changes the umask.
    """
    sock = socket.socket(socket.AF_UNIX, kind)
    directory = os.open(run_dir, os.O_RDONLY | os.O_DIRECTORY)
    try:
        path = _short_path(directory, name)
        if os.path.lexists(path):
            os.unlink(path)
        # A socket is made with the mode that the umask leaves.
        before = os.umask(0o177)
        try:
            sock.bind(path)
        finally:
            os.umask(before)
    finally:
        os.close(directory)
    sock.listen(8)
    return sock


def connect(
    run_dir: str,
    timeout_s: float,
    name: str = SOCKET_NAME,
    kind: socket.SocketKind = socket.SOCK_SEQPACKET,
) -> socket.socket:
    """A link to the process that listens in a run directory, the nursery, with that time-out.

    OSError if there is none, or another user's.
    """
    sock = socket.socket(socket.AF_UNIX, kind)
    directory = os.open(run_dir, os.O_RDONLY | os.O_DIRECTORY)
    try:
        sock.settimeout(timeout_s)
        sock.connect(_short_path(directory, name))
        if not is_of_our_user(sock):
            raise PermissionError(f"the process at {name} in {run_dir} is another user's")
    except OSError:
        sock.close()
        raise
    finally:
        os.close(directory)
    return sock


def is_of_our_user(sock: socket.socket) -> bool:
    """True if the process at the other end of a Unix socket is this user's, or root's (unix(7), SO_PEERCRED)."""
    _, uid, _ = _CREDENTIALS.unpack(sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
    return uid in (os.geteuid(), 0)


def _short_path(directory: int, name: str) -> str:
    """A path within a Unix socket's 107 bytes; a run directory's may be longer."""
    return f"/proc/self/fd/{directory}/{name}"
