"""Further aPads beside the scenario's `apad`."""

from __future__ import annotations

from agents.water.bounds import Count
from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.quantities import Fraction, Place, RosName, frozen


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
class Sharing:
    """Takeover between several aPads."""

    transfers: bool = True
    """False: the allocation stays as planned at the start, and nobody serves the aMussels of an aPad that stands down."""
    failed_go_tos: Count = 3
    """An aPad stands down after this number of failed go-tos in a row."""
