"""The aPad's battery and its charger. What the thrusters draw is in `thrusters.py`.

In integers: microwatts times milliseconds are nanojoules, so no cut of time rounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.scenario.schema import APad, APadBattery
from apad_bridge.world.apad.motion import Motion

# The charger at the aPad's home: it feeds the battery of an aPad that is at rest there.
REACH_M = 2.0
"""The charger's cable. Assumed: an aPad that has come home lies within the victory radius of it."""


class Charger:
    """Gives no power to an aPad without a `home`."""

    def __init__(self, config: APad, home_m: tuple[float, float] | None) -> None:
        """`home_m` is (north, east); None for the aPad's start."""
        self._power_w = 0.0 if config.home is None else config.home.charging_w
        self._home_m = config.start_m if home_m is None else home_m

    def power_w(self, motion: Motion) -> float:
        """The power that it gives to the vehicle as it moves, or rests, now."""
        if not self._power_w or motion.is_moving:
            return 0.0
        place_m = motion.pose.north_m, motion.pose.east_m
        return self._power_w if math.dist(place_m, self._home_m) <= REACH_M else 0.0


_NJ_PER_WH = 3600 * 10**9


def microwatts(power_w: float) -> int:
    return round(power_w * 1e6)


@dataclass(frozen=True, slots=True)
class Ledger:
    """Energy drawn since the start by its use, in Wh."""

    travel_wh: float
    """Thrusters."""
    hotel_wh: float
    """Constant load of computers and sensors."""
    handed_wh: float
    """Docks that hold an aMussel: what the aPad spends for them, of which their batteries take in a part."""

    @property
    def used_wh(self) -> float:
        return self.travel_wh + self.hotel_wh + self.handed_wh


class HullBattery:
    """Linear in energy; the voltage is linear from `empty_v` to `full_v` (the scale of the paper's Fig. 4 b)."""

    def __init__(self, config: APadBattery) -> None:
        self._config = config
        self._full_nj = round(config.capacity_wh * _NJ_PER_WH)
        self._start_nj = round(config.start_fraction * self._full_nj)
        self._energy_nj = self._start_nj
        self._hotel_uw = microwatts(config.hotel_w)
        self._dock_uw = microwatts(config.charging_w_per_dock)
        self._power_uw = self._hotel_uw
        self._docks_uw = self._charger_uw = 0
        self._hotel_nj = self._handed_nj = self._drawn_nj = 0
        self._settled_ms = 0

    def settle(self, now_ms: int) -> None:
        """Subtract the energy drawn since the last call; an empty battery stays at zero."""
        span_ms = now_ms - self._settled_ms
        needed_nj = self._power_uw * span_ms
        there_nj = self._energy_nj + self._charger_uw * span_ms
        drawn_nj = min(there_nj, needed_nj)
        self._energy_nj = min(self._full_nj, there_nj - drawn_nj)
        self._drawn_nj += drawn_nj
        hotel_nj, handed_nj = self._hotel_uw * span_ms, self._docks_uw * span_ms
        if drawn_nj < needed_nj:  # the battery ran out in this span
            hotel_nj, handed_nj = hotel_nj * drawn_nj // needed_nj, handed_nj * drawn_nj // needed_nj
        self._hotel_nj += hotel_nj
        self._handed_nj += handed_nj
        self._settled_ms = now_ms

    def set_load(self, thrusters_w: float, closed_docks: int, charger_w: float = 0.0) -> None:
        """Set the load from the settled time on, beside the hotel load, and the power of a charger ashore."""
        self._charger_uw = microwatts(charger_w)
        self._docks_uw = closed_docks * self._dock_uw
        self._power_uw = self._hotel_uw + self._docks_uw + microwatts(thrusters_w)

    def add(self, fraction: float) -> None:
        """Add a fraction of a full battery at the settled time (a negative one drains); the charge stays in [0, full]."""
        self._energy_nj = min(self._full_nj, max(0, self._energy_nj + round(fraction * self._full_nj)))

    @property
    def is_empty(self) -> bool:
        return self._energy_nj == 0

    @property
    def power_w(self) -> float:
        return self._power_uw / 1e6

    @property
    def fraction(self) -> float:
        return self._energy_nj / self._full_nj

    @property
    def used_fraction(self) -> float:
        """Energy drawn since the start, as a fraction of a FULL battery."""
        return (self._start_nj - self._energy_nj) / self._full_nj

    @property
    def ledger(self) -> Ledger:
        """The energy drawn up to the settled time; what somebody charged or drained is not in it."""
        travel_nj = self._drawn_nj - self._hotel_nj - self._handed_nj
        return Ledger(*(nj / _NJ_PER_WH for nj in (travel_nj, self._hotel_nj, self._handed_nj)))

    @property
    def voltage_v(self) -> float:
        return self._config.empty_v + self.fraction * (self._config.full_v - self._config.empty_v)
