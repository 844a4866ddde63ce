"""What nanomodems send through the water: frames with an exact length in time.

A frame is on the air from its start to its end and acts at its END. Durations are those of the manual of the V3 modem: a
chirp of 30 ms and a header of 75 ms, and for data (n + 16) x 12.5 ms more; odd n would end on half a millisecond and are
rounded up, so that nothing acts before it has arrived. For V2 40 bit/s and 7 bytes are all that is public: its 30 ms chirp
and a header of two bytes are assumed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

ADDRESSES = 256


class Generation(IntEnum):
    """V2 is the modem of about 2016 to 2018, V3 that of today; they do not understand each other."""

    V2 = 2
    V3 = 3


class FrameKind(IntEnum):
    BROADCAST = 0
    UNICAST = 1
    UNICAST_ACKED = 2
    ACK = 3
    PING = 4
    PING_REPLY = 5
    STATUS_REQUEST = 6
    """Asks for voltage and noise, which come as a broadcast."""
    TEST_REQUEST = 7
    """Asks for a text of 64 bytes, as a broadcast."""
    ECHO_REQUEST = 8
    """Asks to send the same bytes back, as a broadcast."""
    BEACON = 9
    PROBE = 10
    """Asks for a PROBE_REPLY, of which the asker takes the channel's impulse response."""
    PROBE_REPLY = 11


WITH_DATA = frozenset(
    {FrameKind.BROADCAST, FrameKind.UNICAST, FrameKind.UNICAST_ACKED, FrameKind.ECHO_REQUEST}
)
TO_ALL = frozenset({FrameKind.BROADCAST, FrameKind.BEACON})
"""Kinds that every modem in range takes; all others have one destination."""
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

PAYLOAD_BYTES = {Generation.V2: (1, 7), Generation.V3: (2, 64)}
"""The fewest and the most bytes of data that a frame carries."""

SHORT_MS = {Generation.V2: 430, Generation.V3: 105}
"""Chirp and header: all of a frame without data."""
_V2_BYTE_MS = 200  # 8 bit at 40 bit/s


@dataclass(frozen=True, slots=True)
class Frame:
    """One transmission. `source` and `destination` are modems' addresses, 0 to 255; `destination` is None for kinds to all.

    `flight_us` is of answers only: how long the question's sound travelled. A modem measures the round trip in steps of
    62.5 us, finer than this house's milliseconds, so the way out comes back with the answer.

    A unicast does not say on the air who sent it: its `source` is for the medium and for records, not for the receiver.
    """

    kind: FrameKind
    source: int
    destination: int | None = None
    data: bytes = b""
    generation: Generation = Generation.V3
    flight_us: int = 0

    def __post_init__(self) -> None:
        addresses = (self.source,) if self.destination is None else (self.source, self.destination)
        if not all(0 <= address < ADDRESSES for address in addresses):
            raise ValueError(f"an address is 0 to 255, not {self.source} or {self.destination}")
        if (self.destination is None) != (self.kind in TO_ALL):
            raise ValueError(f"a {self.kind.name} to {self.destination}")
        if self.generation is Generation.V2 and self.kind not in V2_KINDS:
            raise ValueError(f"V2 has no {self.kind.name}")
        fewest, most = PAYLOAD_BYTES[self.generation] if self.kind in WITH_DATA else (0, 0)
        if not fewest <= len(self.data) <= most:
            raise ValueError(f"a {self.kind.name} of {len(self.data)} bytes: {fewest} to {most} can be sent")
        if self.flight_us and self.kind not in ANSWERS:
            raise ValueError(f"a {self.kind.name} answers nothing")

    @property
    def duration_ms(self) -> int:
        """From its first sound to its last."""
        return duration_ms(self.generation, len(self.data))

    def is_for(self, address: int) -> bool:
        """Whether a modem with this address takes it."""
        return self.destination is None or self.destination == address


def duration_ms(generation: Generation, payload_bytes: int) -> int:
    """How long a frame with so much data lasts; 0 bytes is a frame without data."""
    short_ms = SHORT_MS[generation]
    if payload_bytes == 0:
        return short_ms
    if generation is Generation.V2:
        return short_ms + payload_bytes * _V2_BYTE_MS
    return short_ms + ((payload_bytes + 16) * 25 + 1) // 2
