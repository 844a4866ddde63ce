"""An aPad beside the scenario's own."""

from __future__ import annotations

from apad_bridge.scenario.quantities import RosName, frozen


@frozen
class AnotherAPad:
    """Like `apad` in everything but this."""

    name: RosName
    start_m: tuple[float, float]
