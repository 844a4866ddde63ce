"""The water's effect on a modem's sound: travel time, level at the receiver, and packet error rate.

Levels are dB re 1 uPa, distances metres, times milliseconds unless a name says microseconds. Defaults are the published
figures of the Newcastle nanomodem V3 at 28 kHz; a pool or a harbour has its own.
`agents/modem/frames.py` has the length of a frame.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from math import exp, fsum, inf, log, log10
from typing import Annotated

from annotated_types import Ge, Gt, Le

from agents.water.bounds import Count, Decibels, NotNegative, OpenFraction, PositiveNumber

_CERTAIN = 700
"""Log odds beyond which the exponential overflows a float."""
_STEP_US = 62.5
"""The step of the timer with which the modem measures a round trip."""
SPHERICAL_DB = 20.0
"""Loss by spreading per tenfold distance in open water; 15 is the practical mean of shallow water, 10 cylindrical."""
THORP_KHZ = (0.1, 50.0)
"""The range of Thorp's formula."""


def thorp_db_per_km(frequency_khz: float) -> float:
    """Absorption of sea water by Thorp's formula (Thorp 1967, in kHz and km, with the constant term of Urick's book).

    It was fitted for 0.1 to 50 kHz, to water of about 4 degrees at about a kilometre's depth. It is not the formula of
    Fisher and Simmons (1977), which has temperature and depth.
    """
    squared = frequency_khz**2
    return 0.11 * squared / (1 + squared) + 44 * squared / (4100 + squared) + 2.75e-4 * squared + 0.003


@dataclass(frozen=True, slots=True)
class SeaWater:
    """The water that decides the speed of sound. A scenario's block `sea_water`, in the range of Mackenzie's formula."""

    temperature_c: Annotated[float, Ge(2), Le(30)]
    """Its temperature."""
    salinity_psu: Annotated[float, Ge(25), Le(40)]
    """Its salinity, in parts of a thousand."""
    depth_m: Annotated[float, Ge(0), Le(8000)] = 0.0
    """The depth for the formula."""

    @property
    def sound_speed_m_s(self) -> float:
        """Mackenzie's nine terms (J. Acoust. Soc. Am. 70, 1981, 807), within 0.07 m/s in their range."""
        t, s, d = self.temperature_c, self.salinity_psu - 35, self.depth_m
        warm = 4.591 * t - 5.304e-2 * t**2 + 2.374e-4 * t**3
        deep = 1.630e-2 * d + 1.675e-7 * d**2 - 7.139e-13 * t * d**3
        return 1448.96 + warm + 1.340 * s - 1.025e-2 * t * s + deep


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """Packet error rate against SNR, for some sizes of payload. A scenario's block `error_curve`.

    `rates[i][j]` is the rate of `sizes[i]` bytes at `snrs_db[j]`; rates lie within (0, 1), sizes and SNRs rise. The log
    odds are linear in the SNR between two points, and linear in the logarithm of the size between two sizes. Beyond the
    first and the last SNR they continue with the mean slope of all sizes there, so that a longer packet is never safer.
    A payload beyond the sizes counts as the nearest size.
    """

    snrs_db: tuple[Decibels, ...]
    """The points, rising."""
    sizes: tuple[Count, ...]
    """Bytes of payload, rising."""
    rates: tuple[tuple[OpenFraction, ...], ...]
    """For each size the packet error rate at each point, between 0 and 1."""

    def __post_init__(self) -> None:
        if len(self.snrs_db) < 2 or list(self.snrs_db) != sorted(set(self.snrs_db)):
            raise ValueError("snrs_db must be two or more, and rise")
        if not self.sizes or self.sizes[0] < 1 or list(self.sizes) != sorted(set(self.sizes)):
            raise ValueError("sizes must be positive, and rise")
        if len(self.rates) != len(self.sizes) or any(len(row) != len(self.snrs_db) for row in self.rates):
            raise ValueError("rates must have a row for each size, with a rate for each SNR")
        if not all(0 < rate < 1 for row in self.rates for rate in row):
            raise ValueError("rates must lie between 0 and 1, both excluded")

    def probability(self, snr_db: float, payload_bytes: int) -> float:
        """The probability that a packet with so much data is lost. A frame without data counts as the smallest size."""
        if snr_db == inf:
            return 0.0
        size = min(max(payload_bytes, self.sizes[0]), self.sizes[-1])
        above = min(bisect_right(self.sizes, size), len(self.sizes) - 1)
        below = max(0, above - 1)
        odds = self._log_odds(snr_db, above)
        if above != below:
            share = log(size / self.sizes[below]) / log(self.sizes[above] / self.sizes[below])
            odds = share * odds + (1 - share) * self._log_odds(snr_db, below)
        return 1 / (1 + exp(-odds)) if odds > -_CERTAIN else 0.0

    def _log_odds(self, snr_db: float, which: int) -> float:
        snrs = self.snrs_db
        if snr_db < snrs[0]:
            return _odds(self.rates[which][0]) + self._slope(0) * (snr_db - snrs[0])
        if snr_db > snrs[-1]:
            return _odds(self.rates[which][-1]) + self._slope(len(snrs) - 2) * (snr_db - snrs[-1])
        low = min(bisect_right(snrs, snr_db), len(snrs) - 1) - 1
        first, second = _odds(self.rates[which][low]), _odds(self.rates[which][low + 1])
        return first + (second - first) * (snr_db - snrs[low]) / (snrs[low + 1] - snrs[low])

    def _slope(self, low: int) -> float:
        """The slope of the log odds per dB, from point `low` to the next, as a mean of all sizes."""
        rises = fsum(_odds(row[low + 1]) - _odds(row[low]) for row in self.rates)
        return rises / len(self.rates) / (self.snrs_db[low + 1] - self.snrs_db[low])


