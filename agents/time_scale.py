"""The two clocks of a flight, and the one place that computes one from the other.

Mission time is the aPad's, and agent time is theta times that. Both are whole milliseconds from the flight's start, and the
type checker keeps them apart. A span of either is a plain number. So is a time where one clock alone can be: on a board, in
the water, and in a vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NewType

AgentMs = NewType("AgentMs", int)
MissionMs = NewType("MissionMs", int)

TICK_MS = 1000
"""The mission acts once a second, the paper's 1 Hz."""


@dataclass(frozen=True, slots=True)
class TimeScale:
    theta: int
    """Agent time per mission time, a positive integer."""

    def __post_init__(self) -> None:
        if self.theta < 1:
            raise ValueError(f"theta is a positive integer, not {self.theta}")

    @property
    def is_real(self) -> bool:
        """True if both clocks run alike, as real boards and real sound need."""
        return self.theta == 1

    def agent_ms(self, mission_ms: MissionMs) -> AgentMs:
        return AgentMs(self.theta * mission_ms)

    def mission_ms(self, agent_ms: AgentMs) -> MissionMs:
        """The first mission millisecond at which that agent time has come."""
        return MissionMs(-(-agent_ms // self.theta))

    def agent_span(self, mission_span: int) -> int:
        """The agent time that passes in a span of mission time, in the same unit."""
        return self.theta * mission_span

    def mission_span(self, agent_span: int) -> int:
        """The whole units of mission time that pass in a span of agent time."""
        return agent_span // self.theta

    def agent_time(self, mission_time: float) -> float:
        """`agent_span` of a number that need not be whole."""
        return self.theta * mission_time

    def mission_time(self, agent_time: float) -> float:
        """The inverse of `agent_time`."""
        return agent_time / self.theta
