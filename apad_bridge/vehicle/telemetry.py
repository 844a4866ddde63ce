"""What aPads of both generations say alike: where one is, and what its battery holds; the newest, and only what can be."""

from __future__ import annotations

import math
from collections import Counter

from apad_bridge.vehicle.commands import BatteryReported, PoseReported
from apad_bridge.vehicle.link import LinkFact
from apad_bridge.vehicle.stack_messages import BatteryHeard, PoseHeard, StateHeard


class Readings:
    """`battery_v` is (empty, full): aPads say percent only, and the voltage follows from it linearly."""

    def __init__(self, battery_v: tuple[float, float]) -> None:
        self.dropped: Counter[str] = Counter()
        self.position_ms = -1
        """The newest stamp of a position that was taken."""
        self.state_ms = -1
        """The newest stamp of `stateRef`."""
        self._empty_v, self._full_v = battery_v
        self.pose: PoseReported | None = None
        """The newest, told or not."""
        self._pose: PoseReported | None = None
        self._battery: BatteryReported | None = None

    def hear(self, heard: PoseHeard | StateHeard | BatteryHeard) -> None:
        match heard:
            case PoseHeard():
                self._hear_pose(heard)
            case StateHeard(at_ms):
                self.state_ms = max(self.state_ms, at_ms)
            case BatteryHeard():
                self._hear_battery(heard)

    def _hear_pose(self, heard: PoseHeard) -> None:
        if not all(map(math.isfinite, (heard.north_m, heard.east_m, heard.heading_rad))):
            self.dropped["position: not finite"] += 1
        elif heard.at_ms < self.position_ms:
            self.dropped["position: a newer one overtook it"] += 1
        else:
            self.position_ms = heard.at_ms
            self.pose = self._pose = PoseReported(heard.at_ms, heard.north_m, heard.east_m, heard.heading_rad)

    def _hear_battery(self, heard: BatteryHeard) -> None:
        if not math.isfinite(heard.percent):
            self.dropped["battery_level: not finite"] += 1
            return
        # Gauges in the field overshoot both ends.
        fraction = min(1.0, max(0.0, heard.percent / 100))
        voltage_v = self._empty_v + fraction * (self._full_v - self._empty_v)
        self._battery = BatteryReported(heard.at_ms, voltage_v, fraction)

    def take(self) -> list[LinkFact]:
        """What came since it was last asked, the newest only."""
        newest: list[LinkFact] = [it for it in (self._pose, self._battery) if it is not None]
        self._pose = self._battery = None
        return newest
