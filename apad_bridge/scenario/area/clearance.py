"""The clearance that a vehicle needs to come to rest inside its waters, and the speed that a clearance allows."""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.scenario.guard_options import GuardOptions


@dataclass(frozen=True, slots=True)
class StoppingRoom:
    """The lengths, speeds and the time that make up the room of a stop: metres, metres a second, seconds."""

    position_error_m: float
    """The aPad lies within it of the place that it tells, in 95 % of all cases."""
    hull_m: float
    current_m_s: float
    reaction_s: float
    """From the cause of a stop to the vehicle's acceptance."""
    coasting_m: float
    """The way from the acceptance to rest at `coasting_speed_m_s`, not exceeded in 95 % of all stops."""
    coasting_speed_m_s: float

    def clearance_m(self, speed_m_s: float) -> float:
        """The least clearance at this speed:

            position error + hull / 2 + (speed + current) x reaction + coasting(speed)

        Coasting is measured at one speed. Above it the way is taken to grow with the square of the speed, as that of a
        hull does that thrusters of a constant force slow; drag alone makes it grow less. Below it the measured way
        counts: quadratic drag hardly shortens the way of a slower hull. So measure it at the speed of the mission.
        """
        ratio = max(1.0, speed_m_s / self.coasting_speed_m_s)
        return self._standing_m + speed_m_s * self.reaction_s + self.coasting_m * ratio**2

    def fastest_m_s(self, clearance_m: float) -> float:
        """The greatest speed that this clearance allows, the inverse of `clearance_m`; 0 where none does."""
        left_m = clearance_m - self._standing_m
        slow_m_s = (left_m - self.coasting_m) / self.reaction_s
        if slow_m_s <= self.coasting_speed_m_s or not self.coasting_m:
            return max(0.0, slow_m_s)
        square = self.coasting_m / self.coasting_speed_m_s**2
        # The positive root of square x v^2 + reaction x v = left, in the form that does not cancel.
        return 2 * left_m / (self.reaction_s + math.sqrt(self.reaction_s**2 + 4 * square * left_m))

    @property
    def _standing_m(self) -> float:
        return self.position_error_m + self.hull_m / 2 + self.current_m_s * self.reaction_s


def stopping_room(guards: GuardOptions, known_m_s: float = 0.0) -> StoppingRoom | list[str]:
    """The room by the scenario's guards; or the keys that are missing for it.

    `known_m_s` is the fastest drift in the scenario's own current and wind, which counts where it is above `drift_m_s`.
    """
    numbers = {
        "position_error_m": guards.position_error_m,
        "hull_m": guards.hull_m,
        "coasting_m": guards.coasting_m,
        "coasting_speed_m_s": guards.coasting_speed_m_s,
    }
    given = {name: value for name, value in numbers.items() if value is not None}
    if len(given) < len(numbers):
        return [f"guards.{name}" for name in numbers if name not in given]
    return StoppingRoom(current_m_s=max(guards.drift_m_s, known_m_s), reaction_s=guards.reaction_s, **given)
