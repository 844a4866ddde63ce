"""Reads commands from bytes. Commands have no terminator and their data may be any byte, so the reader counts bytes.

`GRAMMAR` has a row for each command: its letters, and the fields that follow. The reader reports an error once, and then
skips all bytes until the next `$`, or until the line has been silent.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from agents.modem.frames import PAYLOAD_BYTES, ModemGeneration

_DOLLAR = ord("$")
_TIMED = ord("T")
_TIME_DIGITS = 14


class CommandField(Enum):
    ADDRESS = "xxx"
    DATA = "nn<data>"
    TIME = "[T<14>]"
    """May follow only while the modem's timer is on; otherwise the command ends before it."""


GRAMMAR: dict[ModemGeneration, dict[str, tuple[CommandField, ...]]] = {
    ModemGeneration.V3: {
        "?": (),
        "A": (CommandField.ADDRESS,),
        "B": (CommandField.DATA, CommandField.TIME),
        "U": (CommandField.ADDRESS, CommandField.DATA, CommandField.TIME),
        "M": (CommandField.ADDRESS, CommandField.DATA, CommandField.TIME),
        "P": (CommandField.ADDRESS,),
        "V": (CommandField.ADDRESS,),
        "T": (CommandField.ADDRESS,),
        "E": (CommandField.ADDRESS, CommandField.DATA),
        "F": (CommandField.TIME,),
        "CM": (CommandField.ADDRESS,),
        "CC": (CommandField.ADDRESS,),
        "D": (),
        "H": (),
        "R": (),
        "Q": (),
        "N": (),
        "S": (),
        "XQE": (),
        "XQD": (),
        "XTE": (),
        "XTD": (),
        "XTC": (),
        "XTG": (),
        "XFE": (),
        "XFD": (),
        "Z": (),
        "W": (),
    },
    ModemGeneration.V2: {
        "?": (),
        "A": (CommandField.ADDRESS,),
        "B": (CommandField.DATA,),
        "U": (CommandField.ADDRESS, CommandField.DATA),
        "P": (CommandField.ADDRESS,),
        "V": (CommandField.ADDRESS,),
    },
}
_BEGINNINGS = {
    generation: frozenset(name[:n] for name in rows for n in range(1, len(name) + 1))
    for generation, rows in GRAMMAR.items()
}
LENGTH_DIGITS = {ModemGeneration.V2: 1, ModemGeneration.V3: 2}


@dataclass(frozen=True, slots=True)
class ModemCommand:
    """`address` may be up to 999 here; the modem answers one beyond 255 with an error."""

    name: str
    address: int = 0
    data: bytes = b""
    timer_us: int | None = None
    """The reading of the modem's timer at which to send; None for at once."""


@dataclass(frozen=True, slots=True)
class Malformed:
    """Answered with `E`."""

    reason: str


class CommandReader:
    """Takes one byte at a time. While `timed` is true, a time may follow where the grammar allows one."""

    def __init__(self, generation: ModemGeneration) -> None:
        self.timed = False
        self._generation = generation
        self._rows = GRAMMAR[generation]
        self._skipping = False
        self._begin()

    def _begin(self) -> None:
        self._inside = False
        self._name = ""
        self._fields: tuple[CommandField, ...] = ()
        self._wanted = 0
        """Bytes still missing from the present number or data."""
        self._taken = bytearray()
        self._counting = False
        self._address = 0
        self._data = b""
        self._timer_us: int | None = None

    @property
    def waiting(self) -> bool:
        """True if a silence now has a meaning: a command has begun, or the reader is skipping bytes."""
        return self._inside or self._skipping

    @property
    def least(self) -> int:
        """The fewest further bytes that can complete an item or make an error."""
        return self._wanted if self._in_data else 1

    @property
    def _in_data(self) -> bool:
        return bool(self._wanted) and self._fields[0] is CommandField.DATA and not self._counting

    def fell_silent(self) -> ModemCommand | Malformed | None:
        """Ends a command that was begun, because the line was silent for too long. An optional time is then absent."""
        complete = self._inside and self._fields == (CommandField.TIME,) and not self._wanted
        command = self._whole() if complete else None
        slow = self._inside and not complete
        self._skipping = False
        self._begin()
        return command if complete else Malformed("a command's bytes stopped coming") if slow else None

    def take(self, byte: int) -> list[ModemCommand | Malformed]:
        """The items that the byte completes: none, a command, an error; or the command before it and its own item."""
        if not self._inside:
            return self._outside(byte)
        if not self._fields and not self._wanted:
            return self._letter(byte)
        if self._wanted:
            return self._count(byte)
        if self._fields[0] is CommandField.TIME and byte != _TIMED:
            command = self._whole()
            self._begin()
            return [command, *self._outside(byte)]
        return self._start(byte)

    def _outside(self, byte: int) -> list[ModemCommand | Malformed]:
        if byte == _DOLLAR:
            self._begin()
            self._inside, self._skipping = True, False
            return []
        if self._skipping:
            return []
        self._skipping = True
        return [Malformed("a command begins with $")]

    def _wrong(self, byte: int, reason: str) -> list[ModemCommand | Malformed]:
        self._begin()
        self._skipping = True
        wrong: list[ModemCommand | Malformed] = [Malformed(reason)]
        return wrong + self._outside(byte) if byte == _DOLLAR else wrong

    def _letter(self, byte: int) -> list[ModemCommand | Malformed]:
        self._name += chr(byte)
        if self._name not in _BEGINNINGS[self._generation]:
            return self._wrong(byte, "there is no such command")
        if (fields := self._rows.get(self._name)) is None:
            return []
        self._fields = fields if self.timed else tuple(it for it in fields if it is not CommandField.TIME)
        return self._done_or_on()

    def _start(self, byte: int) -> list[ModemCommand | Malformed]:
        """The first byte of a field."""
        match self._fields[0]:
            case CommandField.ADDRESS:
                self._wanted = 3
            case CommandField.DATA:
                self._wanted, self._counting = LENGTH_DIGITS[self._generation], True
            case CommandField.TIME:
                self._wanted = _TIME_DIGITS
                return []  # the byte was its T
        return self._count(byte)

    def _count(self, byte: int) -> list[ModemCommand | Malformed]:
        if not self._in_data and not 48 <= byte <= 57:
            return self._wrong(byte, "needs a digit")
        self._taken.append(byte)
        self._wanted -= 1
        if self._wanted:
            return []
        taken = bytes(self._taken)
        self._taken.clear()
        match self._fields[0]:
            case CommandField.ADDRESS:
                self._address = int(taken)
            case CommandField.TIME:
                self._timer_us = int(taken)
            case CommandField.DATA if self._counting:
                self._counting = False
                fewest, most = PAYLOAD_BYTES[self._generation]
                if not fewest <= int(taken) <= most:
                    return self._wrong(0, f"{fewest} to {most} bytes can be sent")
                self._wanted = int(taken)
                return []
            case CommandField.DATA:
                self._data = taken
        self._fields = self._fields[1:]
        return self._done_or_on()

    def _done_or_on(self) -> list[ModemCommand | Malformed]:
        if self._fields:
            return []
        command = self._whole()
        self._begin()
        return [command]

    def _whole(self) -> ModemCommand:
        return ModemCommand(self._name, self._address, self._data, self._timer_us)
