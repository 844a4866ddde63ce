"""Taking an aMussel into a dock, as the paper's mission does: let it surface, wait until it floats, then the mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from apad_bridge.beliefs.belief import Belief
from apad_bridge.scenario.schema import Mission
from firmware_model.states import State


class Next(Enum):
    WAIT = auto()
    PERMIT = auto()
    """Tell it (again) that it may surface."""
    CLOSE = auto()
    """It floats: the mechanism may close."""


class GivenUp(Exception):
    """The routine ends here; its text is why."""


@dataclass(slots=True)
class AwaitSurfacing:
    """Asked at every tick what to do next, until it floats or is given up (see `Mission`'s times in the scenario)."""

    slot: int
    agent_id: int
    since_ms: int
    permissions: int = 0

    def look(self, belief: Belief | None, config: Mission, now_ms: int) -> Next:
        """What to do at `now_ms`; raises GivenUp."""
        if belief is not None and belief.state is State.FLOATING:
            return Next.CLOSE
        waited_ms = now_ms - self.since_ms
        if belief is not None and belief.state is State.SURFACING:
            if waited_ms > config.silence_timeout_s * 1000:
                raise GivenUp("it does not come up")
            return Next.WAIT
        if waited_ms < config.permission_repeat_s * 1000 * self.permissions:
            return Next.WAIT
        if self.permissions >= config.surfacing_attempts:
            raise GivenUp("it does not answer the permission to surface")
        self.permissions += 1
        return Next.PERMIT
