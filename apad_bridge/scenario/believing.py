"""How the supervisor comes to what it believes of aMussels: by their last packet, or by a filter for each."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from annotated_types import Ge, Gt, Lt

from apad_bridge.scenario.quantities import NotNegative, Positive, frozen


class Estimator(StrEnum):
    """`hold_last`: what the newest packet said, until the next. `twin`: the firmware run forward, and a filter."""

    HOLD_LAST = "hold_last"
    TWIN = "twin"


Deviation = Annotated[float, Gt(0), Lt(1)]


@frozen
class TwinModel:
    """How far a twin trusts what it is told; deviations."""

    drain_deviation: Deviation
    """Of the drain between aMussels, relative."""
    sensor_noise: Deviation
    """Of one measured charge."""
    bias_deviation: Deviation
    """Of what a load or a charger does to a measured charge."""
    unscheduled: Annotated[float, Ge(0), Lt(0.5)]
    """The share of hours in which an aMussel does otherwise than its board is set to."""
    fix_deviation_m: Positive
    """Of a place that a packet states, along one axis."""
    current_deviation_m_s: NotNegative = 0.0
    """Of the water's current along one axis, where aMussels float."""


@frozen
class Beliefs:
    estimator: Estimator = Estimator.HOLD_LAST
    twin: TwinModel | None = None

    def __post_init__(self) -> None:
        if (self.estimator is Estimator.TWIN) != (self.twin is not None):
            raise ValueError("`twin` must be there for the estimator twin, and for no other")
