"""Two measures for flights beside the bounds of `capacity`: what so many services can give, and what a flight sustained."""

from __future__ import annotations

from math import fsum

from apad_bridge.assembly import capacity_bounds
from apad_bridge.scenario.firmware_config import board_config
from apad_bridge.scenario.schema import Scenario


def sustained_by_balance(amussels: int, gained: float, drain: float, minutes: float) -> float:
    """The capacity that a flight measures: the fleet whose charge would have stayed the same; `drain` is the fleet's mean.

    With docks that are never empty, an aMussel more costs its drain alone. So a fleet whose charges rose by `gained`
    batteries together in `minutes` could be larger by gained / (drain x minutes), or had to be smaller. That holds near the
    capacity: charges below the curve's knee lower it, docks without work too.
    """
    return amussels + gained / (drain * minutes)


def uptime_with_services(scenario: Scenario, services: float) -> float:
    """The largest mean uptime, in percent, that so many services can give: a bound for a way that pays for no more.

    A docked minute gains most on the fastest part of the curve, so one service of t minutes gains at most g(t), the fastest
    parts first. g is concave, so S services in Y docked minutes gain at most S g(Y / S). The sum of active time is at most
    the smaller of N T - Y and sum of min(T, u_i / d_i) + S g(Y / S) / d, with the best Y up to D T, and d the least drain.
    Surfacing and travel are free. The boards are those without a spread.
    """
    fleet, minutes = (
        capacity_bounds.rates_of(scenario),
        scenario.time_scale.agent_time(scenario.duration_s) / 60,
    )
    board = board_config(scenario.board, scenario.seed)
    curve = capacity_bounds._curve_of(board, capacity_bounds._draw_in_a_dock(board))
    ends = [0.0, *(end for end, _ in curve)]
    parts = ((rate, end - low) for (end, rate), low in zip(curve, ends, strict=False) if rate > 0)
    fastest = sorted(parts, reverse=True)
    drain = min(it.drain for it in fleet)
    unserved = fsum(min(minutes, it.start / it.drain) for it in fleet)

    def at_work(docked: float) -> float:
        left, gain = docked / services, 0.0
        for rate, part in fastest:
            took = min(left, part / rate)
            left, gain = left - took, gain + took * rate
        return unserved + services * gain / drain

    low, high = 0.0, capacity_bounds._docks_of(scenario) * minutes
    # The time at work rises with the docked minutes, and the time outside docks falls.
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if at_work(middle) < len(fleet) * minutes - middle else (low, middle)
    return 100 * min(at_work(high), len(fleet) * minutes - low) / (len(fleet) * minutes)
