"""Further aPads beside the scenario's `apad`."""

from __future__ import annotations

from agents.water.bounds import Count
from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.quantities import (
    Fraction,
    NotNegativeSeconds,
    Place,
    PositiveSeconds,
    RosName,
    frozen,
)

ASSIGNMENT_PERIOD_S = 10.0
"""Mission time between two looks at the assignment. In this time an aPad that stood down can still receive packets from
the aMussels that it called up."""


@frozen
class AnotherAPad:
    """An aPad that equals `apad` in all keys that are left out."""

    name: RosName
    """Its namespace; no two have the same."""
    start_m: Place
    """Its place at the start, where its share begins."""
    battery_start_fraction: Fraction | None = None
    """The charge of its battery at the start; None: that of `apad`."""
    fault: Fault | None = None
    """The fault of its simulated node; None: that of `apad`."""


@frozen
class Silence:
    """A time in which an aPad neither sends to the others nor receives from them."""

    apad: RosName
    """Its name."""
    from_s: NotNegativeSeconds = 0.0
    """Mission time of its beginning."""
    to_s: PositiveSeconds | None = None
    """Mission time of its end; None: it lasts."""


@frozen
class Consensus:
    """The aPads agree over a radio network on who serves which aMussel: docs/several.md#consensus."""

    lease_s: PositiveSeconds = 180.0
    """A vote binds for so long. An aPad that was not heard of for this time is silent, and others serve its aMussels."""
    clock_error_s: NotNegativeSeconds = 1.0
    """The greatest difference between the clocks of two aPads."""
    loss: Fraction = 0.0
    """The fraction of messages that the network loses."""
    delay_s: NotNegativeSeconds = 0.0
    """The time that a message takes."""
    silences: tuple[Silence, ...] = ()


@frozen
class Sharing:
    """Takeover between several aPads."""

    transfers: bool = True
    """False: the allocation stays as planned at the start, and nobody serves the aMussels of an aPad that stands down."""
    failed_go_tos: Count = 3
    """An aPad stands down after this number of failed go-tos in a row."""
    consensus: Consensus | None = None
    """None: the run divides the fleet, at the start and when an aPad stands down."""
