"""Events of the mission: its ways, and what became of each aMussel that it serves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from apad_bridge.events.event import AMussel, Event, Meaning, Reason


@dataclass(frozen=True)
class LegBegan(Event):
    kind = "leg"
    when = "the aPad was ordered to another place"

    metres: Annotated[float, Meaning("in a straight line from where it was", "m")]


@dataclass(frozen=True)
class AMusselReleased(Event):
    kind = "released"
    when = "an aMussel left its dock and was ordered to sink"

    agent: AMussel
    full: Annotated[bool, Meaning("true if it was believed full at that order: it counts as a service")]


@dataclass(frozen=True)
class StepGivenUp(Event):
    kind = "given_up"
    when = "a step of the mission was given up"
    is_failure = True

    agent: AMussel
    what: Annotated[str, Meaning("`collect`, `deploy`, `charge` or `dock`")]
    reason: Reason

    def text(self) -> str | None:
        fates = {
            "collect": "is not collected this time",
            "deploy": "is not returned this time",
            "charge": "is not charged any further",
            "dock": "is not docked",
        }
        fate = fates.get(self.what)
        return None if fate is None else f"aMussel {self.agent} {fate}: {self.reason}"


@dataclass(frozen=True)
class LeftAlone(Event):
    kind = "left_alone"
    when = "the mission stopped its tries to serve an aMussel"
    is_failure = True

    agent: AMussel
    tries: Annotated[int, Meaning("number of failed tries in a row")]
    reason: Reason

    def text(self) -> str:
        return (
            f"aMussel {self.agent} is left alone from now on: {self.tries} tries in a row failed, "
            f"the last one: {self.reason}"
        )


@dataclass(frozen=True)
class BeyondReach(Event):
    kind = "beyond_reach"
    when = "the mission will not serve an aMussel for the present, because of the way to it"
    is_failure = True

    agent: AMussel
    reason: Reason

    def text(self) -> str:
        return f"aMussel {self.agent} is beyond reach: {self.reason}"


@dataclass(frozen=True)
class InReach(Event):
    kind = "in_reach"
    when = "such an aMussel can be served again"

    agent: AMussel

    def text(self) -> str:
        return f"aMussel {self.agent} is in reach again"


@dataclass(frozen=True)
class Stuck(Event):
    kind = "stuck"
    when = "several go-tos in a row failed: the aPad is stuck"
    is_failure = True

    reason: Reason

    def text(self) -> str:
        return f"the aPad is stuck: {self.reason}"


@dataclass(frozen=True)
class StandsDown(Event):
    kind = "stands_down"
    when = "one of several aPads leaves its aMussels to the others"

    reason: Reason

    def text(self) -> str:
        return f"the aPad stands down: {self.reason}"
