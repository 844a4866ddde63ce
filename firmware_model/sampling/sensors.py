"""The four sensors as the board reads them: true values of the water become raw counts, and counts become values.

A sensor's calibration is a polynomial from raw counts to its unit. The board stores and sends counts, and a receiver with
the coefficients converts them to values. Neither the paper nor any public text gives the aMussels' own coefficients: these
are ours, plausible for 16-bit converters and for the ranges in a lagoon, and they are data.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from firmware_model.packets.status_packets import Counts

MAX_COUNT = 65535


class Quantity(IntEnum):
    """The measured quantities, in their order in samples and packets."""

    OXYGEN = 0
    """Dissolved oxygen, mg/l."""
    PRESSURE = 1
    """Absolute pressure, mbar."""
    TEMPERATURE = 2
    """Degrees Celsius."""
    TURBIDITY = 3
    """NTU."""


Values = tuple[float, float, float, float]
"""One value for each `Quantity`."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """One sensor. `coefficients` are those of the value's polynomial in the counts, constant first; it must rise.

    Below `low` and above `high` (the sensor's own range, in its unit) it reads as at that end. `noise` is a standard
    deviation in its unit.
    """

    coefficients: tuple[float, ...]
    low: float
    high: float
    noise: float

    def __post_init__(self) -> None:
        if not self.value(0) <= self.low < self.high <= self.value(MAX_COUNT):
            raise ValueError(f"the range {self.low:g} to {self.high:g} is not within what the counts can say")
        if self.noise < 0:
            raise ValueError("noise must not be negative")

    def value(self, count: int) -> float:
        """The value of `count`, in the sensor's unit."""
        value = 0.0
        for coefficient in reversed(self.coefficients):
            value = value * count + coefficient
        return value

    def count(self, value: float) -> int:
        """The count nearest to a value within the range; the lower of two equally near ones."""
        below, above = 0, MAX_COUNT
        while above - below > 1:
            middle = (below + above) // 2
            if self.value(middle) <= value:
                below = middle
            else:
                above = middle
        return below if value - self.value(below) <= self.value(above) - value else above

    def read(self, true_value: float, unit_noise: float) -> tuple[int, bool]:
        """The raw count, and True if the reading was outside the range. `unit_noise` has mean 0 and variance 1."""
        reading = true_value + self.noise * unit_noise
        if not self.low <= reading <= self.high:
            return self.count(self.low if reading < self.low else self.high), True
        return self.count(reading), False


SENSORS: tuple[Sensor, Sensor, Sensor, Sensor] = (
    # An optode is steeper near saturation: hence a square term. Its range is twice the saturation of water at 10 C.
    Sensor((0.0, 2.4e-4, 1.2e-9), low=0.0, high=20.0, noise=0.05),
    # 0.1 mbar, that is a millimetre of water, down to 50 m.
    Sensor((500.0, 0.1), low=600.0, high=6500.0, noise=0.5),
    Sensor((-10.0, 0.001), low=-5.0, high=45.0, noise=0.01),
    # Scattered light grows more slowly than the turbidity.
    Sensor((0.0, 0.012, 6e-8), low=0.0, high=1000.0, noise=0.4),
)
"""One sensor for each `Quantity`."""


def sample(sensors: tuple[Sensor, ...], true_values: Values, unit_noises: Values) -> tuple[Counts, int]:
    """Reads all sensors: the counts, and a bit by `Quantity` for each sensor outside its range."""
    counts = [0, 0, 0, 0]
    saturated = 0
    for quantity, sensor in enumerate(sensors):
        counts[quantity], outside = sensor.read(true_values[quantity], unit_noises[quantity])
        saturated |= outside << quantity
    oxygen, pressure, temperature, turbidity = counts
    return (oxygen, pressure, temperature, turbidity), saturated


def values(sensors: tuple[Sensor, ...], counts: Counts) -> Values:
    """The values of a sample's counts."""
    oxygen, pressure, temperature, turbidity = (
        sensor.value(count) for sensor, count in zip(sensors, counts, strict=True)
    )
    return oxygen, pressure, temperature, turbidity
