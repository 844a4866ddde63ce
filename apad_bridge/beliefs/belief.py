"""What the supervisor thinks of one aMussel. The mission and the planner are built from these alone."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_model.states import State


@dataclass(frozen=True, slots=True)
class Belief:
    """`heard_ms` is the mission time of the newest packet; charges are the paper's scaled voltage in [0, 1]."""

    agent_id: int
    heard_ms: int
    state: State
    primary: float
    secondary: float
    north_m: float
    east_m: float

    def age_s(self, now_ms: int) -> float:
        """Mission seconds since the newest packet."""
        return (now_ms - self.heard_ms) / 1000
