"""The range and the packet loss of Wi-Fi just above the waves. Metres and dB.

The path loss is the greater of free space (Friis), which counts near by, and two rays over a flat sea, which count far
off and depend on both antennas' heights: 40 log10(d) - 20 log10(h1 h2). The probability of delivery is the logistic
function of the margin above the receiver's sensitivity.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, log10

from agents.water.bounds import Decibels, PositiveNumber
from agents.water.packet_draws import fates

_LANE = b"wifi"
_LIGHT_M_S = 299_792_458.0


@dataclass(frozen=True, slots=True)
class Wifi:
    """The radio, the same kind on both sides. A scenario's block `wifi`; half of all packets arrive where the path leaves
    `sensitivity_dbm`."""

    frequency_mhz: PositiveNumber = 2440.0
    """Frequency of the radios."""
    transmit_dbm: Decibels = 20.0
    """Level of both."""
    sensitivity_dbm: Decibels = -85.0
    """The level at which half of all packets arrive."""
    mussel_antenna_m: PositiveNumber = 0.05
    """Height of a floating aMussel's antenna above the water."""
    apad_antenna_m: PositiveNumber = 1.5
    """Height of the aPad's antenna above the water."""
    slope_db: PositiveNumber = 1.5
    """A change of the margin by this changes the odds of a packet e-fold."""

    def __post_init__(self) -> None:
        for name in ("frequency_mhz", "mussel_antenna_m", "apad_antenna_m", "slope_db"):
            if not 0 < getattr(self, name) < inf:
                raise ValueError(f"{name} must be positive")

    def path_loss_db(self, distance_m: float) -> float:
        metres = max(1.0, distance_m)
        friis = 20 * log10(metres) + 20 * log10(4e6 * 3.141592653589793 * self.frequency_mhz / _LIGHT_M_S)
        two_rays = 40 * log10(metres) - 20 * log10(self.mussel_antenna_m * self.apad_antenna_m)
        return max(friis, two_rays)

    def delivery(self, distance_m: float) -> float:
        """The probability that a packet gets through."""
        margin_db = self.transmit_dbm - self.path_loss_db(distance_m) - self.sensitivity_dbm
        return 1 / (1 + exp(min(700.0, -margin_db / self.slope_db)))

    def gets_through(self, distance_m: float, seed: int, sender: int, at_ms: int, receiver: int) -> bool:
        """True if the packet that `sender` begins at agent time `at_ms` gets through."""
        return fates(seed, sender, at_ms, receiver, _LANE)[0] < self.delivery(distance_m)
