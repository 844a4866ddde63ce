"""An aPad beside the scenario's own."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge

from apad_bridge.scenario.faults import Fault
from apad_bridge.scenario.quantities import Fraction, RosName, frozen


@frozen
class AnotherAPad:
    """Like `apad` in everything that is not given."""

    name: RosName
    start_m: tuple[float, float]
    battery_start_fraction: Fraction | None = None
    """What its battery holds at the start."""
    fault: Fault | None = None
    """What its simulated node does wrong."""


@frozen
class Sharing:
    """Whether several aPads take over from each other."""

    transfers: bool = True
    """False: who serves whom stays as it was planned at the start, and nobody serves those of an aPad that stands down."""
    failed_go_tos: Annotated[int, Ge(1)] = 3
    """So many in a row, and an aPad stands down."""
