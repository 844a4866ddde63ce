"""A modem's stimuli and actions. `at_ms` and all times are those of the water that it hangs in."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from agents.modem.frames import ModemFrame
from agents.modem.states import ModemState, ModemTrigger


@dataclass(frozen=True, slots=True)
class SerialBytes:
    """The host wrote these bytes to the serial line without a gap. A modem may have several lines, from 0.

    `paused`: a silence separates them from earlier bytes, and is too long to be within one command.
    """

    data: bytes
    line: int = 0
    paused: bool = False


@dataclass(frozen=True, slots=True)
class FrameRequested:
    """A host without a serial line asked the modem to send this frame. The frame's source is the modem."""

    frame: ModemFrame


@dataclass(frozen=True, slots=True)
class SoundBegan:
    """A frame begins to arrive and keeps the receiver busy for `duration_ms`, whether or not it can be decoded."""

    duration_ms: int


@dataclass(frozen=True, slots=True)
class FrameArrived:
    """A whole frame has arrived. Its sound travelled for `propagation_us`; the arrival is rounded up to a ms.

    The modem corrected `corrected` symbols. `doppler` is as the modem prints it, -999 to 999. `echoes` are the sound's
    other paths, as (microseconds after the direct one, amplitude relative to it).
    """

    frame: ModemFrame
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
    """The receiver's measure of the noise while nobody sends, in its own units of 0 to 999999.

    `peak` is peak to peak, and `mean` the mean magnitude.
    """

    rms: int
    peak: int
    mean: int


@dataclass(frozen=True, slots=True)
class PowerCame:
    """The modem starts and keeps no setting but its address."""


@dataclass(frozen=True, slots=True)
class PowerWent:
    pass


ModemStimulus = (
    SerialBytes
    | FrameRequested
    | SoundBegan
    | FrameArrived
    | SupplyChanged
    | NoiseChanged
    | PowerCame
    | PowerWent
)


class Pin(IntEnum):
    RXS = 0
    """Rises for every frame received, while `$XFE` enables it."""
    RXM = 1
    """Rises for a unicast to this modem, to wake a sleeping microcontroller."""


@dataclass(frozen=True, slots=True)
class SerialOut:
    """The whole answer has left the line at `at_ms`."""

    at_ms: int
    data: bytes
    line: int = 0


@dataclass(frozen=True, slots=True)
class Delivered:
    """Data or a beacon for this modem, reported to a host without a line."""

    at_ms: int
    frame: ModemFrame


@dataclass(frozen=True, slots=True)
class QuestionAnswered:
    """The answer to a requested question: the range in steps of 31.25 us of sound, or None at the time-out."""

    at_ms: int
    question: ModemFrame
    steps: int | None


@dataclass(frozen=True, slots=True)
class EmitFrame:
    """The frame's first sound leaves at `at_ms`."""

    at_ms: int
    frame: ModemFrame


@dataclass(frozen=True, slots=True)
class ModemStateChanged:
    """From now on the modem draws `SUPPLY_UA[new]`."""

    at_ms: int
    old: ModemState
    trigger: ModemTrigger
    new: ModemState


@dataclass(frozen=True, slots=True)
class AddressChanged:
    """The modem takes frames for this address from now on."""

    at_ms: int
    address: int


@dataclass(frozen=True, slots=True)
class PinRose:
    at_ms: int
    pin: Pin


@dataclass(frozen=True, slots=True)
class FrameDropped:
    """The modem discarded a frame or bytes, for this reason. The host counts these."""

    at_ms: int
    reason: str


ModemAction = (
    SerialOut
    | Delivered
    | QuestionAnswered
    | EmitFrame
    | ModemStateChanged
    | AddressChanged
    | PinRose
    | FrameDropped
)
