"""Events of aMussels and their processes, and of the fleet's division among several aPads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from apad_bridge.events.event import AMussel, Event, Meaning, Reason


@dataclass(frozen=True)
class ProcessDied(Event):
    kind = "died"
    when = "an aMussel's process ended: a reset of its MU"

    id: AMussel
    agent_ms: Annotated[int, Meaning("when, by the aMussel's time", "agent ms")]
    cause: Annotated[str, Meaning("the cause of the reset, by name")]
    reason: Annotated[str, Meaning("why the process ended")]
    gave_up: Annotated[str | None, Meaning("why it stays dead; null when it was started again")]

    def text(self) -> str:
        fate = f": {self.gave_up}" if self.gave_up else ", and was started again"
        return f"the process of aMussel {self.id} died{fate}"


@dataclass(frozen=True)
class APadLeftWater(Event):
    kind = "left_water"
    when = "an aPad's modem and its aMussels are out of the water that several aPads share, before its mission's end"
    is_failure = True

    name: Annotated[str, Meaning("the aPad")]
    reason: Reason

    def text(self) -> str:
        return f"{self.name} is out of the water: {self.reason}"
