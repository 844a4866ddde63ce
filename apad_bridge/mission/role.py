"""What the supervisor asks of a mission, whichever it is: the paper's, a script's, or one that does what it is told."""

from __future__ import annotations

from typing import Protocol

from apad_bridge.mission.orders import Order
from apad_bridge.mission.state import MissionState
from apad_bridge.vehicle.primitives import Outcome


class Mission(Protocol):
    """Moved at mission ticks. `state` is one frozen value, journaled in every note of kind `mission`."""

    @property
    def state(self) -> MissionState: ...

    @property
    def docks(self) -> tuple[int | None, ...]:
        """The agent in each dock, None for a free one."""
        ...

    def moved(self, north_m: float, east_m: float) -> None:
        """The aPad is here, in local NED metres."""
        ...

    def receive(self, outcome: Outcome, now_ms: int) -> list[Order]: ...

    def advance(self, now_ms: int) -> list[Order]: ...

    def stand_down(self, reason: str, now_ms: int) -> list[Order]:
        """One of several aPads can do no more: it plans nothing and goes nowhere. Whom its docks hold they go on holding.

        A second call changes nothing; so does one where somebody else gives the orders.
        """
        ...

    def end(self, reason: str, now_ms: int) -> list[Order]:
        """Ends it where it stands; a second call changes nothing."""
        ...
