"""Events by which a person's or a script's word enters the records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from apad_bridge.events.event import Event, Meaning


@dataclass(frozen=True)
class Overridden(Event):
    kind = "override"
    when = "a person took the aPad over, or gave it back"

    taken: Annotated[bool, Meaning("true for taking over")]
    by: Annotated[str | None, Meaning("`person`, or `vehicle` when another party steers it")] = None

    def text(self) -> str:
        return "a person took the aPad over" if self.taken else "the aPad was given back"
