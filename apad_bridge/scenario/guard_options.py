"""The limits of the guards on orders that move a vehicle or an aMussel."""

from __future__ import annotations

from enum import StrEnum

from apad_bridge.scenario.quantities import (
    Fraction,
    NotNegative,
    NotNegativeSeconds,
    Positive,
    PositiveSeconds,
    frozen,
)

LOOK_MS = 200
"""A real vehicle's position is looked at so often between two ticks: a tick is a third of the time that a stop may take."""


class WhenOutside(StrEnum):
    """The reaction to an aPad outside its fence: hold there and call a pilot, or go back to the nearest place inside."""

    HOLD = "hold"
    RETURN = "return"


class WhenUnwatched(StrEnum):
    """The reaction to the loss of the vehicle's watchdog in flight: hold until a person continues, or an alarm alone."""

    HOLD = "hold"
    TELL = "tell"


@frozen
class GuardOptions:
    """Limits that are left out are none."""

    clearance_m: NotNegative = 2.0
    """The least distance of a way to the fence and to keep-out zones; `area/clearance.py` has the need of a stop."""
    position_error_m: Positive | None = None
    """The aPad lies within it of the place that it tells, in 95 % of all cases."""
    hull_m: Positive | None = None
    """The hull's greatest length."""
    reaction_s: PositiveSeconds = 3.0
    """From the cause of a stop to the vehicle's acceptance."""
    coasting_m: NotNegative | None = None
    """The way from the acceptance of a stop to rest, not exceeded in 95 % of all stops from `coasting_speed_m_s`."""
    coasting_speed_m_s: Positive | None = None
    outside: WhenOutside = WhenOutside.HOLD
    leg_m: Positive | None = None
    """The greatest length of a leg."""
    leg_s: PositiveSeconds | None = None
    """The longest that a leg may last, as ordered and as flown."""
    speed_limit_m_s: Positive | None = None
    """The greatest speed, as ordered and as measured."""
    position_age_s: PositiveSeconds = 2.0
    """The greatest age of a position that orders may build on."""
    frozen_s: PositiveSeconds = 2.0
    """A position that stays the same to the last bit for so long under way is not believed."""
    jump_m: Positive = 10.0
    """A position farther than this from where the aPad can have come is not believed."""
    bodies_m: Positive = 3.0
    """The least distance of a way to real aMussels at the surface and to other aPads."""
    drift_m_s: NotNegative = 0.2
    """The fastest drift of an aPad whose controllers are off, for the room that a visual docking and a stop need."""
    adrift_s: NotNegativeSeconds | None = None
    """The longest that the aPad lies without thrust before it docks or undocks: 27 s if left out, as generation B."""
    search_m: NotNegative = 2.0
    """Greatest distance that a visual docking may move in its search."""
    battery_reserve: Fraction | None = None
    """The charge that must be left at the end of the way home."""
    pilots: tuple[str, ...] = ()
    """Nodes by which a pilot steers, where the aPad tells nobody of a pilot: nothing is ordered against their goals."""
    amussel_depth_m: Positive | None = None
    """The greatest depth for which the aMussels are rated."""
    watchdog: WhenUnwatched | None = None
    """A real aPad has to have its watchdog, and this follows if it is lost. Without it, one that was seen may be lost: that
    is told."""
    hardware_cut: bool = False
    """A person can cut the thrusters' power from a distance, by a switch that no computer of the vehicle is part of."""
