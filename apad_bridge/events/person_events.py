"""Events by which a person's or a script's word enters the records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Annotated, Any

from apad_bridge.events.event import Category, Event, Meaning, Uncounted


class Steering(StrEnum):
    """The party that has the right to steer, beside the mission."""

    PERSON = "person"
    """A person took the aPad over, and alone gives it back."""
    OTHERS = "vehicle"
    """Another party steers the vehicle; a person's word to continue returns it to the mission."""
    STOP = "stop"
    """Nobody: a stop holds the mission up until a person continues."""


@dataclass(frozen=True)
class Overridden(Event):
    kind = "override"
    when = "a person or a stop took the aPad from the mission, or it was given back"
    counted = ("taken",)
    category = Category.WORD

    taken: Annotated[bool, Meaning("true for taking over")]
    by: Annotated[
        Steering | None,
        Meaning(
            "`person`, `vehicle` when another party steers it, or `stop` when nobody does until a person continues"
        ),
    ] = None

    def text(self) -> str:
        if self.taken and self.by is Steering.STOP:
            return "the mission waits: the aPad was stopped"
        return "a person took the aPad over" if self.taken else "the aPad was given back"


@dataclass(frozen=True)
class PersonOrdered(Event):
    kind = "operator"
    when = "a person gave the supervisor an order by a command"
    counted = ("order", "agent", "north_m", "east_m")
    category = Category.WORD

    order: Annotated[str, Meaning("the act, as commands and consoles name it: `stop`, `back in` or `go to`")]
    by: Annotated[str, Meaning("the person's name on that machine")]
    agent: Annotated[int | None, Meaning("the aMussel")] = None
    north_m: Annotated[float | None, Meaning("the goal, north", "m")] = None
    east_m: Annotated[float | None, Meaning("the goal, east", "m")] = None

    def text(self) -> str:
        whom = "" if self.agent is None else f", aMussel {self.agent}"
        return f"{self.by} ordered: {self.order}{whom}"


@dataclass(frozen=True)
class SpeedChanged(Event):
    kind = "speed"
    when = "a person changed the speed of a simulated flight, or had a tick come while its time stood still"
    counted = Uncounted("the wall clock's pace, which no decision follows")
    category = Category.WORD

    times: Annotated[
        float, Meaning("mission seconds in a wall second from then on; 0: mission time stands still")
    ]
    by: Annotated[str, Meaning("the person's name on that machine")]

    def text(self) -> str:
        return f"{self.by} set the flight's speed: " + (
            f"{self.times:g} times real time" if self.times else "it stands"
        )


@dataclass(frozen=True)
class Remarked(Event):
    kind = "remark"
    when = "a person made a remark"
    counted = Uncounted("a person's note")
    category = Category.WORD

    text_: Annotated[str, Meaning("the remark")]
    by: Annotated[str, Meaning("who made it")]

    def text(self) -> str:
        return f"{self.by}: {self.text_}"


@dataclass(frozen=True)
class ScriptReported(Event):
    kind = "script"
    when = "a script printed a line, or noted its own event with its own fields"
    counted = ("what",)
    category = Category.WORD

    said: Annotated[str | None, Meaning("a line for people")] = None
    what: Annotated[str | None, Meaning("the name that the script gave its event")] = None
    own: Mapping[str, Any] = field(default_factory=dict)
    """The fields that the script's author named."""

    @property
    def data(self) -> dict[str, Any]:
        return super().data | dict(self.own)

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> ScriptReported:
        """The event of a line: each further field is the author's."""
        own = {name: it for name, it in data.items() if name not in ("t", "kind", "said", "what")}
        return replace(super().of(data), own=own)

    def text(self) -> str | None:
        return None if self.said is None else f"script: {self.said}"
