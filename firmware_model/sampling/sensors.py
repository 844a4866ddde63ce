"""The table of the board's sensors, `SENSORS`: true values of the water become raw counts, and counts become values.

A sensor's calibration is a polynomial from raw counts to its unit. The board stores and sends counts, and a receiver with
the coefficients converts them to values. Neither the paper nor any public text gives the aMussels' own coefficients: these
are ours, plausible for 16-bit converters and for the ranges in a lagoon, and they are data.

Records, packets, the water's fields, the loads of a board, and the keys of scenarios and of samples.jsonl follow the
table, and so does `firmware_model.power.rails.Rail`: docs/packets.md.
"""

from __future__ import annotations

from dataclasses import dataclass

MAX_COUNT = 65535

Counts = tuple[int, ...]
"""The raw count of each sensor, in the order of `SENSORS`."""
Values = tuple[float, ...]
"""A value for each sensor, in the order of `SENSORS`."""


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
        if self.noise < 0:
            raise ValueError("noise must not be negative")

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


SENSORS = (
    # An optode is steeper near saturation: hence a square term. Its range is twice the saturation of water at 10 C.
    Sensor(
        "oxygen",
        "mg_l",
        (0.0, 2.4e-4, 1.2e-9),
        low=0.0,
        high=20.0,
        noise=0.05,
        calm=8.0,
        load_mw=100,
        load_source="an optode of this class",
    ),
    # 0.1 mbar, that is a millimetre of water, down to 50 m. The pressure is absolute.
    Sensor("pressure", "mbar", (500.0, 0.1), low=600.0, high=6500.0, noise=0.5, calm=None, load_mw=5),
    Sensor("temperature", "c", (-10.0, 0.001), low=-5.0, high=45.0, noise=0.01, calm=18.0, load_mw=5),
    # Scattered light grows more slowly than the turbidity.
    Sensor("turbidity", "ntu", (0.0, 0.012, 6e-8), low=0.0, high=1000.0, noise=0.4, calm=5.0, load_mw=50),
)
"""A row for each sensor, eight at most. A sensor's place in the table is its place in records and packets."""
COUNT_FIELDS = len(SENSORS) * "H"
"""The counts of a sample in a `struct` format."""
NO_COUNTS: Counts = (0,) * len(SENSORS)


def sample(sensors: tuple[Sensor, ...], true_values: Values, unit_noises: Values) -> tuple[Counts, int]:
    """Reads all sensors: the counts, and a bit by its place for each sensor outside its range."""
    counts, saturated = [], 0
    for place, (sensor, value, noise) in enumerate(zip(sensors, true_values, unit_noises, strict=True)):
        count, outside = sensor.read(value, noise)
        counts.append(count)
        saturated |= outside << place
    return tuple(counts), saturated


def values(sensors: tuple[Sensor, ...], counts: Counts) -> Values:
    """The values of a sample's counts."""
    return tuple([sensor.value(count) for sensor, count in zip(sensors, counts, strict=True)])
