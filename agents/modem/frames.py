"""The frames that nanomodems send through the water, with an exact length in time.

A frame is on the air from its start to its end and acts at its END. Durations follow the manual of the V3 modem: a chirp
of 30 ms, a header of 75 ms, and for data (n + 16) x 12.5 ms more. An odd n would end on half a millisecond and is rounded
up, so that no frame acts before it has arrived. For V2 only 40 bit/s and 7 bytes are public: its 30 ms chirp and a header
of two bytes are assumed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum

ADDRESSES = 256


class ModemGeneration(StrEnum):
    """`v3`: today's nanomodem, 64 bytes. `v2`: that of the early swarm, about 2016 to 2018, 7 bytes at 40 bit/s. They do
    not understand each other."""

    V2 = "v2"
    V3 = "v3"


class FrameKind(IntEnum):
    BROADCAST = 0
    UNICAST = 1
    UNICAST_ACKED = 2
    ACK = 3
    PING = 4
    PING_REPLY = 5
    STATUS_REQUEST = 6
    """Asks for voltage and noise; the answer is a broadcast."""
    TEST_REQUEST = 7
    """Asks for a text of 64 bytes; the answer is a broadcast."""
    ECHO_REQUEST = 8
    """Asks for the same bytes back; the answer is a broadcast."""
    BEACON = 9
    PROBE = 10
    """Asks for a PROBE_REPLY, from which the asking modem takes the channel's impulse response."""
    PROBE_REPLY = 11


WITH_DATA = frozenset(
    {FrameKind.BROADCAST, FrameKind.UNICAST, FrameKind.UNICAST_ACKED, FrameKind.ECHO_REQUEST}
)
TO_ALL = frozenset({FrameKind.BROADCAST, FrameKind.BEACON})
"""Kinds for every modem in range; all others have one destination."""
ANSWERS = frozenset({FrameKind.ACK, FrameKind.PING_REPLY, FrameKind.PROBE_REPLY})
V2_KINDS = frozenset(
    {
        FrameKind.BROADCAST,
        FrameKind.UNICAST,
        FrameKind.PING,
        FrameKind.PING_REPLY,
        FrameKind.STATUS_REQUEST,
    }
)

PAYLOAD_BYTES = {ModemGeneration.V2: (1, 7), ModemGeneration.V3: (2, 64)}
"""The fewest and the most bytes of data in a frame."""

SHORT_MS = {ModemGeneration.V2: 430, ModemGeneration.V3: 105}
"""A frame without data: chirp and header."""
_V2_BYTE_MS = 200  # 8 bit at 40 bit/s


@dataclass(frozen=True, slots=True)
class ModemFrame:
    """One transmission. `source` and `destination` are modems' addresses, 0 to 255; kinds to all have no `destination`.

    Only answers have `flight_us`, the travel time of the question's sound. A modem measures the round trip in steps of
    62.5 us, finer than this model's milliseconds, so the answer brings the outward travel time back.

    A unicast does not carry its sender's address: `source` serves the medium and the records, not the receiver.
    """

    kind: FrameKind
    source: int
    destination: int | None = None
    data: bytes = b""
    generation: ModemGeneration = ModemGeneration.V3
    flight_us: int = 0

    def __post_init__(self) -> None:
        addresses = (self.source,) if self.destination is None else (self.source, self.destination)
        if not all(0 <= address < ADDRESSES for address in addresses):
            raise ValueError(f"an address is 0 to 255, not {self.source} or {self.destination}")
        if (self.destination is None) != (self.kind in TO_ALL):
            raise ValueError(f"a {self.kind.name} to {self.destination}")
        if self.generation is ModemGeneration.V2 and self.kind not in V2_KINDS:
            raise ValueError(f"V2 has no {self.kind.name}")
        fewest, most = PAYLOAD_BYTES[self.generation] if self.kind in WITH_DATA else (0, 0)
        if not fewest <= len(self.data) <= most:
            raise ValueError(f"a {self.kind.name} of {len(self.data)} bytes: {fewest} to {most} can be sent")
        if self.flight_us and self.kind not in ANSWERS:
            raise ValueError(f"a {self.kind.name} answers nothing")

    @property
    def duration_ms(self) -> int:
        """From the first sound to the last."""
        return duration_ms(self.generation, len(self.data))

    def is_for(self, address: int) -> bool:
        """True if a modem with this address takes the frame."""
        return self.destination is None or self.destination == address


def duration_ms(generation: ModemGeneration, payload_bytes: int) -> int:
    """The length of a frame with this much data; 0 bytes is a frame without data."""
    short_ms = SHORT_MS[generation]
    if payload_bytes == 0:
        return short_ms
    if generation is ModemGeneration.V2:
        return short_ms + payload_bytes * _V2_BYTE_MS
    return short_ms + ((payload_bytes + 16) * 25 + 1) // 2
