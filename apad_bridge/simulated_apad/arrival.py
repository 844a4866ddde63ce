"""When a go-to has arrived: the public aPad stack's rule."""

from __future__ import annotations

from collections import deque

from apad_bridge.vehicle.commands import GoTo
from apad_bridge.vehicle.simulated.kinematics import STEP_MS, Pose

SAMPLES = 1000 // STEP_MS


class ArrivalWatch:
    """Arrived when the mean distance over the last second is below the victory radius, never within the first second."""

    def __init__(self, command: GoTo) -> None:
        self.command = command
        self._distances_m: deque[float] = deque(maxlen=SAMPLES)

    def has_arrived(self, pose: Pose) -> bool:
        """Take the pose at the end of a step as a sample."""
        north_m, east_m = self.command.north_m - pose.north_m, self.command.east_m - pose.east_m
        self._distances_m.append((north_m * north_m + east_m * east_m) ** 0.5)
        full = len(self._distances_m) == SAMPLES
        return full and sum(self._distances_m) / SAMPLES < self.command.victory_radius_m
