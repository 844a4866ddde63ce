"""Messages between a supervisor and an agent's process: one msgpack array each, over a SOCK_SEQPACKET socket.

A window carries a key, (epoch, sequence). The epoch counts supervisors: an agent that has received a higher epoch refuses
a lower one ("fenced off"). A repeated key gets the same answer again, so a supervisor may ask as often as it likes. A
message of more than `LIMIT_BYTES`, or of none of these kinds, is a LinkError: the receiver drops and counts it, an
agent also answers with a Refusal, and nothing else changes. For a supervisor a malformed answer is no answer, so its
watchdog judges the agent.

In virtual time an agent may run ahead: it runs windows that end at the mission's seconds, as if nothing happened to it, and
sends all their outcomes at once. If something does happen, the next window names the time to go back to.
"""

from __future__ import annotations

import select
import socket
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import msgpack

from agents.hosting.host import Grant, Reply
from agents.mussel import outputs, stimuli
from agents.mussel.outputs import Truth
from firmware_model.value import value

LIMIT_BYTES = 65536
"""The largest message, either way, on any of the fleet's sockets."""
OUTPUTS_AT_ONCE = 256
"""An answer with more outputs than this, or with more bytes than `_PART_BYTES`, travels in parts."""
_PART_BYTES = 8192
"""Less than a message holds, because the memory that packing touches stays an agent's."""
_OUTPUT_BYTES = 32
"""The size of an output without its value."""

_pack = msgpack.Packer().pack
"""One packer for all messages, because each `msgpack.packb` takes a buffer of a megabyte."""

Key = tuple[int, int]
"""(epoch, sequence) of a window."""
NEVER: Key = (0, 0)
"""The key of an agent's first record, before any window."""


class LinkError(ValueError):
    """Bytes that are no message of this link, for this reason."""


class LinkMessageKind(IntEnum):
    WINDOW = 1
    REPEAT = 2
    ANSWER = 3
    REFUSAL = 4
    RUN_AHEAD = 5
    AHEAD = 6


@dataclass(frozen=True, slots=True)
class WindowGrant:
    key: Key
    grant: Grant
    from_ms: int | None = None
    """The end of the last window that counts, to which an agent that ran ahead goes back; None: it never ran ahead."""

    def encode(self) -> bytes:
        """ValueError for a window with more stimuli than a message holds."""
        facts = [[at_ms, stimuli.to_wire(stimulus)] for at_ms, stimulus in self.grant.stimuli]
        data: bytes = _pack([LinkMessageKind.WINDOW, *self.key, self.grant.until_ms, facts, self.from_ms])
        if len(data) > LIMIT_BYTES:
            raise ValueError(
                f"a window of {len(data)} bytes: a link carries {LIMIT_BYTES}; grant shorter windows"
            )
        return data


@dataclass(frozen=True, slots=True)
class Repeat:
    """A new supervisor's first message: answer the last window again, and send the present truth."""

    key: Key

    def encode(self) -> bytes:
        data: bytes = _pack([LinkMessageKind.REPEAT, *self.key])
        return data


@dataclass(frozen=True, slots=True)
class RunAhead:
    """Run so many more windows, each to the end of the mission second in which the agent next acts by itself."""

    key: Key
    windows: int
    counted_ms: int
    """The end of the last window that counts: the agent need not go back beyond it."""

    def encode(self) -> bytes:
        data: bytes = _pack([LinkMessageKind.RUN_AHEAD, *self.key, self.windows, self.counted_ms])
        return data


@value
class AheadWindow:
    """The outcome of one window to `until_ms` that an agent ran ahead."""

    until_ms: int
    reply: Reply
    truths: tuple[Truth, ...]


@dataclass(frozen=True, slots=True)
class Ahead:
    """The windows that an agent ran ahead because of `key`, in order; fewer than asked if it has nothing more to do."""

    key: Key
    windows: tuple[AheadWindow, ...]

    def encode(self) -> bytes:
        rows = [
            [
                window.until_ms,
                window.reply.next_due_ms,
                [outputs.to_wire(output) for output in window.reply.outputs],
                b"".join([truth.pack() for truth in window.truths]),
            ]
            for window in self.windows
        ]
        data: bytes = _pack([LinkMessageKind.AHEAD, *self.key, rows])
        return data


@dataclass(frozen=True, slots=True)
class WindowAnswer:
    """Part `part` of `parts` of the outcome of `window`, sent because of `key`."""

    key: Key
    window: Key
    granted_ms: int
    truths: int
    """The number of truths that the window sent on the fleet's truth socket, so that none is lost silently."""
    part: int
    parts: int
    reply: Reply


@dataclass(frozen=True, slots=True)
class WindowRefusal:
    """The agent refused a message. `key` is that message's, or the agent's last if it could not read the message."""

    key: Key
    fenced: bool
    reason: str

    def encode(self) -> bytes:
        data: bytes = _pack([LinkMessageKind.REFUSAL, *self.key, self.fenced, self.reason])
        return data


def encode_answer(key: Key, window: Key, granted_ms: int, truths: int, reply: Reply) -> list[bytes]:
    """The Answers that carry `reply`, in order."""
    parts = _parts([outputs.to_wire(output) for output in reply.outputs])
    return [
        _pack(
            [
                LinkMessageKind.ANSWER,
                *key,
                *window,
                granted_ms,
                truths,
                index,
                len(parts),
                reply.next_due_ms,
                part,
            ]
        )
        for index, part in enumerate(parts)
    ]