def _odds(rate: float) -> float:
    return log(rate / (1 - rate))


NANOMODEM_ERRORS = ErrorCurve(
    snrs_db=(-1, 0, 1, 2, 3, 4, 5, 6),
    sizes=(16, 32, 64),
    rates=(
        (0.412, 0.161, 0.047, 0.015, 0.006, 0.003, 0.001, 0.001),
        (0.804, 0.553, 0.245, 0.089, 0.020, 0.010, 0.003, 0.001),
        (0.984, 0.932, 0.793, 0.483, 0.217, 0.068, 0.020, 0.007),
    ),
)
"""Error rates in harsh multipath, from the simulator of the modem's makers."""


@dataclass(frozen=True)  # without slots, because what follows from the fields is kept
class Sound:
    """The modems and the water between them: the block `sound` of a scenario, and the sea that it makes.

    The defaults are the nanomodem's own figures and open sea.
    """

    sound_speed_m_s: Annotated[float, Ge(1000), Le(2000)] = 1500.0
    """With `sea_water` that of its formula instead."""
    source_level_db: Annotated[float, Gt(0), Le(300)] = 168.0
    """Level of every modem, at 1 m."""
    spreading_db: Annotated[float, Ge(0), Le(60)] = SPHERICAL_DB
    """Loss per tenfold distance: 20 open water, 15 shallow, 10 between two mirrors."""
    absorption_db_per_km: NotNegative | None = None
    """None: Thorp's formula at `frequency_khz`, which must then lie in 0.1 to 50 kHz."""
    frequency_khz: Annotated[float, Gt(0), Le(1000)] = 28.0
    """Frequency of the modems."""
    noise_db_per_hz: Annotated[float, Ge(-200), Le(200)] = 50.0
    """Ambient noise, re 1 uPa^2/Hz."""
    bandwidth_hz: PositiveNumber = 8000.0
    """The noise counts over this."""
    fading_db: NotNegative = 0.0
    """Multipath: standard deviation of each packet's own gain at each receiver."""
    reverberation_s: NotNegative = 0.0
    """A packet's echoes disturb others for so long after its end, in agent time."""
    reverberation_db: NotNegative = 10.0
    """Echoes are weaker than their packet by so much."""
    capture_db: Annotated[float, Ge(0), Le(300)] = 6.0
    """A packet survives others that overlap it if it is louder by so much than all of them together."""
    thruster_noise_db: NotNegative = 20.0
    """Running thrusters raise the noise at their own vehicle's modem by so much."""
    thrusting_m_s: NotNegative = 0.1
    """The thrusters of an aPad that moves faster are running."""
    range_limit_m: PositiveNumber = 5000.0
    """The model follows sound no further, neither as a packet nor as a disturbance."""
    turnaround_s: NotNegative = 0.0
    """The agent time from the end of a modem's own sound until it can receive again."""
    keel_m: PositiveNumber = 0.5
    """The depth of the aPad's modem."""
    range_noise_m: NotNegative = 0.1
    """Standard deviation of a measured range."""
    error_curve: ErrorCurve | None = None
    """None: the nanomodem's own, in harsh multipath."""
    sea_water: SeaWater | None = None
    """The water from which Mackenzie's formula (1981) gives the speed of sound. None: `sound_speed_m_s` stands."""

    def __post_init__(self) -> None:
        if self.sea_water is not None:
            object.__setattr__(self, "sound_speed_m_s", self.sea_water.sound_speed_m_s)
        for name in ("sound_speed_m_s", "frequency_khz", "bandwidth_hz", "range_limit_m"):
            if not 0 < getattr(self, name) < inf:
                raise ValueError(f"{name} must be positive")
        not_negative = ("spreading_db", "fading_db", "reverberation_s", "reverberation_db", "turnaround_s")
        for name in (*not_negative, "thruster_noise_db", "range_noise_m"):
            if not 0 <= getattr(self, name) < inf:
                raise ValueError(f"{name} must not be negative")
        if self.absorption_db_per_km is None and not THORP_KHZ[0] <= self.frequency_khz <= THORP_KHZ[1]:
            raise ValueError(
                f"Thorp's formula holds from {THORP_KHZ[0]:g} to {THORP_KHZ[1]:g} kHz: state absorption_db_per_km"
            )
        if not 0 <= self.absorption < inf:
            raise ValueError("absorption_db_per_km must not be negative")
        for name in ("reverberation_s", "turnaround_s"):
            if abs(getattr(self, name) * 1000 - round(getattr(self, name) * 1000)) > 1e-6:
                raise ValueError(f"{name} must be a whole number of milliseconds")

    @cached_property
    def absorption(self) -> float:
        """In dB per km."""
        if self.absorption_db_per_km is None:
            return thorp_db_per_km(self.frequency_khz)
        return self.absorption_db_per_km

    @cached_property
    def errors(self) -> ErrorCurve:
        return self.error_curve or NANOMODEM_ERRORS

    @cached_property
    def reverberation_ms(self) -> int:
        return round(self.reverberation_s * 1000)

    @cached_property
    def turnaround_ms(self) -> int:
        return round(self.turnaround_s * 1000)

    @property
    def keel_um(self) -> int:
        return round(self.keel_m * 1e6)

    @property
    def noise_db(self) -> float:
        """Noise level over the modem's band."""
        return self.noise_db_per_hz + 10 * log10(self.bandwidth_hz)

    def level_db(self, distance_m: float) -> float:
        """Level at this distance from a sender; nearer than 1 m it is the source level."""
        metres = max(1.0, distance_m)
        return self.source_level_db - self.spreading_db * log10(metres) - self.absorption * metres / 1000

    def snr_db(self, distance_m: float) -> float:
        """Without fading and thrusters."""
        return self.level_db(distance_m) - self.noise_db

    def delay_us(self, distance_m: float) -> int:
        return round(1e6 * distance_m / self.sound_speed_m_s)

    def range_m(self, round_trip_us: int, off_m: float) -> float:
        """The range that a modem measures from a round trip with the error `off_m`, in whole steps of its timer."""
        step_m = _STEP_US * self.sound_speed_m_s / 2e6
        return max(0, round((round_trip_us * self.sound_speed_m_s / 2e6 + off_m) / step_m)) * step_m
