"""Packets from an aPad to an aMussel, or, with the id `wire.EVERYONE`, to all that receive them.

The packets that a v2 modem is to carry fit into its 7 bytes: those without arguments, and HOVER. Milliseconds are agent
time.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Self

from firmware_model.packets.wire import CHARGE_STEPS, HEAD, PLAIN, Kind, sealed


@dataclass(frozen=True, slots=True)
class CommandPacket:
    """A command without arguments, of one of the kinds in `PLAIN`."""

    kind: Kind
    agent_id: int

    def encode(self) -> bytes:
        """KeyError for a kind that has arguments."""
        return sealed(HEAD.pack(PLAIN[self.kind].version, self.kind, self.agent_id))


def decode_plain(body: bytes) -> CommandPacket | None:
    return CommandPacket(Kind(body[1]), HEAD.unpack(body)[2]) if len(body) == HEAD.size else None


TRIGGERS = {kind: it.trigger for kind, it in PLAIN.items() if it.trigger is not None}


class Threshold(IntEnum):
    """The thresholds of SET_THRESHOLD, in the paper's scaled charge."""

    SAFE_LEVEL = 0
    """The backup battery's level at which the board takes its last resort."""
    SWITCH_BACK = 1
    """The board returns to the primary battery at this charge."""
    LOW_LEVEL = 2
    """The primary battery's level at which a sleeping board wakes; 0 for no such level."""


_THRESHOLDS = {int(which): which for which in Threshold}


class _Arguments:
    """A command with arguments: whole numbers, packed in the order of its fields."""

    __slots__ = ()
    VERSION: ClassVar[int] = 2
    kind: ClassVar[Kind]
    FORMAT: ClassVar[struct.Struct]
    __match_args__: ClassVar[tuple[str, ...]]

    def encode(self) -> bytes:
        """Raises struct.error for an argument outside the range of its field."""
        return sealed(self.FORMAT.pack(self.VERSION, self.kind, *self._numbers()))

    @classmethod
    def decode_body(cls, body: bytes) -> Self | None:
        return cls._of(*cls.FORMAT.unpack(body)[2:]) if len(body) == cls.FORMAT.size else None

    def _numbers(self) -> Sequence[int]:
        return [getattr(self, name) for name in self.__match_args__]

    @classmethod
    def _of(cls, *numbers: Any) -> Self | None:
        subclass: Any = cls  # the fields are the subclass's
        command: Self = subclass(*numbers)
        return command


@dataclass(frozen=True, slots=True)
class SleepSchedule(_Arguments):
    """Wake every `alarm_ms` (at whole multiples of it) for `wake_ms`."""

    kind: ClassVar[Kind] = Kind.SLEEP_SCHEDULE
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHII")

    agent_id: int
    alarm_ms: int
    wake_ms: int


@dataclass(frozen=True, slots=True)
class SlotAssignment(_Arguments):
    """Assigns timeslot `index` of every frame: transmit `guard_ms` after it opens, plus `offset_ms` (negative for earlier),
    so that the packet arrives in the timeslot."""

    kind: ClassVar[Kind] = Kind.SLOT_ASSIGNMENT
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHIIHHi")

    agent_id: int
    frame_ms: int
    slot_ms: int
    guard_ms: int
    index: int
    offset_ms: int


@dataclass(frozen=True, slots=True)
class Beacon(_Arguments):
    """The aPad's clock shows `agent_ms` when this packet ends."""

    kind: ClassVar[Kind] = Kind.BEACON
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHQ")

    agent_id: int
    agent_ms: int


@dataclass(frozen=True, slots=True)
class LogAck(_Arguments):
    """Every record of the log below `next_sequence` is stored elsewhere."""

    kind: ClassVar[Kind] = Kind.LOG_ACK
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHI")

    agent_id: int
    next_sequence: int


@dataclass(frozen=True, slots=True)
class HoverAt(_Arguments):
    """Hold this depth, in steps of a quarter of a metre down to 63.75 m, so that a v2 modem can carry the packet."""

    kind: ClassVar[Kind] = Kind.HOVER
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHB")

    agent_id: int
    depth_m: float

    def _numbers(self) -> Sequence[int]:
        return self.agent_id, round(self.depth_m * 4)

    @classmethod
    def _of(cls, *numbers: Any) -> Self | None:
        agent_id, depth = numbers
        return cls(agent_id, depth / 4)


@dataclass(frozen=True, slots=True)
class SetThreshold(_Arguments):
    """Set a threshold; `value` is a charge in [0, 1], in steps of 1/65535."""

    kind: ClassVar[Kind] = Kind.SET_THRESHOLD
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHBH")

    agent_id: int
    which: Threshold
    value: float

    def _numbers(self) -> Sequence[int]:
        return self.agent_id, self.which, round(self.value * CHARGE_STEPS)

    @classmethod
    def _of(cls, *numbers: Any) -> Self | None:
        agent_id, which, value = numbers
        return cls(agent_id, _THRESHOLDS[which], value / CHARGE_STEPS) if which in _THRESHOLDS else None


Command = CommandPacket | SleepSchedule | SlotAssignment | Beacon | LogAck | HoverAt | SetThreshold
WITH_ARGUMENTS = (SleepSchedule, SlotAssignment, Beacon, LogAck, HoverAt, SetThreshold)