def _parts(wire: list[list[Any]]) -> list[list[list[Any]]]:
    """The outputs in order, in parts that fit a message; one empty part if there are none."""
    parts: list[list[list[Any]]] = [[]]
    room = _PART_BYTES
    for output in wire:
        value = output[2]
        size = _OUTPUT_BYTES
        if type(value) is not int:
            size += len(value) if type(value) is bytes else 4 * len(value)
        if (size > room or len(parts[-1]) == OUTPUTS_AT_ONCE) and parts[-1]:
            parts.append([])
            room = _PART_BYTES
        parts[-1].append(output)
        room -= size
    return parts


def decode_to_agent(data: bytes | memoryview) -> WindowGrant | Repeat | RunAhead:
    """Decodes a supervisor's message; LinkError for anything else."""
    fields = _array(data)
    if len(fields) == 6 and fields[0] == LinkMessageKind.WINDOW and isinstance(fields[4], list):
        epoch, sequence, until_ms = _counts(fields[1:4])
        from_ms = None if fields[5] is None else _count(fields[5])
        return WindowGrant(
            (epoch, sequence), Grant(until_ms, tuple(_fact(item) for item in fields[4])), from_ms
        )
    if len(fields) == 5 and fields[0] == LinkMessageKind.RUN_AHEAD:
        epoch, sequence, windows, counted_ms = _counts(fields[1:])
        return RunAhead((epoch, sequence), windows, counted_ms)
    if len(fields) == 3 and fields[0] == LinkMessageKind.REPEAT:
        epoch, sequence = _counts(fields[1:3])
        return Repeat((epoch, sequence))
    raise LinkError("no window, no repeat and no order to run ahead")


def decode_from_agent(data: bytes | memoryview, agent_id: int) -> WindowAnswer | Ahead | WindowRefusal:
    """Decodes a message of this agent; LinkError for anything else."""
    fields = _array(data)
    if len(fields) == 11 and fields[0] == LinkMessageKind.ANSWER and isinstance(fields[10], list):
        epoch, sequence, of_epoch, of_sequence, granted_ms, truths, part, parts = _counts(fields[1:9])
        if part >= parts:
            raise LinkError("a part beyond the last one")
        reply = _reply(fields[9], fields[10], agent_id)
        return WindowAnswer(
            (epoch, sequence), (of_epoch, of_sequence), granted_ms, truths, part, parts, reply
        )
    if len(fields) == 4 and fields[0] == LinkMessageKind.AHEAD and isinstance(fields[3], list):
        epoch, sequence = _counts(fields[1:3])
        return Ahead((epoch, sequence), tuple([_ahead_window(row, agent_id) for row in fields[3]]))
    if (
        len(fields) == 5
        and fields[0] == LinkMessageKind.REFUSAL
        and type(fields[3]) is bool
        and type(fields[4]) is str
    ):
        epoch, sequence = _counts(fields[1:3])
        return WindowRefusal((epoch, sequence), fields[3], fields[4])
    raise LinkError("no answer, no windows ahead and no refusal")


def _reply(next_due_ms: Any, wire: list[Any], agent_id: int) -> Reply:
    try:
        decoded = tuple([outputs.from_wire(output, agent_id) for output in wire])
    except ValueError as error:
        raise LinkError(str(error)) from None
    return Reply(None if next_due_ms is None else _count(next_due_ms), decoded)


def _ahead_window(row: Any, agent_id: int) -> AheadWindow:
    if not isinstance(row, list) or len(row) != 4 or type(row[2]) is not list or type(row[3]) is not bytes:
        raise LinkError("not a window ahead")
    until_ms, next_due_ms, wire, packed = row
    try:
        truths = outputs.unpack_truths(packed)
    except ValueError as error:
        raise LinkError(str(error)) from None
    return AheadWindow(_count(until_ms), _reply(next_due_ms, wire, agent_id), truths)


def _array(data: bytes | memoryview) -> list[Any]:
    if len(data) > LIMIT_BYTES:
        raise LinkError(f"longer than {LIMIT_BYTES} bytes")
    try:
        fields = msgpack.unpackb(data)
    except (
        Exception
    ) as error:  # the unpacker's errors have no common base, and any of them is the peer's fault
        raise LinkError(f"not msgpack: {type(error).__name__}") from None
    if not isinstance(fields, list):
        raise LinkError("not an array")
    return fields


def _counts(fields: list[Any]) -> list[int]:
    return [_count(field) for field in fields]


def _count(field: Any) -> int:
    if type(field) is not int or field < 0:
        raise LinkError("must be a count from 0")
    return field


def _fact(item: Any) -> tuple[int, stimuli.AgentStimulus]:
    if not isinstance(item, list) or len(item) != 2:
        raise LinkError("not a (time, stimulus)")
    try:
        return _count(item[0]), stimuli.from_wire(item[1])
    except ValueError as error:
        raise LinkError(str(error)) from None


def hung_up(sock: socket.socket) -> bool:
    """True if the other end is closed. An empty message, which is only malformed, reads like a closed end."""
    poll = select.poll()
    poll.register(sock, 0)
    return any(event & (select.POLLHUP | select.POLLERR) for _, event in poll.poll(0))


def readable(sock: socket.socket | int, timeout_s: float) -> bool:
    """Waits until there is data, or the end of the link. `select.select` would fail beyond descriptor 1023."""
    poll = select.poll()
    poll.register(sock, select.POLLIN)
    return bool(poll.poll(max(0.0, timeout_s) * 1000))
