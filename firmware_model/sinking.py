"""The body's answer to its buoyancy motors: it rises and sinks at constant rates."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_model.actions import Buoyancy


@dataclass(frozen=True, slots=True)
class Sinking:
    """The constant rates at which bodies rise and sink: the whole way from the bottom, or to it, in agent milliseconds."""

    bottom_um: int
    surfacing_ms: int
    sinking_ms: int

    def depth_um(self, from_um: int, buoyancy: Buoyancy, hover_um: int, elapsed_ms: int) -> int:
        """The depth of a body that began to move at `from_um`: up, down, or to its hovering depth."""
        goal_um = self.bottom_um
        if buoyancy is Buoyancy.FLOAT:
            goal_um = 0
        elif buoyancy is Buoyancy.HOVER:
            goal_um = hover_um
        if goal_um < from_um:
            return max(goal_um, from_um - self.bottom_um * elapsed_ms // self.surfacing_ms)
        return min(goal_um, from_um + self.bottom_um * elapsed_ms // self.sinking_ms)
