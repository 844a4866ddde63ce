"""What reaches a modem, and what it does. `at_ms` and all times are those of the water that it hangs in."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from agents.modem.frames import Frame
from agents.modem.states import ModemState, Trigger


@dataclass(frozen=True, slots=True)
class SerialBytes:
    """Somebody wrote these to the serial line, one right after the other. A modem may have several lines, from 0.

    `paused`: whatever was written before, there was too long a silence in between.
    """

    data: bytes
    line: int = 0
    paused: bool = False


@dataclass(frozen=True, slots=True)
class Asked:
    """A host that has no serial line between it and the modem wants this frame sent, whose source is the modem."""

    frame: Frame


@dataclass(frozen=True, slots=True)
class SoundBegan:
    """A frame begins to arrive, and will take so long: the receiver is busy with it, whatever comes of it."""

    duration_ms: int


@dataclass(frozen=True, slots=True)
class FrameArrived:
    """A frame has arrived whole. `propagation_us` is how long its sound travelled; the arrival is rounded up to a ms.

    `corrected` symbols were mended, `doppler` is as the modem prints it, -999 to 999; `echoes` are other ways that the
    sound came, as (microseconds after the direct one, amplitude relative to it).
    """

    frame: Frame
    propagation_us: int = 0
    snr_db: float = 20.0
    corrected: int = 0
    doppler: int = 0
    echoes: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, slots=True)
class SupplyChanged:
    """The voltage at the modem's supply."""

    supply_mv: int


@dataclass(frozen=True, slots=True)
class NoiseChanged:
    """What the receiver measures where nothing is sent, in its own units of 0 to 999999."""

    rms: int
    peak: int
    mean: int


@dataclass(frozen=True, slots=True)
class PowerCame:
    """The modem starts: of all that it was told only its address is kept."""


@dataclass(frozen=True, slots=True)
class PowerWent:
    pass


Stimulus = (
    SerialBytes | Asked | SoundBegan | FrameArrived | SupplyChanged | NoiseChanged | PowerCame | PowerWent
)


class Pin(IntEnum):
    RXS = 0
    """Rises for any frame that is heard, while it is enabled by `$XFE`."""
    RXM = 1
    """Rises for a unicast to this modem: what wakes a microcontroller that sleeps."""


@dataclass(frozen=True, slots=True)
class SerialOut:
    """The whole answer has left the line at `at_ms`."""

    at_ms: int
    data: bytes
    line: int = 0


@dataclass(frozen=True, slots=True)
class Delivered:
    """Data or a beacon for this modem, told to the host that has no line."""

    at_ms: int
    frame: Frame


@dataclass(frozen=True, slots=True)
class Answered:
    """What came of a question that was `Asked`: the range in steps of 31.25 us of sound, or None by the time-out."""

    at_ms: int
    asked: Frame
    steps: int | None


@dataclass(frozen=True, slots=True)
class EmitFrame:
    """The frame's first sound leaves at `at_ms`."""

    at_ms: int
    frame: Frame


@dataclass(frozen=True, slots=True)
class StateChanged:
    """What it draws from now on is `SUPPLY_UA[new]`."""

    at_ms: int
    old: ModemState
    trigger: Trigger
    new: ModemState


@dataclass(frozen=True, slots=True)
class PinRose:
    at_ms: int
    pin: Pin


@dataclass(frozen=True, slots=True)
class Dropped:
    """A frame or bytes that came to nothing, and why; counted by the host."""

    at_ms: int
    reason: str


Action = SerialOut | Delivered | Answered | EmitFrame | StateChanged | PinRose | Dropped
