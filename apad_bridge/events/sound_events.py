"""Events of the acoustic channel: packets, pings, places from ranges, samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from apad_bridge.events.event import AMussel, East, Event, Meaning, North, Uncounted


@dataclass(frozen=True)
class RangeMeasured(Event):
    kind = "range"
    when = "a ping was answered, or its time-out passed"
    counted = ("id", "range_m")

    id: AMussel
    range_m: Annotated[float | None, Meaning("the range; null without an answer", "m")]


@dataclass(frozen=True)
class Asked(Event):
    kind = "asked"
    when = "an aMussel was asked for its status by sound"
    counted = ("id",)

    id: AMussel


@dataclass(frozen=True)
class NoAnswer(Event):
    kind = "unanswered"
    when = "the aMussel did not answer in time"
    counted = ("id",)

    id: AMussel


@dataclass(frozen=True)
class SamplesGone(Event):
    kind = "samples_gone"
    when = "samples that can no longer be uploaded"
    counted = ("id", "count", "first", "last")

    id: AMussel
    count: Annotated[int, Meaning("how many")]
    first: Annotated[int, Meaning("the lowest sequence number among them")]
    last: Annotated[int, Meaning("the highest")]


HeardRow = tuple[int, str, float, int, float, float]
"""At one listener: id (another aPad is -n, the n-th), outcome, SNR in dB, end in agent ms, travel time in ms, way in m."""
LinkRow = tuple[int | None, int | None, float, int, int | None]
"""From, to, loss (0 to 1), since, until (agent ms)."""


@dataclass(frozen=True)
class PacketPassed(Event):
    kind = "packet"
    when = "an acoustic packet ended, in simulated water"
    counted = ("from", "address", "what", "began_ms", "timeslot", "unsent", "heard")

    from_: Annotated[int, Meaning("the sender: an aMussel's id, 0 is the aPad")]
    address: Annotated[int | None, Meaning("the addressed modem; null for all")]
    what: Annotated[str, Meaning("the kind of frame")]
    bytes: Annotated[int, Meaning("its payload", "bytes")]
    began_ms: Annotated[int, Meaning("when it began", "agent ms")]
    lasted_ms: Annotated[int, Meaning("the duration of its transmission", "agent ms")]
    timeslot: Annotated[int | None, Meaning("the timeslot in which it began; null without timeslots")]
    unsent: Annotated[str | None, Meaning("why it was not sent; null for a sent one")]
    heard: Annotated[
        list[HeardRow],
        Meaning(
            "at each listener: id (another aPad is -n, the n-th), outcome, SNR, end, travel time, way",
            "dB, agent ms, ms, m",
        ),
    ]
    data_: Annotated[str, Meaning("its payload, in hexadecimal")]


@dataclass(frozen=True)
class PlaceFixed(Event):
    kind = "fix"
    when = "ranges gave an aMussel's place"
    counted = ("id", "ranges", "north_m", "east_m")

    id: AMussel
    north_m: North
    east_m: East
    covariance: Annotated[list[float], Meaning("north, north-east, east", "m^2")]
    hdop: Annotated[float, Meaning("dilution of precision, of the geometry")]
    residual_m: Annotated[float, Meaning("root mean square of the ranges' residuals", "m")]
    ranges: Annotated[int, Meaning("number of ranges used")]


@dataclass(frozen=True)
class LinksRead(Event):
    kind = "links"
    when = "the file of links between modems changed"
    counted = Uncounted("a file of the machine")

    rules: Annotated[
        list[LinkRow] | None,
        Meaning("from, to, loss, since, until; null when the file could not be read", "0 to 1, agent ms"),
    ]
    problem: Annotated[str | None, Meaning("why it could not be read")]


@dataclass(frozen=True)
class ModemReported(Event):
    kind = "modem"
    when = "a physical or opened modem dropped a packet, or changed"
    counted = Uncounted("a serial line of the machine")

    dropped: Annotated[str | None, Meaning("why it dropped a packet")] = None
    id: Annotated[int | None, Meaning("the aMussel of that packet")] = None
    what: Annotated[str | None, Meaning("what happened")] = None
