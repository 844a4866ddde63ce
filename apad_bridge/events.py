"""The events of a flight: one frozen class for each kind, made by whoever sees the event.

The journal's line, the check of a line that is read, the text for people and the table in docs/records.md follow from the
class. A field with a default is told only where it says something. Kinds that have no class yet stand in
`apad_bridge/records/event_kinds.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields
from typing import Annotated, Any, ClassVar, NamedTuple, Self


class Meaning(NamedTuple):
    """A field's meaning and unit, for the table in the docs."""

    text: str
    unit: str = ""


AMussel = Annotated[int, Meaning("the aMussel")]
Reason = Annotated[str, Meaning("why")]


class Event:
    """The base of all kinds. A subclass is a frozen dataclass of plain values, with the names of the journal's fields."""

    kind: ClassVar[str]
    when: ClassVar[str]
    """The occasion, for the docs."""
    is_failure: ClassVar[bool] = False
    """True for a kind of which a person is told at once."""

    @property
    def data(self) -> dict[str, Any]:
        """The journal's fields, in order."""
        told = ((it, getattr(self, it.name)) for it in fields_of(type(self)))
        return {it.name: value for it, value in told if not (is_optional(it) and value is None)}

    def text(self) -> str | None:
        """One sentence for people; None for a step of routine."""
        return None

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Self:
        """The event of a journal's line; further fields are left out. TypeError for a line without a field."""
        names = {it.name for it in fields_of(cls)}
        return cls(**{name: value for name, value in data.items() if name in names})


def fields_of(kind: type[Event]) -> tuple[Field[Any], ...]:
    """The fields of a kind, in the order of the journal's line."""
    return fields(kind)  # type: ignore[arg-type]  # each subclass is a dataclass


def is_optional(field: Field[Any]) -> bool:
    return field.default is not MISSING


@dataclass(frozen=True)
class LegBegan(Event):
    kind = "leg"
    when = "the aPad was ordered to another place"

    metres: Annotated[float, Meaning("in a straight line from where it was", "m")]


@dataclass(frozen=True)
class Released(Event):
    kind = "released"
    when = "an aMussel left its dock and was ordered to sink"

    agent: AMussel
    full: Annotated[bool, Meaning("true if it was believed full at that order: it counts as a service")]


@dataclass(frozen=True)
class GivenUp(Event):
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
class Stuck(Event):
    kind = "stuck"
    when = "several go-tos in a row failed: the aPad is stuck"
    is_failure = True

    reason: Reason

    def text(self) -> str:
        return f"the aPad is stuck: {self.reason}"


@dataclass(frozen=True)
class Overridden(Event):
    kind = "override"
    when = "a person took the aPad over, or gave it back"

    taken: Annotated[bool, Meaning("true for taking over")]
    by: Annotated[str | None, Meaning("`person`, or `vehicle` when another party steers it")] = None

    def text(self) -> str:
        return "a person took the aPad over" if self.taken else "the aPad was given back"


@dataclass(frozen=True)
class StandsDown(Event):
    kind = "stands_down"
    when = "one of several aPads leaves its aMussels to the others"

    reason: Reason

    def text(self) -> str:
        return f"the aPad stands down: {self.reason}"


@dataclass(frozen=True)
class DocksDisagree(Event):
    kind = "docks_disagree"
    when = "witnesses of a dock disagree: `position_static`, `check_docking_availability`, the aMussel, our own record"
    is_failure = True

    id: AMussel
    reason: Annotated[str, Meaning("what each says, and what the mission takes for true")]

    def text(self) -> str:
        return f"the docks' witnesses disagree about aMussel {self.id}: {self.reason}"


@dataclass(frozen=True)
class Died(Event):
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
class RangeMeasured(Event):
    kind = "range"
    when = "a ping was answered, or its time-out passed"

    id: AMussel
    range_m: Annotated[float | None, Meaning("the range; null without an answer", "m")]


@dataclass(frozen=True)
class Asked(Event):
    kind = "asked"
    when = "an aMussel was asked for its status by sound"

    id: AMussel


@dataclass(frozen=True)
class Unanswered(Event):
    kind = "unanswered"
    when = "the aMussel did not answer in time"

    id: AMussel


@dataclass(frozen=True)
class SamplesGone(Event):
    kind = "samples_gone"
    when = "samples that can no longer be uploaded"

    id: AMussel
    count: Annotated[int, Meaning("how many")]
    first: Annotated[int, Meaning("the lowest sequence number among them")]
    last: Annotated[int, Meaning("the highest")]


@dataclass(frozen=True)
class LeftWater(Event):
    kind = "left_water"
    when = "an aPad's modem and its aMussels are out of the water that several aPads share, before its mission's end"
    is_failure = True

    name: Annotated[str, Meaning("the aPad")]
    reason: Reason

    def text(self) -> str:
        return f"{self.name} is out of the water: {self.reason}"


@dataclass(frozen=True)
class MasterGone(Event):
    kind = "master_gone"
    when = "another party's ROS master does not answer"

    uri: Annotated[str, Meaning("its address")]
    why: Annotated[str, Meaning("the symptom")]

    def text(self) -> str:
        return "the ROS master is gone"


@dataclass(frozen=True)
class MasterBack(Event):
    kind = "master_back"
    when = "that master answers again, and the run has registered everything"

    uri: Annotated[str, Meaning("its address")]
    gone_s: Annotated[float, Meaning("the length of its absence, by the wall clock", "s")]
    registered: Annotated[int, Meaning("topics and services")]

    def text(self) -> str:
        return "the ROS master is back"


@dataclass(frozen=True)
class GraphDeaf(Event):
    kind = "graph_deaf"
    when = "no node can connect to the run's own node: its services and its new subscribers get no answer"
    is_failure = True

    why: Annotated[str, Meaning("the symptom")]

    def text(self) -> str:
        return f"no ROS node can connect to this run: {self.why}"


@dataclass(frozen=True)
class GraphHears(Event):
    kind = "graph_hears"
    when = "nodes can connect again"

    deaf_s: Annotated[float, Meaning("the length of that, by the wall clock", "s")]

    def text(self) -> str:
        return "ROS nodes can connect to this run again"


@dataclass(frozen=True)
class VehicleSilent(Event):
    kind = "vehicle_silent"
    when = "a real aPad stopped publishing"

    name: Annotated[str, Meaning("the aPad")]
    since_ms: Annotated[int, Meaning("since when", "mission ms")]

    def text(self) -> str:
        return "the aPad is silent"


@dataclass(frozen=True)
class VehicleHeard(Event):
    kind = "vehicle_heard"
    when = "it publishes again"

    name: Annotated[str, Meaning("the aPad")]
    since_ms: Annotated[int, Meaning("since when it was silent", "mission ms")]

    def text(self) -> str:
        return "the aPad publishes again"


@dataclass(frozen=True)
class Unreadable(Event):
    kind = "unreadable"
    when = "a node publishes messages that the run cannot use, for the first time; the summary counts them under `dropped`"
    is_failure = True

    topic: Annotated[str, Meaning("the topic")]
    node: Annotated[str, Meaning("the node")]
    why: Annotated[str, Meaning("why they are dropped")]

    def text(self) -> str:
        return f"messages of {self.node} on {self.topic} are dropped: {self.why}"


EVENTS: dict[str, type[Event]] = {it.kind: it for it in Event.__subclasses__()}
"""The class of each kind."""
