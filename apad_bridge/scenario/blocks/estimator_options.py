"""The scenario's block `beliefs`: the estimator of aMussels' states, by last packet or by a filter for each."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from annotated_types import Ge, Gt, Le, Lt

from agents.water.bounds import NotNegative
from apad_bridge.scenario.quantities import Positive, frozen


class EstimatorKind(StrEnum):
    """`hold_last`: the newest packet's values until the next. `twin`: the firmware model run forward, and a filter."""

    HOLD_LAST = "hold_last"
    TWIN = "twin"


Deviation = Annotated[float, Gt(0), Lt(1)]


@frozen
class Untold:
    """The most by which a board may differ from its scenario's: a twin is told none of it, and learns it.

    With `hearing` of the paper a twin learns none of it.
    """

    ageing: Annotated[float, Ge(0), Le(0.6)] = 0.4
    """The share of both batteries' capacity that is lost."""
    drain: Annotated[float, Ge(0), Le(0.5)] = 0.2
    """The loads, relative, either way."""
    drain_swing: Annotated[float, Ge(0), Le(0.3)] = 0.0
    """Deviation of the loads within a day, relative to their mean: 0.06 for a sine of 8.5 %, as temperature may make it."""
    bias: Annotated[float, Ge(0), Le(0.2)] = 0.05
    """The bias of each battery's sensor, either way."""


@frozen
class TwinModel:
    """The standard deviations of a twin's model and inputs."""

    drain_deviation: Deviation
    """Deviation of the drain between aMussels, relative."""
    sensor_noise: Deviation
    """Deviation of one measured charge. The shipped scenarios assume it: the paper gives none."""
    bias_deviation: Deviation
    """Deviation of the effect of a load or a charger on a measured charge."""
    unscheduled: Annotated[float, Ge(0), Lt(0.5)]
    """The fraction of hours in which an aMussel departs from its board's schedule."""
    coil_deviation: Annotated[float, Ge(0), Lt(0.5)] = 0.02
    """Deviation of the charging rate between dockings, relative, from the alignment of the coils."""
    motor_deviation: Annotated[float, Ge(0), Lt(1)] = 0.15
    """Deviation of what the motors take for a way up or down, relative to a run of theirs. Assumed: no series of runs is
    public."""
    fix_deviation_m: Positive
    """Deviation of a packet's place along one axis."""
    current_deviation_m_s: NotNegative = 0.0
    """Deviation along one axis of the water's current where aMussels float."""
    untold: Untold = Untold()
    """The most by which a board may differ from its scenario's; the twin learns it, except where `hearing` is the
    paper's."""


@frozen
class Beliefs:
    estimator: EstimatorKind = EstimatorKind.HOLD_LAST
    """`hold_last`: the content of the newest packet. `twin`: the firmware run forward for each aMussel, with a filter."""
    twin: TwinModel | None = None
    """The twins' model; `estimator: twin` needs it."""

    def __post_init__(self) -> None:
        if (self.estimator is EstimatorKind.TWIN) != (self.twin is not None):
            raise ValueError("`twin` must be there for the estimator twin, and for no other")
