"""The table of a board's sensors, `SENSORS`: the board's own four, and after them those that installed packages bring.

A sensor's calibration is a polynomial from raw counts to its unit. The board stores and sends counts, and a receiver with
the coefficients converts them to values. Neither the paper nor any public text gives the aMussels' own coefficients: these
are ours, plausible for 16-bit converters and for the ranges in a lagoon, and they are data.

Records, packets, the water's fields, the loads of a board, and the keys of scenarios and of samples.jsonl follow the
table, and so does `firmware_model.power.rails.Rail`: docs/packets.md. A sensor of a package that cannot be used is an
ImportError of one line, so that each command ends with that line, and none goes on with another table.
"""

from __future__ import annotations

import re
from binascii import crc_hqx

from firmware_model.entry_points import MEND, entry_points, in_one_line
from firmware_model.sampling.sensor import Sensor

GROUP = "musselbed.sensors"
MOST = 8
"""A record has a byte with a bit for each sensor."""

Counts = tuple[int, ...]
"""The raw count of each sensor, in the order of `SENSORS`."""
Values = tuple[float, ...]
"""A value for each sensor, in the order of `SENSORS`."""

_OWN = (
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


def _of_packages() -> dict[str, Sensor]:
    """`BROUGHT`. ImportError if one is refused."""
    found: dict[str, Sensor] = {}
    sources = {it.name: "musselbed itself" for it in _OWN}
    for entry in sorted(entry_points(GROUP), key=lambda it: it.name):
        text = f"{entry.name} of {entry.brought_by}"
        try:
            sensor = entry.load()
        except (Exception, SystemExit) as error:
            wrong = f"cannot be loaded: {in_one_line(error)}"
        else:
            wrong = _fault(sensor, entry.name, sources)
        if wrong:
            raise ImportError(f"the sensor {text} ({entry.module}) {' '.join(wrong.split())}: {MEND}")
        found[text], sources[entry.name] = sensor, entry.brought_by
    if len(sources) > MOST:
        raise ImportError(f"{len(sources)} sensors are more than {MOST}: uninstall one of {', '.join(found)}")
    return found


def _fault(sensor: object, name: str, sources: dict[str, str]) -> str:
    """The reason why a board cannot have this sensor of a package; empty if it can."""
    if not isinstance(sensor, Sensor):
        return f"is no Sensor but a {type(sensor).__name__}"
    if sensor.name != name or not re.fullmatch("[a-z][a-z0-9_]*", sensor.key):
        return f"has the key {sensor.key!r}, which must be its entry's name and a unit in small letters"
    if sensor.calm is None:
        return "has no value of a calm bay"
    return f"has the name of one of {sources[name]}" if name in sources else ""


BROUGHT = _of_packages()
"""The sensors that packages bring, by texts such as `salinity of lab_sensors 1.2`, in the order of their names."""
SENSORS = (*_OWN, *BROUGHT.values())
"""A row for each sensor, eight at most. A sensor's place in the table is its place in records and packets."""
LAYOUT = 3 + crc_hqx(repr(SENSORS).encode(), 0) % 250 if BROUGHT else 0
"""A number of the table that the versions of records and packets with counts are raised by: 0 for the board's own four.

Without it, a receiver with other sensors of the same number would read their counts as those of its own.
"""
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
