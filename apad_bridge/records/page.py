"""The tables of docs/records.md: python -m apad_bridge.records.page"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

from apad_bridge.beliefs.modes import Mode
from apad_bridge.events.union import EVENTS
from apad_bridge.records.line_types import LineField, line_fields
from apad_bridge.records.summary import AMUSSEL, SUMMARY
from firmware_model.states import State


def markdown() -> str:
    """Returns the sections of the journal, the summary and the numbers of states."""
    lines = ["## The journal's lines", ""]
    for kind in EVENTS.values():
        lines += [f"### {kind.kind}", "", f"{kind.when[0].upper()}{kind.when[1:]}.", ""]
        lines += [*_table(fields), ""] if (fields := line_fields(kind)) else []
    lines += ["## The summary", "", *_table(SUMMARY), ""]
    lines += ["In `amussels`, each has:", "", *_table(AMUSSEL), ""]
    lines += [
        "## Numbers of states and modes",
        "",
        "The journal has their names; the bag and ROS have numbers.",
        "",
    ]
    lines += [*_numbers("state", State), "", *_numbers("mode", Mode), ""]
    return "\n".join(lines)


def _table(fields: Sequence[LineField]) -> list[str]:
    return ["| field | type | unit | |", "|---|---|---|---|", *map(_row, fields)]


def _row(field: LineField) -> str:
    meaning = f"{field.meaning} (not in every line)" if field.optional else field.meaning
    return f"| `{field.name}` | {field.type.text} | {field.unit} | {meaning} |"


def _numbers(name: str, kind: type[IntEnum]) -> list[str]:
    return [f"| number | {name} |", "|---|---|", *(f"| {it.value} | {it.name} |" for it in kind)]


if __name__ == "__main__":
    print(markdown(), end="")
