"""One sensor: its true value becomes a raw count, and a count becomes a value.

It stands apart from the table of all sensors, which loads those of packages: a package's module imports this one alone.
"""

from __future__ import annotations

from dataclasses import dataclass

MAX_COUNT = 65535


@dataclass(frozen=True, slots=True)
class Sensor:
    """One sensor. `coefficients` are those of the value's polynomial in the counts, constant first; it must rise.

    Below `low` and above `high` (the sensor's own range, in its unit) it reads as at that end. `noise` is a standard
    deviation in its unit. `calm` is the value of a calm bay, where a scenario says nothing else; None for a quantity that
    follows from the depth (`agents.water.fields.BY_DEPTH`).
    """

    name: str
    unit: str
    """The unit as in a key: `mg_l`."""
    coefficients: tuple[float, ...]
    low: float
    high: float
    noise: float
    calm: float | None
    load_mw: float
    """Its assumed load while it is on."""
    load_source: str = "a sensor of this class"

    def __post_init__(self) -> None:
        if not self.value(0) <= self.low < self.high <= self.value(MAX_COUNT):
            raise ValueError(f"the range {self.low:g} to {self.high:g} is not within what the counts can say")
        if self.noise < 0 or self.load_mw < 0:
            raise ValueError("noise and load must not be negative")

    @property
    def key(self) -> str:
        """The name of its values in scenarios and in samples.jsonl."""
        return f"{self.name}_{self.unit}"

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
