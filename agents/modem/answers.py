"""A modem's printed answers, byte for byte. Each ends in CR LF; before that a result may hold any byte."""

from __future__ import annotations

import re
import struct
from binascii import crc32, crc_hqx

from agents.modem.facts import NoiseChanged
from agents.modem.frames import ModemGeneration
from agents.modem.modem_model import BUILT, RELEASE, ModemFirmware, voltage_steps

ERROR = b"E\r\n"
TIME_OUT = b"#TO\r\n"
FOUND = re.compile(rb"#R(\d{3})T(\d{5})")
"""Address and steps, as `found` prints them."""
TEST_TEXT = b"musselbed nanomodem: 64 bytes, sent because $Txxx asked for them"
HELP = (
    b"musselbed nanomodem, NM3 serial commands:\r\n"
    b"$? $Axxx $Bnn<data> $Uxxxnn<data> $Mxxxnn<data> $Pxxx $Vxxx $Txxx $Exxxnn<data> $F\r\n"
    b"$CMxxx $CCxxx $D $H $R $Q $N $S $XQE $XQD $XTE $XTD $XTC $XTG $XFE $XFD $Z $W\r\n"
)
SPECTRUM_BINS = 257
IMPULSE_STEPS = 128
"""Samples of a channel impulse response, one each 62.5 us. This number is our own choice."""
_IMPULSE_STEP_US = 62.5
_UNITY = 50_000
"""The word for an amplitude of 1.0 in an impulse response, by the makers' driver."""
_MOST_UNSIGNED, _MOST_SIGNED = 65_535, 32_767


def line(text: str) -> bytes:
    return text.encode("ascii") + b"\r\n"


def acknowledgement(generation: ModemGeneration, command: str) -> bytes:
    """The local acknowledgement of a command that sends sound; V2 begins it with `#`."""
    return line(("#" if generation is ModemGeneration.V2 else "$") + command)


def status(firmware: ModemFirmware, address: int, supply_mv: int) -> bytes:
    own = f"#A{address:03}V{voltage_steps(firmware, supply_mv):05}"
    return line(f"{own}R{RELEASE}B{BUILT}" if firmware is ModemFirmware.V3 else own)


def length(generation: ModemGeneration, data: bytes) -> str:
    return f"{len(data):01}" if generation is ModemGeneration.V2 else f"{len(data):02}"


def broadcast(generation: ModemGeneration, source: int, data: bytes, appended: str) -> bytes:
    return f"#B{source:03}{length(generation, data)}".encode() + data + line(appended)


def unicast(generation: ModemGeneration, data: bytes, appended: str) -> bytes:
    return f"#U{length(generation, data)}".encode() + data + line(appended)


def quality(snr_db: float, doppler: int) -> str:
    """`QzzD+-ddd`. The scale of zz is not public: here it is the SNR in whole dB, 0 to 99."""
    return f"Q{min(99, max(0, round(snr_db))):02}D{min(999, max(-999, doppler)):+04}"


def timestamp(timer_us: int) -> str:
    return f"T{timer_us % 10**14:014}"


def found(address: int, steps: int) -> bytes:
    """The result of `$P` and `$M`."""
    return line(f"#R{address:03}T{steps:05}")


def noise(noise: NoiseChanged) -> str:
    return f"R{noise.rms:06}P{noise.peak:06}M{noise.mean:06}"


def remote_report(firmware: ModemFirmware, supply_mv: int, measured: NoiseChanged) -> bytes:
    """The data of the broadcast that answers `$Vxxx`: voltage, and with firmware 1.6 the noise."""
    volts = f"V{voltage_steps(firmware, supply_mv):05}"
    return (volts + noise(measured) if firmware is ModemFirmware.V3 else volts).encode()


def measured(name: str, measured: NoiseChanged) -> bytes:
    """The result of `$N` or `$S`. A spectrum is flat at the mean, because the model's noise has no colour."""
    if name == "N":
        return line("#N" + noise(measured))
    bins = struct.pack(f"<{SPECTRUM_BINS}H", *[min(_MOST_UNSIGNED, measured.mean)] * SPECTRUM_BINS)
    return f"#S{SPECTRUM_BINS:05}".encode() + bins + b"\r\n"


def impulse_response(name: str, address: int, steps: int, echoes: tuple[tuple[int, float], ...]) -> bytes:
    """`#CMxxxTtttttLzzzzz<words>`: the direct sound first, and each echo at its delay, as parts of the direct sound.

    The words of `$CM` are magnitudes, uint16. Those of `$CC` are complex, int16: the real and the imaginary part in turn.
    There 1.0 is cut to the largest word. An echo of the model has a sign and no other phase, so imaginary parts are 0.
    """
    taps = [1.0] + [0.0] * (IMPULSE_STEPS - 1)
    for after_us, relative in echoes:
        at = round(after_us / _IMPULSE_STEP_US)
        if 0 <= at < IMPULSE_STEPS:
            taps[at] = max(taps[at], relative, key=abs)
    if name == "CM":
        words = [min(_MOST_UNSIGNED, round(abs(tap) * _UNITY)) for tap in taps]
    else:
        real = [max(-_MOST_SIGNED, min(_MOST_SIGNED, round(tap * _UNITY))) for tap in taps]
        words = [word for pair in zip(real, [0] * IMPULSE_STEPS, strict=True) for word in pair]
    head = f"#{name}{address:03}T{steps:05}L{len(words):05}"
    return head.encode() + struct.pack(f"<{len(words)}{'H' if name == 'CM' else 'h'}", *words) + b"\r\n"


def identity(unique_id: int) -> bytes:
    """The chip's serial number, and addresses of 8 to 32 bits derived from it; a real modem's method is not public."""
    serial = unique_id.to_bytes(12, "big")
    whole, short = crc32(serial), crc_hqx(serial, 0xFFFF)
    a8, a24 = short & 0xFF, whole & 0xFF_FFFF
    return line(f"#DID:0x{serial.hex().upper()}-A8{a8:03}-A16{short:05}-A24{a24:08}-A32{whole:010}")
