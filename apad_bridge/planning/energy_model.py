"""A planner's assumptions of boards, docks and the aPad when it looks ahead: nominal values, never one aMussel's.

Charges are scaled voltages in [0, 1] and times are mission seconds, so theta is in the rates. Sources: the paper's
equations (1) and (2) for a battery, and the scenario for all else.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from apad_bridge.planning.dispatch_rule import ServiceRules


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergyModel(ServiceRules):
    """The nominal rates, thresholds and times that a strategy may plan with; the same for each aMussel.

    The thresholds are the mission's.
    """

    drain_per_s: float
    """The mean drain of an aMussel at work, above 0."""
    curve: tuple[tuple[float, float], ...]
    """(upper end, charge a second) of each part of the charging curve, rising; the last part ends at 1."""
    motor_run: float
    """The charge that one run of the motors takes."""
    speed_m_s: float
    """The aPad's speed in calm water."""
    dock_s: float
    undock_s: float
    docks: int

    @property
    def full(self) -> float:
        """The charge above which the mission releases an aMussel."""
        return self.full_threshold

    def charging_s(self, charge: float, to: float) -> float:
        """The seconds in a dock from `charge` up to `to`; infinite above the end of the curve."""
        seconds = 0.0
        for end, per_s in self.curve:
            if charge >= to:
                return seconds
            if charge < end:
                upper = min(end, to)
                seconds += (upper - charge) / per_s
                charge = upper
        return seconds if charge >= to else inf

    def charged(self, charge: float, seconds: float) -> float:
        """The charge after `seconds` in a dock."""
        for end, per_s in self.curve:
            if charge < end:
                needed_s = (end - charge) / per_s
                if seconds <= needed_s:
                    return charge + seconds * per_s
                seconds -= needed_s
                charge = end
        return charge
