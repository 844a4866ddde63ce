"""Events of the acoustic channel: packets, pings, places from ranges, samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from apad_bridge.events.event import AMussel, Event, Meaning


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
class NoAnswer(Event):
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
