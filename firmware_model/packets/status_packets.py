"""Status packets of an aMussel: the full one by Wi-Fi, 45 bytes by a v3 modem, 7 bytes by a v2 modem.

Positions are encoded as local NED centimetres, charges as 1/65535 of the paper's scaled range (1/255 in the short one).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from operator import attrgetter
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_origin, get_type_hints

from firmware_model.packets.wire import CHARGE_STEPS, Kind, sealed
from firmware_model.power.active_battery import ActiveBattery
from firmware_model.sampling.sensors import COUNT_FIELDS, LAYOUT, SENSORS, Counts
from firmware_model.states import STATE_OF, State
from firmware_model.stimuli import ResetCause
from firmware_model.value import value

StatusFields = tuple[int, int, State, float, float, float, float, float, int]
"""The fields of a `StatusPacket`, in their order."""


@value
class StatusPacket:
    """A status, and the part that every one but the short one begins with: its time is agent time."""

    VERSION: ClassVar[int] = 1
    KIND: ClassVar[Kind] = Kind.STATUS
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BBHHBHHiiHQ")

    agent_id: int
    sequence: int
    """Counts all statuses since the boot, modulo 65536, also the short ones, which do not carry it."""
    state: State
    primary: float
    """A charge, in steps of 1/65535, as the next one."""
    secondary: float
    north_m: float
    """In centimetres, as the next two."""
    east_m: float
    depth_m: float
    agent_ms: int
    """The time of the report."""

    def encode(self) -> bytes:
        return sealed(self._pack())

    def _pack(self) -> bytes:
        """The fields of every status, without a check."""
        return StatusPacket.FORMAT.pack(
            self.VERSION,
            self.KIND,
            self.agent_id,
            self.sequence & 0xFFFF,
            self.state,
            round(self.primary * CHARGE_STEPS),
            round(self.secondary * CHARGE_STEPS),
            round(self.north_m * 100),
            round(self.east_m * 100),
            min(0xFFFF, round(self.depth_m * 100)),
            self.agent_ms,
        )

    @classmethod
    def decode_body(cls, body: bytes) -> StatusPacket | None:
        fields = _fields_of(body, 0)
        return None if fields is None else cls(*fields)


def _fields_of(body: bytes, more: int) -> StatusFields | None:
    """The fields of every status; None for an unknown state, or if there are not `more` bytes behind them."""
    if len(body) != StatusPacket.FORMAT.size + more:
        return None
    _, _, agent_id, sequence, state, primary, secondary, north, east, depth, agent_ms = (
        StatusPacket.FORMAT.unpack_from(body)
    )
    if state not in STATE_OF:
        return None
    return (
        agent_id,
        sequence,
        STATE_OF[state],
        primary / CHARGE_STEPS,
        secondary / CHARGE_STEPS,
        north / 100,
        east / 100,
        depth / 100,
        agent_ms,
    )


_MOST = {"B": 0xFF, "H": 0xFFFF, "I": 0xFFFF_FFFF, "i": 0x7FFF_FFFF}
"""The greatest number of each type on the wire, by its letter of `struct`."""


class Tail(NamedTuple):
    """The bytes of a longer status behind the common part: the counts, and the further fields in their order."""

    format: struct.Struct
    values: Callable[[LongStatus], tuple[Any, ...]]
    """The values of the further fields."""
    most: tuple[int, ...]
    """The greatest value that each of them can have; a greater one is stated as this."""
    members: dict[int, dict[int, IntEnum]]
    """By a value's place in `format`: what its numbers stand for. A packet with another number is dropped."""


@value
class LongStatus(StatusPacket):
    """A status that goes on behind the common part. Each further field names its type on the wire, a letter of `struct`."""

    TAIL: ClassVar[Tail]

    counts: Counts
    """The counts of the newest sample; zeros while `samples` is 0."""
    samples: Annotated[int, "I"]
    """The number of samples that the board has ever taken; the newest record's sequence is one less."""

    def __init_subclass__(cls) -> None:
        hints = get_type_hints(cls, include_extras=True)
        further = {name: hint for name, hint in hints.items() if get_origin(hint) is Annotated}
        letters = [it.__metadata__[0] for it in further.values()]
        members = {
            place: {int(it): it for it in hint.__origin__}
            for place, hint in enumerate(further.values(), len(SENSORS))
            if issubclass(hint.__origin__, IntEnum)
        }
        format = struct.Struct(f"<{COUNT_FIELDS}{''.join(letters)}")
        cls.TAIL = Tail(format, attrgetter(*further), tuple(_MOST[it] for it in letters), members)

    def encode(self) -> bytes:
        further = map(min, self.TAIL.values(self), self.TAIL.most)
        return sealed(self._pack() + self.TAIL.format.pack(*self.counts, *further))

    @classmethod
    def decode_body(cls, body: bytes) -> Self | None:
        if (fields := _fields_of(body, cls.TAIL.format.size)) is None:
            return None
        more = list(cls.TAIL.format.unpack_from(body, cls.FORMAT.size))
        for place, members in cls.TAIL.members.items():
            if (member := members.get(more[place])) is None:
                return None
            more[place] = member
        return cls(*fields, tuple(more[: len(SENSORS)]), *more[len(SENSORS) :])


