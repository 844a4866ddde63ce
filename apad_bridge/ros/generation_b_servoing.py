"""The law of generation B's visual servoing, as read from its source: what the camera says turns the boat and drives it.

Without a detection younger than a second it searches, by turning. With one: yaw rate = max * tanh(horizontal), surge =
max * exp(-horizontal^2 / (2 * stdev^2)) towards the slot, until `docking_vertical` lies in (0.8, 0.9), which is the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from apad_bridge.simulated_apad.steering import Steer
from apad_bridge.vehicle.generation_b.messages import DETECTION_MS, DockingOrder, slot_direction_rad

CLOSE_ENOUGH = (0.8, 0.9)


@dataclass(frozen=True, slots=True)
class Detection:
    """What the camera says of an aMussel: in image coordinates, 0 the middle and 1 an edge."""

    at_ms: int
    horizontal: float
    vertical: float


def servoing(order: DockingOrder, seen: Detection | None, now_ms: int) -> Steer | None:
    """How the boat is steered at `now_ms`; None when it has docked."""
    towards_rad = slot_direction_rad(order.slot)
    if seen is None or now_ms - seen.at_ms > DETECTION_MS:
        return Steer(0.0, towards_rad, order.search_yaw_rate_rad_s)
    if CLOSE_ENOUGH[0] < seen.vertical < CLOSE_ENOUGH[1]:
        return None
    stdev = max(order.surge_stdev, 1e-6)
    surge_m_s = order.max_surge_m_s * math.exp(-(seen.horizontal**2) / (2 * stdev**2))
    return Steer(surge_m_s, towards_rad, order.max_yaw_rate_rad_s * math.tanh(seen.horizontal))
