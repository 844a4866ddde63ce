"""The messages between the parent of a run and its supervisors.

A supervisor writes messages: one JSON line each on standard output, {"NAME": {fields}}. A line that is no message is text
for people: a library's warning, or a torn line. The writer continues without a reader.

The parent of several aPads writes orders, in a file of the supervisor's run directory. A file, because the next supervisor
reads it too: a supervisor that died is resumed with its current share.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, get_args

from pydantic import TypeAdapter

from apad_bridge.runs.progress_status import RunStatus
from apad_bridge.scenario.text.text_file import write_atomically

ORDERS_FILE = "squad.json"


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
class APadView:
    """One of several aPads, and the aMussels that it serves, as its supervisor believes; metres."""

    name: str
    is_down: bool
    place_m: tuple[float, float]
    places_m: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    """The aMussels that may need service: there is a belief of them, and they are not lost."""
    movable: frozenset[int] = frozenset()
    """Those of `places_m` that may be moved."""


@dataclass(frozen=True, slots=True)
class TransferredBelief:
    """The former server's belief of an aMussel at mission time `at_ms`: the result of `Estimator.kept`, or None."""

    at_ms: int = 0
    estimate: Any = None


@dataclass(frozen=True, slots=True)
class Gave:
    """The aMussels of its orders that the aPad has left to another, with what was believed of each."""

    transfers: Mapping[int, TransferredBelief]


@dataclass(frozen=True, slots=True)
class Kept:
    """The aMussels that cannot be handed on at the moment."""

    agent_ids: tuple[int, ...]


MemberReport = APadView | Gave | Kept
"""The reports that only the parent of several aPads needs."""
ParentMessage = RunStatus | Said | Summary | Failed | MemberReport

_KINDS: dict[str, Any] = {kind.__name__.lower(): kind for kind in get_args(ParentMessage)}


def to_line(message: ParentMessage) -> str:
    return json.dumps({type(message).__name__.lower(): asdict(message)}, default=sorted)


def from_line(line: str) -> ParentMessage:
    """The message; any other line is something said."""
    try:
        ((name, fields),) = json.loads(line).items()
        message: ParentMessage = _adapter(name).validate_python(fields)
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
        return Said(line)
    return message


def write(message: ParentMessage) -> None:
    """Writes to the parent, if there still is one."""
    with contextlib.suppress(BrokenPipeError):
        print(to_line(message), flush=True)


def say(text: str) -> None:
    """Writes a line for people."""
    write(Said(text))


@cache
def _adapter(name: str) -> TypeAdapter[Any]:
    return TypeAdapter(_KINDS[name])


@dataclass(frozen=True, slots=True)
class Orders:
    """The parent's orders to one of several aPads' supervisors."""

    serves: Mapping[int, TransferredBelief]
    """The aMussels to serve from now on, of the supervisor's own fleet and of others."""
    stands_down: str | None = None
    """The reason to stand down; None to fly on."""

    def save(self, run_dir: Path) -> None:
        serves = [[agent_id, it.at_ms, it.estimate] for agent_id, it in sorted(self.serves.items())]
        data = {"serves": serves, "stands_down": self.stands_down}
        write_atomically(run_dir / ORDERS_FILE, json.dumps(data) + "\n")

    @classmethod
    def load(cls, run_dir: Path) -> Orders | None:
        """None where there are no orders yet. ValueError, KeyError or TypeError when the file holds no orders."""
        try:
            data = json.loads((run_dir / ORDERS_FILE).read_text())
        except FileNotFoundError:
            return None
        return cls(
            {agent_id: TransferredBelief(at_ms, estimate) for agent_id, at_ms, estimate in data["serves"]},
            data["stands_down"],
        )
