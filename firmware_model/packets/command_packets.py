"""Packets from an aPad to an aMussel, or, with the id `wire.EVERYONE`, to all that receive them.

The packets that a v2 modem is to carry fit into its 7 bytes: those without arguments, and HOVER. Milliseconds are agent
time.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Self

from firmware_model.packets.wire import CHARGE_STEPS, HEAD, Kind, sealed
from firmware_model.states import Trigger

_PLAIN: dict[Kind, tuple[int, Trigger | None]] = {
    Kind.PERMISSION: (1, Trigger.PERMISSION_HEARD),
    Kind.RELEASE: (1, Trigger.CLEAR_TO_SINK),
    Kind.PING: (1, Trigger.PING_HEARD),
    Kind.HOVER: (1, Trigger.HOVER_TOLD),
    Kind.SINK: (2, Trigger.SINK_TOLD),
    Kind.BACK_UP_LOG: (2, None),
}
"""The commands without arguments: the layout version that introduced each, and its trigger of the transition table."""


@dataclass(frozen=True, slots=True)
class CommandPacket:
    """A command without arguments: PERMISSION to surface, RELEASE (it is clear to sink), PING (send a short status), HOVER
    (hold the present depth), SINK, or BACK_UP_LOG (send the log, as long as there is Wi-Fi)."""

    kind: Kind
    agent_id: int

    def encode(self) -> bytes:
        """KeyError for a kind that has arguments."""
        return sealed(HEAD.pack(_PLAIN[self.kind][0], self.kind, self.agent_id))


def decode_plain(body: bytes) -> CommandPacket | None:
    if len(body) != HEAD.size:
        return None
    _, kind, agent_id = HEAD.unpack(body)
    return CommandPacket(Kind(kind), agent_id)


PLAIN_KINDS = frozenset(_PLAIN)
"""The kinds of `CommandPacket`."""
PLAIN = tuple((version, kind) for kind, (version, _) in _PLAIN.items())
TRIGGERS = {kind: trigger for kind, (_, trigger) in _PLAIN.items() if trigger is not None}


class Threshold(IntEnum):
    """The thresholds of SET_THRESHOLD, in the paper's scaled charge."""

    SAFE_LEVEL = 0
    """The backup battery's level at which the board takes its last resort."""
    SWITCH_BACK = 1
    """The board returns to the primary battery at this charge."""
    LOW_LEVEL = 2
    """The primary battery's level at which a sleeping board wakes; 0 for no such level."""


_THRESHOLDS = {int(which): which for which in Threshold}


class _Numbers:
    """A command whose arguments are whole numbers; they are packed unchanged, in the order of its fields."""

    __slots__ = ()
    VERSION: ClassVar[int] = 2
    KIND: ClassVar[Kind]
    FORMAT: ClassVar[struct.Struct]
    __match_args__: ClassVar[tuple[str, ...]]

    @property
    def kind(self) -> Kind:
        return self.KIND

    def encode(self) -> bytes:
        """Raises struct.error for a number outside the range of its field."""
        numbers = [getattr(self, name) for name in self.__match_args__]
        return sealed(self.FORMAT.pack(self.VERSION, self.KIND, *numbers))

    @classmethod
    def decode_body(cls, body: bytes) -> Self | None:
        if len(body) != cls.FORMAT.size:
            return None
        subclass: Any = cls  # the fields are the subclass's
        command: Self = subclass(*cls.FORMAT.unpack(body)[2:])
        return command


@dataclass(frozen=True, slots=True)
class SleepSchedule(_Numbers):
    """Wake every `alarm_ms` (at whole multiples of it) for `wake_ms`."""

    KIND: ClassVar[Kind] = Kind.SLEEP_SCHEDULE
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHII")

    agent_id: int
    alarm_ms: int
    wake_ms: int


@dataclass(frozen=True, slots=True)
class SlotAssignment(_Numbers):
    """Assigns timeslot `index` of every frame: transmit `guard_ms` after it opens, plus `offset_ms` (negative for earlier),
    so that the packet arrives in the timeslot."""

    KIND: ClassVar[Kind] = Kind.SLOT_ASSIGNMENT
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHIIHHi")

    agent_id: int
    frame_ms: int
    slot_ms: int
    guard_ms: int
    index: int
    offset_ms: int


@dataclass(frozen=True, slots=True)
class Beacon(_Numbers):
    """The aPad's clock shows `agent_ms` when this packet ends."""

    KIND: ClassVar[Kind] = Kind.BEACON
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHQ")

    agent_id: int
    agent_ms: int


@dataclass(frozen=True, slots=True)
class LogAck(_Numbers):
    """Every record of the log below `next_sequence` is stored elsewhere."""

    KIND: ClassVar[Kind] = Kind.LOG_ACK
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHI")

    agent_id: int
    next_sequence: int


@dataclass(frozen=True, slots=True)
class HoverAt:
    """Hold this depth, in steps of a quarter of a metre down to 63.75 m, so that a v2 modem can carry the packet."""

    VERSION: ClassVar[int] = 2
    KIND: ClassVar[Kind] = Kind.HOVER
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHB")

    agent_id: int
    depth_m: float

    @property
    def kind(self) -> Kind:
        return self.KIND

    def encode(self) -> bytes:
        """Raises struct.error for a depth outside 0 to 63.75 m."""
        return sealed(self.FORMAT.pack(self.VERSION, self.KIND, self.agent_id, round(self.depth_m * 4)))

    @classmethod
    def decode_body(cls, body: bytes) -> HoverAt | None:
        if len(body) != cls.FORMAT.size:
            return None
        _, _, agent_id, depth = cls.FORMAT.unpack(body)
        return cls(agent_id, depth / 4)


@dataclass(frozen=True, slots=True)
class SetThreshold:
    """Set a threshold; `value` is a charge in [0, 1], in steps of 1/65535."""

    VERSION: ClassVar[int] = 2
    KIND: ClassVar[Kind] = Kind.SET_THRESHOLD
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHBH")

    agent_id: int
    which: Threshold
    value: float

    @property
    def kind(self) -> Kind:
        return self.KIND

    def encode(self) -> bytes:
        """Raises struct.error for a value outside [0, 1]."""
        value = round(self.value * CHARGE_STEPS)
        return sealed(self.FORMAT.pack(self.VERSION, self.KIND, self.agent_id, self.which, value))

    @classmethod
    def decode_body(cls, body: bytes) -> SetThreshold | None:
        if len(body) != cls.FORMAT.size:
            return None
        _, _, agent_id, which, value = cls.FORMAT.unpack(body)
        known = _THRESHOLDS.get(which)
        return None if known is None else cls(agent_id, known, value / CHARGE_STEPS)


Command = CommandPacket | SleepSchedule | SlotAssignment | Beacon | LogAck | HoverAt | SetThreshold
WITH_ARGUMENTS = (SleepSchedule, SlotAssignment, Beacon, LogAck, HoverAt, SetThreshold)