@value
class AcousticStatus(LongStatus):
    """A status by sound, within a v3 modem's 64 bytes: with the newest sample, and the number of records that wait."""

    VERSION: ClassVar[int] = 2 + LAYOUT
    KIND: ClassVar[Kind] = Kind.ACOUSTIC_STATUS

    waiting: Annotated[int, "H"]
    """Unacknowledged records in its log; 65535 also stands for more."""


@value
class WifiStatus(LongStatus):
    """The full status of a board."""

    VERSION: ClassVar[int] = 2 + LAYOUT
    KIND: ClassVar[Kind] = Kind.WIFI_STATUS

    acknowledged: Annotated[int, "I"]
    """The log's records below this sequence were acknowledged."""
    oldest: Annotated[int, "I"]
    """The log holds the records from this sequence on."""
    overwritten: Annotated[int, "I"]
    """Records that the ring overwrote before they were acknowledged."""
    torn: Annotated[int, "H"]
    """Records that were partly written when a reset came; counts to 65535."""
    reset_cause: Annotated[ResetCause, "B"]
    feed: Annotated[ActiveBattery, "B"]
    """The battery that feeds the board: 0 the primary, 1 the backup, 2 neither."""
    rails: Annotated[int, "H"]
    """The rails that are on, as bits by `Rail`."""
    clock_offset_ms: Annotated[int, "i"]
    """The board's clock minus the last beacon's time, just before the beacon set it: positive if the clock was ahead. A
    boot sets it to 0."""


@dataclass(frozen=True, slots=True)
class ShortStatus:
    """A status within a v2 modem's 7 bytes: agent id, state, and both batteries in steps of 1/255.

    It has neither time nor place: it counts as sent when it is received, and the receiver knows where the aMussel was put.
    The state shares its byte with three bits that identify the packet, which leaves room for the whole CRC-16.
    """

    TAG: ClassVar[int] = 0b101_00000
    FORMAT: ClassVar[struct.Struct] = struct.Struct("<BHBB")
    BYTES: ClassVar[int] = FORMAT.size + 2
    """The size with its check."""

    agent_id: int
    state: State
    primary: float
    secondary: float

    def encode(self) -> bytes:
        return sealed(
            self.FORMAT.pack(
                self.TAG | self.state, self.agent_id, round(self.primary * 255), round(self.secondary * 255)
            )
        )

    @classmethod
    def decode_body(cls, body: bytes) -> ShortStatus | None:
        if len(body) != cls.FORMAT.size or body[0] & 0b111_00000 != cls.TAG:
            return None
        tagged, agent_id, primary, secondary = cls.FORMAT.unpack(body)
        state = STATE_OF.get(tagged & 0b000_11111)
        return None if state is None else cls(agent_id, state, primary / 255, secondary / 255)


class ShownQuantity(NamedTuple):
    """A quantity for people; a journal has a new line once it changed by `step`."""

    text: str
    unit: str
    step: float


@value
class Reported:
    """The newest values of quantities that packets state and nobody estimates; None for one that no packet stated yet.

    A quantity is a number, and has its packets' name for it. Beliefs, checkpoints, the journal, bags, pages and planners
    carry all that stand here.
    """

    depth_m: Annotated[float | None, ShownQuantity("depth", "m", 1.0)] = None

    def after(self, packet: StatusPacket) -> Reported:
        """The values once this packet is received; the same object if none changed, so that nobody compares it."""
        changed = {
            it: stated
            for it in QUANTITIES
            if (stated := getattr(packet, it, None)) is not None and stated != getattr(self, it)
        }
        return replace(self, **changed) if changed else self

    @property
    def stated(self) -> dict[str, float]:
        """The quantities that a packet stated, by name, in the order of `QUANTITIES`."""
        return {it: value for it in QUANTITIES if (value := getattr(self, it)) is not None}


NOTHING_REPORTED = Reported()
QUANTITIES: dict[str, ShownQuantity] = {
    name: hint.__metadata__[0] for name, hint in get_type_hints(Reported, include_extras=True).items()
}
