"""The ranges of numbers that come from outside. A message with a number beyond its range is dropped and counted.

A range is far wider than anything that the field sees, and narrow enough that no sum or square of its numbers overflows.
"""

from __future__ import annotations

from firmware_model.packets import StatusPacket

FARTHEST_M = 50_000.0
"""The largest distance from the origin at which the bench sends an aPad or places an aMussel."""

RANGES: dict[str, tuple[float, float]] = {
    "north_m": (-FARTHEST_M, FARTHEST_M),
    "east_m": (-FARTHEST_M, FARTHEST_M),
    "depth_m": (-1_000.0, 12_000.0),
    "range_m": (0.0, 2 * FARTHEST_M),
    # Some drivers count full turns and never wrap.
    "yaw_rad": (-1_000.0, 1_000.0),
    # Gauges in the field overshoot both ends of 0 to 100 %.
    "battery_percent": (-50.0, 200.0),
    "percent_points": (-100.0, 100.0),
    "charge": (0.0, 1.0),
    "secondary_charge": (0.0, 1.0),
}
"""(least, greatest) by name; the unit is the name's ending, and a charge is a fraction."""


def out_of_range(**numbers: float) -> str | None:
    """The reason to drop a message with these numbers; None when each is in its range. NaN is in no range.

    The reason names the number and its range but not the value: it is a key under which drops are counted.
    """
    for name, number in numbers.items():
        least, greatest = RANGES[name]
        if not least <= number <= greatest:
            return f"{name} is outside {least:g} to {greatest:g}"
    return None


def status_out_of_range(status: StatusPacket) -> str | None:
    """The reason to drop a status, as `out_of_range` gives it."""
    return out_of_range(
        north_m=status.north_m,
        east_m=status.east_m,
        depth_m=status.depth_m,
        charge=status.primary,
        secondary_charge=status.secondary,
    )
