"""The messages that a run's processes write to their parent: one JSON line each on standard output, {"NAME": {fields}}.

A supervisor writes to its run's parent; of several aPads, that parent writes to the parent of all. A line that is no
message is text for people: a library's warning, or a torn line. The writer continues without a reader.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any, get_args

from pydantic import TypeAdapter

from apad_bridge.runs.status import Status


@dataclass(frozen=True, slots=True)
class Said:
    """A line for people."""

    text: str


@dataclass(frozen=True, slots=True)
class Summary:
    """The run has ended, with the figures of its summary.json."""

    figures: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Failed:
    """Something that the run needs has failed; the reason is one line."""

    reason: str


@dataclass(frozen=True, slots=True)
class Seen:
    """One of several aPads as its supervisor believes it, with the aMussels that it serves: the fields of `APadView`."""

    name: str
    is_down: bool
    place_m: tuple[float, float]
    places_m: Mapping[int, tuple[float, float]]
    movable: frozenset[int]


@dataclass(frozen=True, slots=True)
class HandedOver:
    """An aMussel that is no longer served, with what was believed of it at mission time `at_ms` (`Estimator.kept`)."""

    agent_id: int
    at_ms: int
    estimate: Any


@dataclass(frozen=True, slots=True)
class Gave:
    """The aMussels of its orders that the aPad has left to another."""

    transfers: tuple[HandedOver, ...]


@dataclass(frozen=True, slots=True)
class Kept:
    """The aMussels that cannot be handed on at the moment."""

    agent_ids: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Broken:
    """The aPad's supervisor died, and another keeps its aMussels for the others."""

    reason: str


MemberReport = Seen | Gave | Kept | Broken
"""The reports that only the parent of several aPads needs."""
Message = Status | Said | Summary | Failed | MemberReport

_KINDS: dict[str, Any] = {kind.__name__.lower(): kind for kind in get_args(Message)}


def to_line(message: Message) -> str:
    return json.dumps({type(message).__name__.lower(): asdict(message)}, default=sorted)


def from_line(line: str) -> Message:
    """The message; any other line is something said."""
    try:
        ((name, fields),) = json.loads(line).items()
        message: Message = _adapter(name).validate_python(fields)
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
        return Said(line)
    return message


def write(message: Message) -> None:
    """Writes to the parent, if there still is one."""
    with contextlib.suppress(BrokenPipeError):
        print(to_line(message), flush=True)


def say(text: str) -> None:
    """Writes a line for people."""
    write(Said(text))


@cache
def _adapter(name: str) -> TypeAdapter[Any]:
    return TypeAdapter(_KINDS[name])
