"""Messages between the process that owns a sea and the flights in it, and the link that carries them.

    flight: Hello                   sea: Welcome, or Refused
    flight: Ready                   sea: Begin, once all flights are ready
    flight: Tick                    sea: any number of Window, each of which the flight answers by Windowed; then Ticked
    flight: Leave

A link is a stream socket in a directory of the run, for its user alone. `multiprocessing.connection` frames the messages,
because a tick has no bound on its size; `agents/link_codec.py` makes their bytes.
"""

from __future__ import annotations

import socket
import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, get_args

from agents.coordinator import AgentDied
from agents.link_codec import LinkCodec
from agents.mussel.outputs import Output, Truth
from agents.mussel.stimuli import AgentStimulus
from agents.nursery import protocol
from agents.time_scale import AgentMs, MissionMs
from agents.water.places import ModemPlace
from agents.water.sea_events import SeaResult
from agents.water.topology import LinkRule, Topology

SOCKET_NAME = "sea.sock"
_LIMIT_BYTES = 2**26
_STUCK_S = 10.0
"""A message that has begun and does not go on for so long ends its link."""


class LinkEnded(Exception):
    """The link has ended, for this reason."""


@dataclass(frozen=True, slots=True)
class SeaHello:
    """A flight's first message: the number of its aPad from 0 on, and the epoch of its supervisor."""

    number: int
    epoch: int


@dataclass(frozen=True, slots=True)
class SeaWelcome:
    """`now_ms` is the mission time that the flights have come to; None before they begin."""

    now_ms: MissionMs | None


@dataclass(frozen=True, slots=True)
class SeaRefusal:
    """The flight is not, or no more, in the sea. The sea closes the link."""

    reason: str


@dataclass(frozen=True, slots=True)
class Ready:
    """The flight can begin. `clock_ms` is the clock that it will follow, now."""

    agent_ids: tuple[int, ...]
    clock_ms: int


@dataclass(frozen=True, slots=True)
class Begin:
    """The flight is in the water; its first tick is the one after `now_ms`, or the tick 0 without it.

    `clock_ms` is the clock at mission time 0, which is the same for all flights.
    """

    now_ms: MissionMs | None
    clock_ms: int


@dataclass(frozen=True, slots=True)
class StationCall:
    """A call of the flight's station by this method, one of `sea_server.CALLS`."""

    method: str
    arguments: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Tick:
    """The flight has come to mission time `now_ms`, with what it did since its last tick."""

    now_ms: MissionMs
    calls: tuple[StationCall, ...]
    truths: tuple[Truth, ...]
    due_ms: int | None
    """The coordinator's `due_agent_ms`."""


@dataclass(frozen=True, slots=True)
class Window:
    """Grants the fleet agent time up to `until_ms`. At the end of the rounds it is the tick at mission time `tick_ms`."""

    until_ms: AgentMs
    tick_ms: MissionMs | None
    stimuli: tuple[tuple[int, int, AgentStimulus], ...]
    """(aMussel, agent time, stimulus), in order."""


@dataclass(frozen=True, slots=True)
class Windowed:
    """The fleet's outcome of a window."""

    outputs: tuple[Output | AgentDied, ...]
    truths: tuple[Truth, ...]
    due_ms: int | None


@dataclass(frozen=True, slots=True)
class Ticked:
    """The tick's outcome for one flight, after all of its windows."""

    results: tuple[SeaResult, ...]
    stimuli: tuple[tuple[int, int, AgentStimulus], ...]
    """The stimuli at the very end of the last window."""
    apads: Mapping[int, ModemPlace | None]
    """`Sea.apads_at_tick`."""
    dropped: Counter[str]


@dataclass(frozen=True, slots=True)
class Leave:
    """The flight has ended in order."""


SeaMessage = SeaHello | SeaWelcome | SeaRefusal | Ready | Begin | Tick | Window | Windowed | Ticked | Leave
CODEC = LinkCodec((*get_args(SeaMessage), LinkRule, Topology), {Topology: "rules"})
"""A `StationCall` has any arguments of a station's methods; of these a topology alone is more than numbers and bytes."""


class Link:
    """One end of a link. It belongs to one thread."""

    def __init__(self, sock: socket.socket) -> None:
        # A library may have set a default time-out, as rospy does: such a socket would not block.
        sock.setblocking(True)
        for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
            sock.setsockopt(socket.SOL_SOCKET, option, struct.pack("ll", int(_STUCK_S), 0))
        self._connection: Connection[Any, Any] = Connection(sock.detach())

    def fileno(self) -> int:
        return self._connection.fileno()

    def close(self) -> None:
        self._connection.close()

    def send(self, message: SeaMessage) -> None:
        """LinkEnded if the other end is gone, or does not read."""
        try:
            self._connection.send_bytes(CODEC.encode(message))
        except OSError as error:
            raise LinkEnded(f"its link ended: {error.strerror}") from None

    def receive(self, timeout_s: float) -> SeaMessage:
        """LinkEnded if the other end is gone, sends nothing within `timeout_s`, or sends something else."""
        try:
            if not self._connection.poll(timeout_s):
                raise LinkEnded(f"no message within {timeout_s:g} s")
            data = self._connection.recv_bytes(_LIMIT_BYTES)
        except (EOFError, OSError):
            raise LinkEnded("its process is gone") from None
        try:
            message = CODEC.decode(data)
        except ValueError as error:
            raise LinkEnded(f"not a message: {error}") from None
        if not isinstance(message, SeaMessage):
            raise LinkEnded(f"not a message: {type(message).__name__}")
        return message


def listen(directory: str) -> socket.socket:
    """The socket of the process that owns the sea. For a process with one thread, as `protocol.listen`."""
    return protocol.listen(directory, SOCKET_NAME, socket.SOCK_STREAM)


def connect(directory: str, timeout_s: float) -> Link:
    """A link to that process; OSError if there is none."""
    return Link(protocol.connect(directory, timeout_s, SOCKET_NAME, socket.SOCK_STREAM))
