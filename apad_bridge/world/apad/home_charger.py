"""The charger at the aPad's home: it feeds the battery of an aPad that is at rest there."""

from __future__ import annotations

import math

from apad_bridge.scenario.schema import APad
from apad_bridge.world.apad.motion import Motion

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
