"""The battery, in integers: microwatts times milliseconds are nanojoules, so no cut of time rounds."""

from __future__ import annotations

from apad_bridge.scenario.schema import APadBattery

_NJ_PER_WH = 3600 * 10**9


def microwatts(power_w: float) -> int:
    return round(power_w * 1e6)


class Battery:
    """Linear in energy; the voltage is linear from `empty_v` to `full_v` (the scale of the paper's Fig. 4 b)."""

    def __init__(self, config: APadBattery) -> None:
        self._config = config
        self._full_nj = round(config.capacity_wh * _NJ_PER_WH)
        self._start_nj = round(config.start_fraction * self._full_nj)
        self._energy_nj = self._start_nj
        self._hotel_uw = microwatts(config.hotel_w)
        self._dock_uw = microwatts(config.charging_w_per_dock)
        self._power_uw = self._hotel_uw
        self._settled_ms = 0

    def settle(self, now_ms: int) -> None:
        """Subtract the energy drawn since the last call; an empty battery stays at zero."""
        drawn_nj = self._power_uw * (now_ms - self._settled_ms)
        self._energy_nj = max(0, self._energy_nj - drawn_nj)
        self._settled_ms = now_ms

    def set_load(self, thrusters_w: float, closed_docks: int) -> None:
        """Set the load from the settled time on, beside the hotel load."""
        self._power_uw = self._hotel_uw + closed_docks * self._dock_uw + microwatts(thrusters_w)

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
    def voltage_v(self) -> float:
        return self._config.empty_v + self.fraction * (self._config.full_v - self._config.empty_v)
