"""Whether an aPad is near enough to a simulated aMussel to dock it: no stack asks, and the bench is the world here.

A perch of generation A succeeds from a hundred metres away, and nothing in generation B looks for a simulated aMussel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from apad_bridge.vehicle.commands import PoseReported

Sight = Callable[[int], Mapping[int, tuple[float, float]]]
"""At a mission time: where simulated aMussels float, (north, east) in metres by id; empty where nobody knows."""
FAR_M = 5.0
"""Farther than a mission's victory radius and a drift meanwhile come to; a docking from here is a mistake."""


def why_out_of_reach(agent_id: int, pose: PoseReported | None, sight: Sight, now_ms: int) -> str | None:
    """None where it is near, or where nobody knows."""
    if pose is None or (there_m := sight(now_ms).get(agent_id)) is None:
        return None
    distance_m = math.dist((pose.north_m, pose.east_m), there_m)
    if distance_m <= FAR_M:
        return None
    return f"aMussel {agent_id} floats {distance_m:.1f} m away: go nearer than {FAR_M:g} m before docking it"
