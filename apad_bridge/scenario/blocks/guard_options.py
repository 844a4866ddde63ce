"""The limits of the guards on orders that move a vehicle or an aMussel."""

from __future__ import annotations

from enum import StrEnum

from agents.water.bounds import NotNegative
from apad_bridge.scenario.quantities import Fraction, NotNegativeSeconds, Positive, PositiveSeconds, frozen

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
    """The least distance of a way to the fence and to keep-out zones; docs/guards.md#clearance has the need of a stop."""
    position_error_m: Positive | None = None
    """The aPad lies within it of the place that it tells, in 95 % of all cases."""
    hull_m: Positive | None = None
    """The hull's greatest length."""
    reaction_s: PositiveSeconds = 3.0
    """From the cause of a stop to the vehicle's acceptance."""
    coasting_m: NotNegative | None = None
    """The way from the acceptance of a stop to rest, not exceeded in 95 % of all stops from `coasting_speed_m_s`."""
    coasting_speed_m_s: Positive | None = None
    """The speed from which `coasting_m` was measured."""
    outside: WhenOutside = WhenOutside.HOLD
    """The reaction to a simulated aPad outside its fence: `hold` switches its controllers off there and calls a pilot,
    `return` sends it to the nearest place inside. A real aPad outside is always switched off."""
    leg_m: Positive | None = None
    """The greatest length of a leg."""
    leg_s: PositiveSeconds | None = None
    """The longest duration of a leg, as ordered, and as flown from the aPad's acceptance on."""
    speed_limit_m_s: Positive | None = None
    """The greatest speed, as ordered, and as measured less its error (docs/guards.md#guards)."""
    position_age_s: PositiveSeconds = 2.0
    """The greatest age of a position that orders may build on."""
    frozen_s: PositiveSeconds = 2.0
    """Under way by an order that the aPad accepted, the guards reject a position that stays the same to the last bit for
    this time."""
    jump_m: Positive = 10.0
    """The guards reject a position farther than this from where the aPad can be: a real aPad's until a person continues,
    another's for 10 s."""
    bodies_m: Positive = 3.0
    """The least distance of a way to real aMussels at the surface, and to other aPads of the run."""
    drift_m_s: NotNegative = 0.2
    """The fastest drift of an aPad whose controllers are off, by current and by wind on the hull, for the room that a
    visual docking and a stop need. A faster one of the scenario's own sea takes its place."""
    adrift_s: NotNegativeSeconds | None = None
    """The longest that the aPad lies without thrust before it docks or undocks: 27 s if left out, as generation B."""
    search_m: NotNegative = 2.0
    """Greatest distance that a visual docking may move in its search."""
    battery_reserve: Fraction | None = None
    """The charge that must be left at the end of the way home."""
    pilots: tuple[str, ...] = ()
    """Nodes by which a pilot steers an aPad of generation A, which publishes nothing about a pilot. While one of these
    nodes has a goal that runs, the bench sends no order."""
    amussel_depth_m: Positive | None = None
    """The greatest depth for which the aMussels are rated; the loader refuses a deeper `area.depth_m`."""
    watchdog: WhenUnwatched | None = None
    """A real aPad must have its watchdog (docs/failures.md#when-the-network-fails); if it stops watching in flight, the
    aPad holds (`hold`) or the bench only tells (`tell`). None: the loss of one that was seen watching is told."""
    hardware_cut: bool = False
    """A person can cut the thrusters' power from a distance, by a switch that no computer of the vehicle is part of."""
