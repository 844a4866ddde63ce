"""The value types of a scenario: numbers with bounds, names, and dataclasses that refuse unknown keys."""

from __future__ import annotations

import re
from dataclasses import is_dataclass
from typing import Annotated, Any, TypeVar, cast, dataclass_transform

from annotated_types import Ge, Gt, Le
from pydantic import AfterValidator, ConfigDict, Discriminator, PlainValidator, StringConstraints, Tag
from pydantic.dataclasses import dataclass

from agents.water.bounds import GREATEST, not_tiny
from firmware_model.packets.wire import MAX_AGENT_ID
from firmware_model.power.charge import grains
from firmware_model.power.voltage_curve import VoltageCurve


def _whole_milliseconds(seconds: float) -> float:
    # Time is integer milliseconds inside: a period of 0.4 ms would be none at all.
    if abs(seconds * 1000 - round(seconds * 1000)) > 1e-6:
        raise ValueError("must be a whole number of milliseconds")
    return seconds


def _end_time(end: Any) -> float | str:
    if isinstance(end, str) and re.fullmatch(r"([01]?[0-9]|2[0-3]):[0-5][0-9]", end, re.ASCII):
        return end
    if isinstance(end, bool) or not isinstance(end, int | float) or not 0.001 <= end <= 1e9:
        raise ValueError("must be a local time as 16:30, or 0.001 to 1e9 seconds")
    return _whole_milliseconds(float(end))


def _ten_decimals(rate: float) -> float:
    if round(rate, 10) != rate:
        raise ValueError("must have at most ten decimals")
    return rate


def _rising_to_one(segments: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if not (ends := [end for end, _ in segments]) or ends != sorted(set(ends)) or ends[-1] != 1.0:
        raise ValueError("must rise and end at 1.0")
    return segments


def _rising_from_empty_to_full(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    try:
        VoltageCurve(tuple((grains(charge), grains(voltage)) for charge, voltage in points))
    except (ValueError, ArithmeticError):
        raise ValueError("must rise, in charge from 0 to 1 and in voltage") from None
    return points


AgentId = Annotated[int, Ge(1), Le(MAX_AGENT_ID)]
Positive = Annotated[float, Gt(0), Le(GREATEST), AfterValidator(not_tiny)]
PositiveSeconds = Annotated[float, Ge(0.001), Le(1e9), AfterValidator(_whole_milliseconds)]
NotNegativeSeconds = Annotated[float, Ge(0), Le(1e9), AfterValidator(_whole_milliseconds)]
Quantity = Annotated[float, Ge(-GREATEST), Le(GREATEST)]
Place = tuple[Annotated[float, Ge(-1e5), Le(1e5)], Annotated[float, Ge(-1e5), Le(1e5)]]
"""(north, east) of the origin, in metres. Farther away a plane is no chart of the sea, and a packet has no room for it."""
Speed = Annotated[float, Ge(-20), Le(20)]
"""A velocity's component, in m/s."""
Milliseconds = Annotated[int, Ge(0), Le(1_000_000_000)]
Fraction = Annotated[float, Ge(0), Le(1)]
RatePerMinute = Annotated[float, Gt(0), Le(1000), AfterValidator(_ten_decimals)]
"""Rate of a battery's charge. The firmware model counts charge in grains: 1e-10 a minute is one grain a millisecond."""
ChargeSegments = Annotated[tuple[tuple[Fraction, RatePerMinute], ...], AfterValidator(_rising_to_one)]
"""(upper end of the segment on [0, 1], rate a minute), rising; the last ends at 1."""
DischargeCurve = Annotated[tuple[tuple[Fraction, Fraction], ...], AfterValidator(_rising_from_empty_to_full)]
"""(charge, scaled voltage), both rising, the charge from 0 to 1."""
VALUES, FILE = "(values)", "(file)"
"""Members of a union, which pydantic adds to the path of an error; the author of the file does not know them."""
VALUES_OR_FILE = Discriminator(
    lambda it: VALUES if isinstance(it, dict | list | tuple) or is_dataclass(it) else FILE
)
"""A key holds values, or the name of a file that holds them: a mapping or a list is no attempt at a name."""
TheirFile = Annotated[str, Tag(FILE)]
EndTime = Annotated[float | str, PlainValidator(_end_time)]
"""Seconds, or a local time as 16:30."""
FileName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
RosName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
RosNamespace = Annotated[
    str, StringConstraints(pattern=r"^/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*$")
]
"""A name with a leading slash is global, any other lies below the namespace of the run."""

_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False, defer_build=True)
_Kind = TypeVar("_Kind")


@dataclass_transform(frozen_default=True, kw_only_default=True)
def frozen(kind: type[_Kind]) -> type[_Kind]:
    """Makes a class of the scenario a frozen dataclass that checks its values on creation."""
    checked: Any = dataclass(frozen=True, kw_only=True, config=_STRICT)(kind)
    return cast(type[_Kind], checked)
